# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy of trained models on labelled trials, and the difference between two models."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.evaluation.intervals import (
    accuracy_interval,
    difference_interval,
    Interval,
    Result,
)
from tactile_classifier.types import NO_ANSWER, UNKNOWN

Names = npt.NDArray[np.str_]


@dataclasses.dataclass(frozen=True)
class ModelAccuracy(Result):
    """Predictions of one model on labelled trials.

    Attributes
    ----------
    accuracy : float
        Fraction of the trials whose label was predicted [1]. ``unknown`` and ``no answer`` count
        as wrong.
    interval : Interval
        Interval of the accuracy, over sessions if there are several, otherwise over trials.
    unknown_rate, no_answer_rate : float
        Fraction of the trials with the prediction ``unknown``, and fraction of the trials without
        features or finite scores [1].
    answered_accuracy : float or None
        Fraction of correct predictions among the predictions that are labels [1]; None if no
        prediction is a label.
    """

    accuracy: float
    interval: Interval
    unknown_rate: float
    no_answer_rate: float
    answered_accuracy: float | None


@dataclasses.dataclass(frozen=True)
class AccuracyDifference(Result):
    """Difference between models A and B on the same trials.

    Attributes
    ----------
    difference : float
        Accuracy of B minus accuracy of A [1].
    interval : Interval
        Interval of the difference, over sessions.
    only_a, only_b : int
        Trials whose label was predicted by only this model.
    p_value : float
        Exact McNemar test of these two counts, two-sided [1]. Trials count as independent.
    """

    difference: float
    interval: Interval
    only_a: int
    only_b: int
    p_value: float


def score_predictions(labels: Names, predicted: Names, sessions: Names | None) -> ModelAccuracy:
    """Return the accuracy of the predictions on some trials.

    Parameters
    ----------
    labels, predicted : ndarray of str, shape (trials,)
        Predictions are labels, `UNKNOWN` or `NO_ANSWER`. At least one trial.
    sessions : ndarray of str, shape (trials,), or None
        Session of each trial; None if unknown.
    """
    is_correct = predicted == labels
    is_label = ~np.isin(predicted, (UNKNOWN, NO_ANSWER))
    interval = _interval_over_sessions(is_correct, sessions, accuracy_interval)
    return ModelAccuracy(
        accuracy=float(is_correct.mean()),
        interval=interval or accuracy_interval(is_correct, 'trials'),
        unknown_rate=float((predicted == UNKNOWN).mean()),
        no_answer_rate=float((predicted == NO_ANSWER).mean()),
        answered_accuracy=float(is_correct[is_label].mean()) if is_label.any() else None,
    )


def compare_predictions(
    labels: Names, predicted_a: Names, predicted_b: Names, sessions: Names | None
) -> AccuracyDifference:
    """Return the difference between two models on the same trials; see `score_predictions`."""
    from scipy.stats import binomtest  # slow to import

    gain = (predicted_b == labels).astype(np.float64) - (predicted_a == labels)
    only_a, only_b = int((gain < 0).sum()), int((gain > 0).sum())
    discordant = only_a + only_b
    interval = _interval_over_sessions(gain, sessions, difference_interval)
    return AccuracyDifference(
        difference=float(gain.mean()),
        interval=interval or Interval(0.0, 0.0, '', 'all trials are of one session'),
        only_a=only_a,
        only_b=only_b,
        p_value=float(binomtest(only_b, discordant).pvalue) if discordant else 1.0,
    )


def _interval_over_sessions(
    values: npt.NDArray[np.float64] | npt.NDArray[np.bool_],
    sessions: Names | None,
    interval: Callable[..., Interval],
) -> Interval | None:
    """Return the interval of the mean over trials, computed from the means of the sessions.

    Returns None if there are fewer than two sessions.
    """
    names, owner = np.unique([] if sessions is None else sessions, return_inverse=True)
    if len(names) < 2:
        return None
    sizes = np.bincount(owner)
    return interval(np.bincount(owner, values) / sizes, 'sessions', sizes)
