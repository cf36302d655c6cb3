# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All analyses of the report on one set of trials, as parts of one list of work."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TYPE_CHECKING, TypeVar

from tactile_analysis.report.answers import answer, Answers
from tactile_analysis.report.recordings import RecordingSet
from tactile_classifier.datasets.conditions import find_mountings, find_strata
from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import (
    choose_repetitions,
    grouped_split,
    Split,
    stratified_split,
)
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.cross_validation import AccuracyPlan, Evaluation, Score
from tactile_classifier.evaluation.learning_curve import LearningCurve, measure_learning_curve
from tactile_classifier.evaluation.permutation import measure_permutation, PermutationBaseline
from tactile_classifier.evaluation.plans import Attempt, Plan, run_plans
from tactile_classifier.evaluation.reliability import cross_validate_reliability, Reliability
from tactile_classifier.evaluation.significance import rank_sum_p_values, RankSum
from tactile_features.types import PROTOCOL_STIFFNESS

if TYPE_CHECKING:
    from tactile_analysis.datasets.automatic_features import Chosen
    from tactile_classifier.evaluation.feature_selection import SelectionResult

_Result = TypeVar('_Result')


@dataclass(frozen=True)
class SetResult:
    """Results of the analyses of one set of trials.

    Attributes
    ----------
    evaluations : tuple of Evaluation
        Random folds first, then one for each grouped split, then one for each stated split.
    not_done : tuple of str
        One sentence for each analysis that the trials do not allow.
    answers : Answers or None
        None where they were not requested.
    stated : Evaluation or None
        The chosen classifier on the stated trials to test on, if there are any.
    permuted : PermutationBaseline or None
        Accuracy of the chosen classifier on permuted labels; None where it was not requested.
    curve : LearningCurve or None
        Accuracy of the chosen classifier against the number of training groups; None where there
        are no groups to hold out, or too few.
    reliability : Reliability or None
        Calibration of the chosen classifier on held-out trials; None where it was not requested,
        or the trials do not allow it.
    """

    recordings: RecordingSet
    evaluations: tuple[Evaluation, ...]
    selections: tuple[SelectionResult, ...]
    significance: RankSum
    not_done: tuple[str, ...]
    answers: Answers | None = None
    stated: Evaluation | None = None
    permuted: PermutationBaseline | None = None
    curve: LearningCurve | None = None
    reliability: Reliability | None = None

    @property
    def headline(self) -> Score:
        """The score of the model that `tactile train` would write, by trials that did not choose.

        It is the nested one of the choice, or on the stated trials to test on.
        """
        if self.stated is not None:
            return self.stated.scores[0]
        assert self.recordings.choice is not None
        return self.recordings.choice.choice.nested

    @property
    def tested(self) -> int:
        """Number of trials that the headline counts; each is tested once."""
        return int(self.headline.confusion.sum())

    @property
    def chance(self) -> float:
        """Accuracy of always naming the commonest label of these trials [1]."""
        return float(self.headline.confusion.sum(axis=1).max() / self.tested)

    @property
    def end_to_end(self) -> float:
        """The accuracy of the headline with refused trials counted as wrong [1]."""
        return self.headline.mean * self.tested / (self.tested + self.recordings.table.refused)

    @property
    def name(self) -> str:
        """The contact, or else the title of the recordings."""
        return self.recordings.contact or self.recordings.title

    @property
    def of_holds(self) -> bool:
        """Whether these are stiffness trials."""
        return self.recordings.table.task == PROTOCOL_STIFFNESS

    @property
    def plain(self) -> Evaluation:
        """The evaluation by random folds; the first other one where these cannot be made."""
        return self.evaluations[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
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
            'answers': self.answers and self.answers.to_dict(),
            'not_done': list(self.not_done),
            'prepared': list(recordings.steps),
            'skipped': list(recordings.skipped),
        }


Plans = dict[str, list[Plan[Any]]]
"""By the field of `SetResult` that comes of them."""


def _plan_set(
    recordings: RecordingSet,
    folds: int,
    repetitions: int | None,
    random_state: int,
    *,
    details: bool,
) -> tuple[Plans, list[str]]:
    """Return the work on one set, and a sentence for each analysis that is left out."""
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
        not_done.append('feature selection: left out of a large table without --repetitions')
    elif details:
        plans['selections'] = _plan_selection(table, splits, random_state, not_done)
    if recordings.answers:
        hold_out = next(iter(recordings.hold_out), ())
        plans['answers'] = [Attempt(answer, table, tuple(hold_out))]
    return plans, not_done


def _divide(
    recordings: RecordingSet, folds: int, repetitions: int, random_state: int
) -> tuple[list[Split], list[str]]:
    """Return random folds and grouped splits, and a sentence for each that cannot be done."""
    table, impossible = recordings.table, list[str]()
    stratified = partial(stratified_split, table, folds, repetitions, random_state)
    splits = _try('random folds', stratified, impossible)
    for columns in recordings.hold_out:
        name = f'one {" and ".join(map(plain_name, columns))} held out'
        splits += _try(name, partial(grouped_split, table, columns), impossible)
    return splits, impossible


def _plan_permutation(chosen: Chosen, folds: int, random_state: int) -> list[Plan[Any]]:
    """Return the baseline under the split that tests the choice."""
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
    """Return the learning curve over the groups that were held out for the choice."""
    if chosen.splits or saving:
        return []
    if not chosen.columns:
        not_done.append('learning curve: there are no sessions or other groups to hold out')
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
        not_done.append('feature selection: there is one feature only')
        return []
    plans: list[Plan[Any]] = []
    for split in splits:
        plan = partial(SelectionPlan, table, split, random_state=random_state)
        plans += _try(f'feature selection, {split.name}', plan, not_done)
    return plans


def _try(name: str, work: Callable[[], _Result], not_done: list[str]) -> list[_Result]:
    """Return the result; none, and a sentence more, where the trials do not allow it."""
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
        """Return the result; None where there is none, and the reason if it was attempted."""
        result = next(iter(found.get(name, ())), None)
        if not isinstance(result, EvaluationError):
            return result
        not_done.append(f'{title}: {result}')
        return None

    curve = take('curve', 'learning curve')
    permuted = take('permuted', 'permuted labels')
    reliability = take('reliability', 'calibration')
    answers = take('answers', 'unknown objects')
    return SetResult(
        recordings,
        tuple(found['evaluations']),
        tuple(result for results in found.get('selections', ()) for result in results),
        rank_sum_p_values(table.values, table.labels, find_strata(table), find_mountings(table)),
        (*not_done, *(answers.not_done if answers else ())),
        answers,
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
    """Evaluate all sets under plain folds and their grouped splits.

    Sets with extras also get what a model says besides a label, under the first grouped split.
    Without ``details`` accuracies only: no feature selection.

    ``not_done`` names the splits and analyses that the trials do not allow.

    Raises
    ------
    EvaluationError
        When the trials of a set allow no split.
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
