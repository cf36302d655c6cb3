# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Early predictions: accuracy against seconds seen, and the stopping rule's errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import (
    calibrate_stage,
    make_group_folds,
    score_held_out,
)
from tactile_classifier.confidence.stopping import find_first_stop, fit_stop_threshold
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import default_scaling, on_one_thread
from tactile_classifier.evaluation.intervals import Result

Matrix = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class RuleEvaluation(Result):
    """Results of a stopping rule on trials that were held out.

    ``error_rate`` is the share of wrong answers that was asked for; ``early_error`` is that among
    the trials which were decided before their window was full, 0 when there are none, and
    ``worst_part_error`` that of the worst fold. ``early_share`` counts these trials, and
    ``accuracy`` the right answers, early or at the end [all 1]. ``mean_s`` is the mean time of
    signal behind an answer, ``full_s`` that of the full window [s]. For ``parts_without_rule``
    folds the other trials proved no threshold.
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
                threshold = fit_stop_threshold(
                    np.stack([calibrated.confidence for calibrated in held_out]),
                    np.stack([calibrated.wrong for calibrated in held_out]),
                    rate,
                    inner.session,
                )
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
