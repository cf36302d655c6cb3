# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All analyses of the report on one set of trials, as parts of one list of work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_classifier.datasets.conditions import find_strata
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import (
    choose_repetitions,
    grouped_split,
    Split,
    stratified_split,
)
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.cross_validation import AccuracyPlan, Evaluation
from tactile_classifier.evaluation.feature_selection import SelectionPlan, SelectionResult
from tactile_classifier.evaluation.learning_curves import LearningCurve, LearningPlan
from tactile_classifier.evaluation.plans import Plan, run_plans
from tactile_classifier.evaluation.significance import rank_sum_p_values, RankSum
from tactile_features.records import PROTOCOL_STIFFNESS
from tactile_lab.report.answers import Answers, AnswersPlan
from tactile_lab.report.recordings import RecordingSet

FORCE_UNITS = {'MN': 1e-6, 'kN': 1e-3, 'N': 1.0, 'mN': 1e3, 'µN': 1e6}
"""Units of force and how many of each are one newton."""


@dataclass(frozen=True)
class UnitPoint:
    """Accuracy of the unscaled RBF SVM when forces are stated in another unit [1]."""

    unit: str
    accuracy: float


@dataclass(frozen=True)
class SetResult:
    """What was found on one set of trials.

    Attributes
    ----------
    recordings : RecordingSet
    evaluations : tuple of Evaluation
        Plain folds first, then one a grouped split, then one a stated split.
    curves : tuple of LearningCurve
    selections : tuple of SelectionResult
    significance : RankSum
        On all trials.
    units : tuple of UnitPoint
        For stiffness, whose features differ in unit; empty otherwise.
    not_done : tuple of str
        One sentence for each analysis that the trials do not allow.
    answers : Answers or None
        What a model says besides a label; None where it was not asked for.
    published : SetResult or None
        Random folds and significance with the features that the paper computes, where
        ``recordings`` has others.
    """

    recordings: RecordingSet
    evaluations: tuple[Evaluation, ...]
    curves: tuple[LearningCurve, ...]
    selections: tuple[SelectionResult, ...]
    significance: RankSum
    units: tuple[UnitPoint, ...]
    not_done: tuple[str, ...]
    answers: Answers | None = None
    published: SetResult | None = None

    @property
    def as_published(self) -> SetResult:
        """The result to compare with the paper's statements."""
        return self.published or self

    @property
    def plain(self) -> Evaluation:
        """The evaluation by random folds."""
        return self.evaluations[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as what JSON can hold."""
        recordings = self.recordings
        return {
            'title': recordings.title,
            'task': recordings.table.task,
            'contact': recordings.contact,
            'simulated': recordings.simulated,
            'trials': len(recordings.table),
            'feature_set': recordings.table.spec.feature_set,
            'feature_parameters': dict(recordings.table.spec.parameters),
            'features': list(recordings.table.spec.names),
            'evaluations': [evaluation.to_dict() for evaluation in self.evaluations],
            'learning_curves': [curve.to_dict() for curve in self.curves],
            'feature_selection': [selection.to_dict() for selection in self.selections],
            'rank_sum': {
                'labels': list(self.significance.labels),
                'strata': self.significance.strata,
                'mean_p': self.significance.mean_p.tolist(),
                'p': self.significance.p.tolist() if self.units else None,
            },
            'rbf_unscaled_by_unit_of_force': {point.unit: point.accuracy for point in self.units},
            'answers': None if self.answers is None else self.answers.to_dict(),
            'not_done': list(self.not_done),
            'prepared': list(recordings.steps),
            'skipped': [{'row': each.row, 'reason': each.reason} for each in recordings.skipped],
        }


class _SetPlans:
    """The plans of one set, and how to take their results apart again."""

    def __init__(
        self,
        recordings: RecordingSet,
        folds: int,
        repetitions: int | None,
        random_state: int,
        *,
        answers: bool,
        details: bool,
    ) -> None:
        self._recordings = recordings
        self._random_state = random_state
        table = recordings.table
        repetitions, saving = choose_repetitions(table, repetitions)
        self._not_done = [saving] if saving else []
        splits = [stratified_split(table, folds, repetitions, random_state)]
        splits += [grouped_split(table, columns) for columns in recordings.hold_out]
        self._accuracy = [
            AccuracyPlan(table, split, random_state=None if saving else random_state)
            for split in (*splits, *recordings.splits)
        ]
        published = recordings.published
        self._published = (
            []
            if published is None or not details
            else [AccuracyPlan(published, splits[0], random_state=random_state)]
        )
        self._learning = [
            plan
            for split in (splits if details and not saving else [])
            if (plan := LearningPlan(table, split, random_state=random_state)).trials_per_class
        ]
        if saving and details:
            self._not_done.append(
                'learning curves, feature selection, choice of the classifier inside the folds: '
                'left out of a large table without --repetitions'
            )
        self._selection = self._plan_selection(splits) if details and not saving else []
        self._units: list[AccuracyPlan] = []
        if table.task == PROTOCOL_STIFFNESS and details:
            self._units = [
                AccuracyPlan(in_unit(table, factor), splits[0].once(), ['svm_rbf'], ['none'])
                for factor in FORCE_UNITS.values()
            ]
        hold_out = next(iter(recordings.hold_out), ())
        self._answers = [AnswersPlan(table, hold_out)] if answers else []

    def _plan_selection(self, splits: Sequence[Split]) -> list[SelectionPlan]:
        table = self._recordings.table
        plans: list[SelectionPlan] = []
        if table.values.shape[1] < 2:
            self._not_done.append('feature selection: there is one feature only')
            return plans
        for split in splits:
            try:
                plans.append(SelectionPlan(table, split, random_state=self._random_state))
            except EvaluationError as error:  # noqa: PERF203 - a few splits
                self._not_done.append(f'feature selection, {split.name}: {error}')
        return plans

    def plans(self) -> list[Plan[Any]]:
        plans: list[Plan[Any]] = [*self._accuracy, *self._learning, *self._selection]
        return [*plans, *self._units, *self._published, *self._answers]

    def finish(self, results: Sequence[Any]) -> SetResult:
        answers = iter(results)
        evaluations = tuple(next(answers) for _ in self._accuracy)
        curves = tuple(curve for _ in self._learning for curve in next(answers))
        selections = tuple(result for _ in self._selection for result in next(answers))
        units = (
            tuple(UnitPoint(unit, next(answers).scores[0].mean) for unit in FORCE_UNITS)
            if self._units
            else ()
        )
        published = tuple(next(answers) for _ in self._published)
        found = next(answers) if self._answers else None
        table = self._recordings.table
        result = SetResult(
            self._recordings,
            evaluations,
            curves,
            selections,
            rank_sum_p_values(table.values, table.labels, find_strata(table)),
            units,
            (*self._not_done, *(found.not_done if found else ())),
            found,
        )
        return replace(result, published=_publish(result, published)) if published else result


def _publish(result: SetResult, evaluations: tuple[Evaluation, ...]) -> SetResult | None:
    """Return what was found with the features that the paper computes."""
    table = result.recordings.published
    if table is None:
        return None
    return replace(
        result,
        recordings=replace(result.recordings, table=table),
        evaluations=evaluations,
        significance=rank_sum_p_values(table.values, table.labels, find_strata(table)),
        curves=(),
        selections=(),
        answers=None,
    )


def in_unit(table: FeatureTable, factor: float) -> FeatureTable:
    """Return a table whose forces count in another unit, of which ``factor`` are one newton."""
    factors = np.array([factor if unit.startswith('N') else 1.0 for unit in table.spec.units])
    return replace(table, values=table.values * factors)


def analyse(
    sets: Sequence[RecordingSet],
    *,
    folds: int,
    repetitions: int | None,
    random_state: int,
    answers: bool = False,
    details: bool = True,
    jobs: int | None = -1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[SetResult]:
    """Evaluate all sets under plain folds and their grouped splits.

    With ``answers``, also what a model says besides a label, under the first grouped split.
    Without ``details`` accuracies alone: no learning curves, no feature selection, nothing in
    other units or with the features that the paper computes.

    Raises
    ------
    EvaluationError
        When the trials do not allow a split.
    """
    planned = [
        _SetPlans(each, folds, repetitions, random_state, answers=answers, details=details)
        for each in sets
    ]
    counts = [len(each.plans()) for each in planned]
    results = run_plans([plan for each in planned for plan in each.plans()], jobs, progress)
    finished, first = [], 0
    for each, count in zip(planned, counts, strict=True):
        finished.append(each.finish(results[first : first + count]))
        first += count
    return finished
