# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""When an early prediction is sure enough, at a stated share of wrong answers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import binom

from tactile_classifier.confidence.novelty import rank_of_sessions

CONFIDENCE = 0.9
"""Probability that the bound holds, over the calibration trials that might have come [1]."""

THRESHOLDS = (
    *(0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.925, 0.95, 0.96, 0.97),
    *(0.98, 0.985, 0.99, 0.993, 0.995, 0.997, 0.998, 0.999, 0.9995, 0.9999),
)
"""Probabilities of an answer that a rule may ask for; fixed before any data is seen."""

Matrix = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def find_first_stop(confidence: Matrix, threshold: float) -> npt.NDArray[np.intp]:
    """Return the first stage at which each trial is decided; the number of stages where none.

    The confidence, shape (stages, trials), is the probability of the answer; negative where the
    window is rejected as unknown.
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

    Learn then test (Angelopoulos et al. 2021): for each of `THRESHOLDS`, the exact binomial
    test of "more than ``error_rate`` of the early answers are wrong", with
    Bonferroni's correction for their number; the same as a one-sided Clopper-Pearson bound
    at most ``error_rate``. An early answer is the first one of a trial that reaches the
    threshold, at whatever stage. The bound holds with probability `CONFIDENCE`
    for further trials that are drawn as these were, independently.

    Trials of one session are not independent. Where sessions are known, the threshold is no
    lower than the one that keeps the error in most of them: each session has a lowest threshold
    from which on its own early answers keep ``error_rate``, and of these the one of
    `rank_of_sessions` counts. It holds in ``rank / (count + 1)`` of new sessions.

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
