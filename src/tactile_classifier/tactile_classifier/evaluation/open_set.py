# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rejection of unknown objects: each label is left out of the training once."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.fit_calibration import (
    calibrate_held_out,
    compute_calibration_error,
    compute_uncalibrated,
    fit_novelty,
    make_group_folds,
    RANDOM,
    score_held_out,
)
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import default_scaling, on_one_thread, SCORE_KINDS
from tactile_classifier.evaluation.auroc import auroc_interval, rank_novelty, Ranking
from tactile_classifier.evaluation.intervals import Interval, Result


@dataclasses.dataclass(frozen=True)
class UnknownLabel(Result):
    """Rejection of the trials of one label that was left out of the training.

    ``auroc`` is the probability that a trial of this label is more novel than a trial of a known
    label, averaged over the folds. ``interval`` is the interval of ``auroc`` (see
    `auroc_interval`). ``miss_rate`` is the fraction of trials of this label that receive a known
    label [1].
    """

    label: str
    auroc: float
    interval: Interval
    miss_rate: float
    trials: int


@dataclasses.dataclass(frozen=True)
class OpenSetEvaluation(Result):
    """Rejection of unknown labels and calibration of scores for one split.

    Attributes
    ----------
    split, calibration_split : str
        Description of how trials were held out for testing, and how trials were held out from the
        training trials for calibration.
    false_alarm_rate : float
        Requested fraction of trials of known labels that may be rejected [1].
    realised_false_alarm_rate : float
        Fraction of held-out trials of known labels that were rejected [1].
    group_false_alarm_rates : tuple of float
        ``realised_false_alarm_rate`` of each fold [1].
    accuracy : float
        Fraction of correct predictions among the trials that were not rejected [1].
    auroc : float
        Mean over labels and folds [1]; ``auroc_interval`` is its interval.
    miss_rate : float
        Mean over ``unknown`` [1].
    unknown : tuple of UnknownLabel
    calibration_error_before, calibration_error_after : float
        Expected calibration error on held-out trials, before and after calibration [1].
    """

    classifier: str
    scaling: str
    split: str
    calibration_split: str
    trials: int
    false_alarm_rate: float
    realised_false_alarm_rate: float
    group_false_alarm_rates: tuple[float, ...]
    accuracy: float
    auroc: float
    auroc_interval: Interval
    miss_rate: float
    unknown: tuple[UnknownLabel, ...]
    calibration_error_before: float
    calibration_error_after: float


@on_one_thread
def evaluate_open_set(
    table: FeatureTable,
    classifier: str,
    scaling: str = '',
    *,
    hold_out: Sequence[str] = ('session_id',),
    false_alarm_rate: float = 0.05,
    strict: bool = False,
) -> OpenSetEvaluation:
    """Test each fold with models that are fitted to the other folds, and each label as unknown.

    Tested trials are used neither for fitting nor for calibration: the threshold and the
    probabilities are computed from folds inside the training trials.

    Parameters
    ----------
    table : FeatureTable
        Table with at least three labels.
    classifier, scaling : str
        See `build_estimator`; an empty scaling selects the default of the task.
    hold_out : sequence of str
        Columns; trials with equal values in all columns are held out together, see
        `make_group_folds`. If this is not possible, trials are divided at random, which ``split``
        states.
    false_alarm_rate : float
        Fraction of trials of known labels that may be rejected [1].
    strict : bool
        Use the strict threshold of `HeldOutNovelty.compute_threshold`.

    Raises
    ------
    EvaluationError
        If there are too few labels or trials, or a label is never held out together with another
        label.
    """
    scaling = scaling or default_scaling(table.task, classifier)
    labels = np.unique(table.labels)
    if len(labels) < 3:
        raise EvaluationError(
            f'there are {len(labels)} labels; with one left out as unknown, two must remain'
        )
    try:
        outer = make_group_folds(table, hold_out)
        folds = [
            _evaluate_fold(
                table, outer.fold == i, classifier, scaling, hold_out, false_alarm_rate, strict
            )
            for i in np.unique(outer.fold)
        ]
    except DatasetError as error:
        raise EvaluationError(f'the trials do not allow it: {error}') from error
    except ValueError as error:
        raise EvaluationError(str(error)) from error
    rejected, right, before, after, true, unknown, splits = zip(*folds, strict=True)
    all_true, all_right = np.concatenate(true), np.concatenate(right)
    kept = ~np.concatenate(rejected)
    # If folds hold out repeated conditions, the trials of a fold are not independent.
    groups_are = '' if outer.split.startswith(RANDOM) else 'held-out folds'
    found = tuple(_pool_unknown(str(label), unknown, outer.split, groups_are) for label in labels)
    rankings = [[each.ranking for each in fold.values()] for fold in unknown]
    return OpenSetEvaluation(
        classifier=classifier,
        scaling=scaling,
        split=outer.split,
        calibration_split=' or '.join(dict.fromkeys(splits)),
        trials=len(table),
        false_alarm_rate=false_alarm_rate,
        realised_false_alarm_rate=float(1.0 - kept.mean()),
        group_false_alarm_rates=tuple(float(each.mean()) for each in rejected),
        accuracy=float(all_right[kept].mean()) if kept.any() else 0.0,
        auroc=float(np.mean([ranking.auroc for fold in rankings for ranking in fold])),
        auroc_interval=auroc_interval(rankings, groups_are),
        miss_rate=float(np.mean([label.miss_rate for label in found])),
        unknown=found,
        calibration_error_before=compute_calibration_error(np.concatenate(before), all_true),
        calibration_error_after=compute_calibration_error(np.concatenate(after), all_true),
    )


class _Part(NamedTuple):
    """Results of one fold; the arrays have one entry for each tested trial."""

    rejected: npt.NDArray[np.bool_]
    right: npt.NDArray[np.bool_]
    before: npt.NDArray[np.float64]
    after: npt.NDArray[np.float64]
    true: npt.NDArray[np.intp]
    unknown: dict[str, _LeftOut]
    calibration_split: str


class _LeftOut(NamedTuple):
    """A label that was left out of the training: ranking, and True for trials not rejected."""

    ranking: Ranking
    is_missed: npt.NDArray[np.bool_]


def _evaluate_fold(
    table: FeatureTable,
    held_out: npt.NDArray[np.bool_],
    classifier: str,
    scaling: str,
    columns: Sequence[str],
    rate: float,
    strict: bool,
) -> _Part:
    train, test = table.take(~held_out), table.take(held_out)
    inner = make_group_folds(train, columns)
    calibrated = calibrate_held_out(train, classifier, scaling, inner, rate, strict=strict)
    scores, true = score_held_out(table, held_out, classifier, scaling)
    before = compute_uncalibrated(scores, SCORE_KINDS[classifier])
    unknown = {}
    for label in np.unique(test.labels):
        others = train.take(train.labels != label)
        measure, known = fit_novelty(others, make_group_folds(others, columns))
        threshold = known.compute_threshold(rate, strict=strict)
        is_new = test.labels == label
        if is_new.all():
            continue
        novelty = measure.compute(test.values)
        ranking = rank_novelty(str(label), is_new, novelty)
        unknown[str(label)] = _LeftOut(ranking, novelty[is_new] <= threshold)
    return _Part(
        rejected=calibrated.novelty.compute(test.values) > calibrated.novelty_threshold,
        right=scores.argmax(axis=1) == true,
        before=before,
        after=calibrated.calibration.compute(scores),
        true=true,
        unknown=unknown,
        calibration_split=inner.split,
    )


def _pool_unknown(
    label: str, folds: Sequence[dict[str, _LeftOut]], split: str, groups_are: str
) -> UnknownLabel:
    found = [fold[label] for fold in folds if label in fold]
    if not found:
        raise EvaluationError(
            f'the trials do not allow it: label "{label}" is never held out together with '
            f'another one ({split}), so no known label remains to compare with; record several '
            'labels in each session, or hold out by another column'
        )
    missed = np.concatenate([each.is_missed for each in found])
    return UnknownLabel(
        label,
        float(np.mean([each.ranking.auroc for each in found])),
        auroc_interval([[each.ranking] for each in found], groups_are),
        float(missed.mean()),
        len(missed),
    )
