# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Early predictions: the stopping rule, its errors, and accuracy against seconds seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.stats import binom

from tactile_classifier.confidence.fit_calibration import (
    calibrate_stage,
    CalibratedStage,
    make_group_folds,
    score_held_out,
)
from tactile_classifier.confidence.fit_novelty import rank_of_sessions
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import default_scaling, on_one_thread
from tactile_classifier.evaluation.intervals import Result

Matrix = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

CONFIDENCE = 0.9
"""Probability that the bound holds, over the calibration trials that might have come [1]."""

THRESHOLDS = (
    *(0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.925, 0.95, 0.96, 0.97),
    *(0.98, 0.985, 0.99, 0.993, 0.995, 0.997, 0.998, 0.999, 0.9995, 0.9999),
)
"""Probabilities of an answer that a rule may ask for; fixed before any data is seen."""


def find_first_stop(confidence: Matrix, threshold: float) -> npt.NDArray[np.intp]:
    """Return the first stage at which each trial is decided; the number of stages where none.

    The confidence, shape (stages, trials), is the probability of the answer; negative: unknown.
    """
    decided = confidence >= threshold
    return np.where(decided.any(axis=0), decided.argmax(axis=0), len(confidence))


def fit_stop_threshold(
    confidence: Matrix,
    wrong: Flags,
    error_rate: float,
    session: npt.NDArray[np.intp] | None = None,
) -> float | None:
    """Return the lowest threshold whose early answers are proven good enough, if any is.

    Learn then test (Angelopoulos et al. 2021): for each of `THRESHOLDS`, the exact binomial test
    of "more than ``error_rate`` of the early answers are wrong", with Bonferroni's correction. An
    early answer is the first one of a trial that reaches the threshold, at whatever stage. The
    bound holds with probability `CONFIDENCE` for further trials that are drawn as these were,
    independently.

    Trials of one session are not independent. Where sessions are known, each has a lowest
    threshold from which on its own early answers keep ``error_rate``, and the one of
    `rank_of_sessions` bounds the result: it holds in ``rank / (count + 1)`` of new sessions.

    The confidence is as in `find_first_stop`, of trials that the models were not fitted on;
    ``wrong`` tells which answers are, shape (stages, trials); ``session`` is that of each trial.
    """
    lowest = 0.0
    if session is not None:
        needed = [
            _find_safe_threshold(confidence[:, session == i], wrong[:, session == i], error_rate)
            for i in np.unique(session)
        ]
        lowest = np.sort(needed)[rank_of_sessions(len(needed)) - 1]
    level = (1.0 - CONFIDENCE) / len(THRESHOLDS)
    for threshold in THRESHOLDS:
        mistakes = _find_mistakes(confidence, wrong, threshold)
        bound = binom.cdf(np.count_nonzero(mistakes), len(mistakes), error_rate)
        if threshold >= lowest and bound <= level:
            return threshold
    return None


def fit_rule(
    stages: Sequence[CalibratedStage], error_rate: float, session: npt.NDArray[np.intp] | None
) -> float | None:
    """Return the threshold of calibrated partial windows; see `fit_stop_threshold`."""
    confidence = np.stack([stage.confidence for stage in stages])
    return fit_stop_threshold(
        confidence, np.stack([stage.wrong for stage in stages]), error_rate, session
    )


def _find_safe_threshold(confidence: Matrix, wrong: Flags, error_rate: float) -> float:
    """Return the lowest threshold from which on a session keeps the error; infinite: none."""
    safe = np.inf
    for threshold in reversed(THRESHOLDS):
        mistakes = _find_mistakes(confidence, wrong, threshold)
        if len(mistakes) and mistakes.mean() > error_rate:
            break
        safe = threshold
    return safe


def _find_mistakes(confidence: Matrix, wrong: Flags, threshold: float) -> Flags:
    """Return whether each early answer is wrong."""
    stage = find_first_stop(confidence, threshold)
    early = np.flatnonzero(stage < len(confidence))
    return wrong[stage[early], early]


@dataclasses.dataclass(frozen=True)
class RuleEvaluation(Result):
    """Results of a stopping rule on trials that were held out.

    ``error_rate`` is the share of wrong answers that was asked for, ``early_error`` that among the
    trials decided before their window was full (0: none), ``worst_part_error`` that of the worst
    fold. ``early_share`` counts these trials, ``accuracy`` all right answers [all 1]. ``mean_s``
    is the mean time of signal behind an answer, ``full_s`` that of the full window [s]. For
    ``parts_without_rule`` folds the other trials proved no threshold.
    """

    error_rate: float
    early_share: float
    early_error: float
    worst_part_error: float
    accuracy: float
    mean_s: float
    full_s: float
    parts_without_rule: int


@dataclasses.dataclass(frozen=True)
class StoppingEvaluation(Result):
    """Early predictions on trials that were held out, under one split.

    ``accuracies`` are the shares of right answers [1] after so many ``seconds`` of signal; the
    last of these is the full window [s].
    """

    classifier: str
    scaling: str
    split: str
    trials: int
    seconds: tuple[float, ...]
    accuracies: tuple[float, ...]
    rules: tuple[RuleEvaluation, ...]


@on_one_thread
def evaluate_stopping(
    table: FeatureTable,
    partial: Mapping[int, FeatureTable],
    classifier: str,
    scaling: str = '',
    *,
    hold_out: Sequence[str] = ('session_id',),
    error_rates: Sequence[float] = (0.01, 0.05),
    false_alarm_rate: float = 0.05,
) -> StoppingEvaluation:
    """Hold out folds in turn; fit and calibrate on the others.

    Parameters
    ----------
    table : FeatureTable
        Full windows, of a known number of samples.
    partial : mapping of int to FeatureTable
        By samples seen: the first part of each window, trial by trial.
    classifier, scaling, hold_out
        As in `evaluate_open_set`.
    error_rates : sequence of float
        Shares of wrong early answers; a rule is made for each [1].
    false_alarm_rate : float
        Windows above the novelty threshold of this rate are not decided [1].

    Raises
    ------
    EvaluationError
        When the trials do not allow it.
    """
    scaling = scaling or default_scaling(table.task, classifier)
    counts = sorted(partial)
    if not counts:
        raise EvaluationError('there are no partial windows to decide on')
    stages = [partial[count] for count in counts]
    seconds = tuple(count / table.spec.rate_hz for count in (*counts, table.spec.sample_count))
    wrong = np.zeros((len(seconds), len(table)), dtype=bool)
    stop = np.zeros((len(error_rates), len(table)), dtype=np.intp)
    without = np.zeros(len(error_rates), dtype=int)
    try:
        outer = make_group_folds(table, hold_out)
        for i in np.unique(outer.fold):
            test = outer.fold == i
            inner = make_group_folds(table.take(~test), hold_out)
            held_out = [
                calibrate_stage(stage.take(~test), classifier, scaling, inner, false_alarm_rate)
                for stage in stages
            ]
            confidence = np.zeros((len(stages), int(test.sum())))
            for j, (stage, calibrated) in enumerate(zip(stages, held_out, strict=True)):
                scores, true = score_held_out(stage, test, classifier, scaling)
                wrong[j, test] = scores.argmax(axis=1) != true
                novelty = calibrated.novelty.compute(stage.values[test])
                confidence[j] = calibrated.calibration.compute(scores).max(axis=1)
                confidence[j, novelty > calibrated.novelty_threshold] = -1.0
            scores, true = score_held_out(table, test, classifier, scaling)
            wrong[-1, test] = scores.argmax(axis=1) != true
            for r, rate in enumerate(error_rates):
                threshold = fit_rule(held_out, rate, inner.session)
                without[r] += threshold is None
                found = np.full(len(confidence[0]), len(stages))
                stop[r, test] = (
                    found if threshold is None else find_first_stop(confidence, threshold)
                )
    except (DatasetError, ValueError) as error:
        raise EvaluationError(f'the trials do not allow it: {error}') from error
    return StoppingEvaluation(
        classifier=classifier,
        scaling=scaling,
        split=outer.split,
        trials=len(table),
        seconds=seconds,
        accuracies=tuple(float(1.0 - missed.mean()) for missed in wrong),
        rules=tuple(
            _count(rate, stop[r], wrong, np.array(seconds), outer.fold, int(without[r]))
            for r, rate in enumerate(error_rates)
        ),
    )


def _count(
    rate: float,
    stop: npt.NDArray[np.intp],
    wrong: Flags,
    seconds: Matrix,
    fold: npt.NDArray[np.intp],
    without: int,
) -> RuleEvaluation:
    mistaken = wrong[stop, np.arange(len(stop))]
    early = stop < len(seconds) - 1
    errors = [mistaken[early & (fold == i)].mean() for i in np.unique(fold[early])]
    return RuleEvaluation(
        error_rate=rate,
        early_share=float(early.mean()),
        early_error=float(mistaken[early].mean()) if early.any() else 0.0,
        worst_part_error=float(max(errors, default=0.0)),
        accuracy=float(1.0 - mistaken.mean()),
        mean_s=float(seconds[stop].mean()),
        full_s=float(seconds[-1]),
        parts_without_rule=without,
    )
