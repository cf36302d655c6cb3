# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All analyses of the report. The analyses of all sets of trials run in one pool of workers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TYPE_CHECKING, TypeVar

from tactile_analysis.report.recordings import RecordingSet
from tactile_classifier.datasets.conditions import find_mountings, find_strata
from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import (
    choose_repetitions,
    grouped_split,
    Split,
    stratified_split,
)
from tactile_classifier.errors import ClassifierError, EvaluationError
from tactile_classifier.evaluation.cross_validation import AccuracyPlan, Evaluation, Score
from tactile_classifier.evaluation.learning_curve import LearningCurve, measure_learning_curve
from tactile_classifier.evaluation.permutation import measure_permutation, PermutationBaseline
from tactile_classifier.evaluation.plans import Attempt, Plan, run_plans
from tactile_classifier.evaluation.reliability import cross_validate_reliability, Reliability
from tactile_classifier.evaluation.significance import rank_sum_p_values, RankSum
from tactile_features.types import PROTOCOL_STIFFNESS
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_analysis.datasets.automatic_features import Chosen
    from tactile_classifier.evaluation.feature_selection import SelectionResult
    from tactile_classifier.evaluation.open_set import OpenSetEvaluation

CLASSIFIER = 'knn'
"""Default classifier of `tactile train`. The report compares its accuracy in all splits, and
evaluates the rejection of unknown objects with it, in both cases with its default scaling."""

FALSE_ALARM_RATE = 0.05
"""Rate of false rejection for which the rejection of unknown objects is calibrated [1]."""

_Result = TypeVar('_Result')


@dataclass(frozen=True)
class SetResult:
    """Results of the analyses of one set of trials.

    Attributes
    ----------
    evaluations : tuple of Evaluation
        The evaluation with random folds first, then one for each grouped split, then one for each
        pair of training and test trials that the user has selected.
    not_done : tuple of str
        One sentence for each analysis that these trials do not allow.
    open_set : OpenSetEvaluation or None
        Rejection of unknown objects; None if it was not requested, or the trials do not allow it.
    stated : Evaluation or None
        Accuracy of the chosen classifier on the test trials that the user has selected; None if
        the user has not selected any.
    permuted : PermutationBaseline or None
        Accuracy of the chosen classifier on permuted labels; None if it was not requested.
    curve : LearningCurve or None
        Accuracy of the chosen classifier against the number of training groups; None if there are
        too few groups.
    reliability : Reliability or None
        Calibration of the chosen classifier on held-out trials; None if it was not requested, or
        the trials do not allow it.
    """

    recordings: RecordingSet
    evaluations: tuple[Evaluation, ...]
    selections: tuple[SelectionResult, ...]
    significance: RankSum
    not_done: tuple[str, ...]
    open_set: OpenSetEvaluation | None = None
    stated: Evaluation | None = None
    permuted: PermutationBaseline | None = None
    curve: LearningCurve | None = None
    reliability: Reliability | None = None

    @property
    def headline(self) -> Score:
        """Accuracy of the model that `tactile train` would write, on trials not used to choose it.

        If the user has selected test trials, it is the accuracy on these. Otherwise, it is the
        nested accuracy of the automatic choice.
        """
        if self.stated is not None:
            return self.stated.scores[0]
        assert self.recordings.choice is not None
        return self.recordings.choice.choice.nested

    @property
    def tested(self) -> int:
        """Number of trials from which `headline` was computed; each trial is tested once."""
        return int(self.headline.confusion.sum())

    @property
    def chance(self) -> float:
        """Accuracy of a classifier that always predicts the most frequent label [1]."""
        return float(self.headline.confusion.sum(axis=1).max() / self.tested)

    @property
    def end_to_end(self) -> float:
        """Accuracy of `headline` if trials without features are counted as wrong [1]."""
        return self.headline.mean * self.tested / (self.tested + self.recordings.table.refused)

    @property
    def name(self) -> str:
        """Name of the contact; if it is not known, the title of the recordings."""
        return self.recordings.contact or self.recordings.title

    @property
    def of_holds(self) -> bool:
        """True if these are stiffness trials."""
        return self.recordings.table.task == PROTOCOL_STIFFNESS

    @property
    def plain(self) -> Evaluation:
        """The evaluation with random folds; if they are impossible, the first other evaluation."""
        return self.evaluations[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as a dictionary for JSON."""
        recordings, spec = self.recordings, self.recordings.table.spec
        return {
            'title': recordings.title,
            'task': recordings.table.task,
            'contact': recordings.contact,
            'simulated': recordings.simulated,
            'trials': len(recordings.table),
            'feature_set': spec.feature_set,
            'feature_parameters': dict(spec.parameters),
            'features': list(spec.names),
            'feature_choice': recordings.choice and recordings.choice.choice.to_dict(),
            'headline': self.headline.to_dict() if recordings.choice else None,
            'refused': recordings.table.refused,
            'end_to_end': self.end_to_end if recordings.choice else None,
            'permuted': self.permuted and self.permuted.to_dict(),
            'learning_curve': self.curve and self.curve.to_dict(),
            'reliability': self.reliability and self.reliability.to_dict(),
            'evaluations': [evaluation.to_dict() for evaluation in self.evaluations],
            'feature_selection': [selection.to_dict() for selection in self.selections],
            'rank_sum': {
                'labels': list(self.significance.labels),
                'strata': self.significance.strata,
                'counts': list(self.significance.counts),
                'least_p': self.significance.least_p,
                'mean_p': self.significance.mean_p.tolist(),
                'separation': self.significance.separation.tolist(),
                'p': self.significance.p.tolist() if self.of_holds else None,
                'auc': self.significance.auc.tolist() if self.of_holds else None,
            },
            'unknown_objects': self.open_set and self.open_set.to_dict(),
            'not_done': list(self.not_done),
            'prepared': list(recordings.steps),
            'skipped': list(recordings.skipped),
        }


Plans = dict[str, list[Plan[Any]]]
"""The planned analyses of one set of trials. Each key is the field of `SetResult` for the results
of these analyses."""


def _plan_set(
    recordings: RecordingSet,
    folds: int,
    repetitions: int | None,
    random_state: int,
    *,
    details: bool,
) -> tuple[Plans, list[str]]:
    """Return the analyses of one set, and a sentence for each analysis that is omitted."""
    table = recordings.table
    repetitions, saving = choose_repetitions(table, repetitions)
    not_done = [*([saving] if saving else []), *recordings.not_done]
    splits, impossible = _divide(recordings, folds, repetitions, random_state)
    not_done += impossible
    evaluated = (*splits, *recordings.splits)
    if not evaluated:
        raise EvaluationError(f'{recordings.title}: {"; ".join(impossible)}')
    plans: Plans = defaultdict(list)
    plans['evaluations'] = [AccuracyPlan(table, split) for split in evaluated]
    if recordings.choice is not None and recordings.choice.splits:
        _, classifier, scaling = recordings.choice.choice.chosen
        (split,) = recordings.choice.splits
        plans['stated'] = [AccuracyPlan(recordings.choice.table, split, [classifier], [scaling])]
    if recordings.choice is not None:
        plans['curve'] = _plan_curve(recordings.choice, saving, random_state, not_done)
    if details and recordings.choice is not None:
        plans['permuted'] = _plan_permutation(recordings.choice, folds, random_state)
        plans['reliability'] = _plan_reliability(recordings.choice)
    if details and saving:
        not_done.append(
            'feature selection: omitted, because the table is large; use --repetitions'
        )
    elif details:
        plans['selections'] = _plan_selection(table, splits, random_state, not_done)
    if recordings.unknown_objects:
        hold_out = next(iter(recordings.hold_out), ())
        plans['open_set'] = [Attempt(evaluate_unknown_objects, table, tuple(hold_out))]
    return plans, not_done


def _divide(
    recordings: RecordingSet, folds: int, repetitions: int, random_state: int
) -> tuple[list[Split], list[str]]:
    """Return random folds and grouped splits, and a sentence for each impossible split."""
    table, impossible = recordings.table, list[str]()
    stratified = partial(stratified_split, table, folds, repetitions, random_state)
    splits = _try('random folds', stratified, impossible)
    for columns in recordings.hold_out:
        name = f'one {" and ".join(map(plain_name, columns))} held out'
        splits += _try(name, partial(grouped_split, table, columns), impossible)
    return splits, impossible


def _plan_permutation(chosen: Chosen, folds: int, random_state: int) -> list[Plan[Any]]:
    """Return the analysis with permuted labels, in the split that tests the chosen classifier."""
    table, (_, classifier, scaling) = chosen.table, chosen.choice.chosen
    if chosen.splits:
        (split,) = chosen.splits
    elif chosen.columns:
        split = grouped_split(table, chosen.columns)
    else:
        split = stratified_split(table, folds, 1, random_state)
    return [Attempt(measure_permutation, table, split, classifier, scaling, random_state)]


def _plan_curve(
    chosen: Chosen, saving: str, random_state: int, not_done: list[str]
) -> list[Plan[Any]]:
    """Return the learning curve over the groups that the automatic choice has held out.

    If there are no groups, add the reason to ``not_done``.
    """
    if chosen.splits or saving:
        return []
    if not chosen.columns:
        not_done.append(
            'learning curve: impossible, because there are no sessions or other groups to hold out'
        )
        return []
    _, classifier, scaling = chosen.choice.chosen
    arguments = chosen.table, chosen.columns, classifier, scaling, random_state
    return [Attempt(measure_learning_curve, *arguments)]


def _plan_reliability(chosen: Chosen) -> list[Plan[Any]]:
    _, classifier, scaling = chosen.choice.chosen
    return [Attempt(cross_validate_reliability, chosen.table, chosen.columns, classifier, scaling)]


def _plan_selection(
    table: FeatureTable, splits: Sequence[Split], random_state: int, not_done: list[str]
) -> list[Plan[Any]]:
    from tactile_classifier.evaluation.feature_selection import SelectionPlan

    if table.values.shape[1] < 2:
        not_done.append('feature selection: impossible, because there is only one feature')
        return []
    plans: list[Plan[Any]] = []
    for split in splits:
        plan = partial(SelectionPlan, table, split, random_state=random_state)
        plans += _try(f'feature selection, {split.name}', plan, not_done)
    return plans


def evaluate_unknown_objects(table: FeatureTable, hold_out: Sequence[str]) -> OpenSetEvaluation:
    """Evaluate the rejection of unknown objects. Each label in turn is left out of the training.

    Trials that have equal values in all columns ``hold_out`` are held out together. If
    ``hold_out`` is empty, the folds are random.

    Raises `EvaluationError` when the trials do not allow it.
    """
    from tactile_classifier.evaluation.open_set import evaluate_open_set  # slow import

    try:
        return evaluate_open_set(
            table, CLASSIFIER, hold_out=hold_out, false_alarm_rate=FALSE_ALARM_RATE
        )
    except (TactileError, ClassifierError) as error:
        raise EvaluationError(str(error)) from error


def _try(name: str, work: Callable[[], _Result], not_done: list[str]) -> list[_Result]:
    """Return the result of ``work`` in a list.

    If the trials do not allow the work, return an empty list and add the reason to ``not_done``.
    """
    try:
        return [work()]
    except EvaluationError as error:
        not_done.append(f'{name}: {error}')
        return []


def _finish_set(
    recordings: RecordingSet, found: dict[str, list[Any]], not_done: Sequence[str]
) -> SetResult:
    table, not_done = recordings.table, list(not_done)

    def take(name: str, title: str) -> Any:
        """Return the result of an analysis, or None.

        If the analysis was tried and failed, add the reason to ``not_done``.
        """
        result = next(iter(found.get(name, ())), None)
        if not isinstance(result, EvaluationError):
            return result
        not_done.append(f'{title}: {result}')
        return None

    curve = take('curve', 'learning curve')
    permuted = take('permuted', 'permuted labels')
    reliability = take('reliability', 'calibration')
    open_set = take('open_set', 'unknown objects')
    return SetResult(
        recordings,
        tuple(found['evaluations']),
        tuple(result for results in found.get('selections', ()) for result in results),
        rank_sum_p_values(table.values, table.labels, find_strata(table), find_mountings(table)),
        tuple(not_done),
        open_set,
        stated=next(iter(found.get('stated', ())), None),
        permuted=permuted,
        curve=curve,
        reliability=reliability,
    )


def analyse(
    sets: Sequence[RecordingSet],
    *,
    folds: int,
    repetitions: int | None,
    random_state: int,
    details: bool = True,
    jobs: int | None = -1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[SetResult]:
    """Run all analyses of the report on each set of trials.

    Each set is evaluated with random folds and with its grouped splits.

    Parameters
    ----------
    folds, repetitions : int
        Number of random folds, and of repetitions; None selects the number of repetitions by the
        size of the table.
    details : bool
        Also run the slow analyses: permuted labels, calibration and feature selection.
    jobs : int
        Number of workers as in joblib; -1 for all cores.
    progress : callable
        Called with the number of finished tasks and the number of all tasks.

    Raises
    ------
    EvaluationError
        When the trials of a set do not allow any split.
    """
    planned = [_plan_set(each, folds, repetitions, random_state, details=details) for each in sets]
    work = [plan for plans, _ in planned for some in plans.values() for plan in some]
    results = iter(run_plans(work, jobs, progress))
    return [
        _finish_set(
            each,
            {name: [next(results) for _ in some] for name, some in plans.items()},
            not_done,
        )
        for each, (plans, not_done) in zip(sets, planned, strict=True)
    ]
