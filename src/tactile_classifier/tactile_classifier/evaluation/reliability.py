# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reliability of held-out probabilities: comparison of stated probabilities with accuracy."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.fit_calibration import (
    binned_error,
    BINS,
    find_bins,
    hold_out_probabilities,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ClassifierError, EvaluationError
from tactile_classifier.estimators.classifiers import RANDOM_STATE
from tactile_classifier.evaluation.intervals import accuracy_interval, Interval, Result

DRAWS = 200
"""Number of random draws that estimate the calibration error of perfect probabilities."""


@dataclasses.dataclass(frozen=True)
class ReliabilityBin(Result):
    """Predictions whose probability is in one bin.

    ``stated`` is the mean of their probabilities, and ``right`` the fraction that is correct [1].
    ``interval`` is the interval of ``right``; it assumes that trials are independent.
    """

    trials: int
    stated: float
    right: float
    interval: Interval


@dataclasses.dataclass(frozen=True)
class Reliability(Result):
    """Calibration of the probabilities of predictions on held-out trials.

    Attributes
    ----------
    split : str
        Description of how the trials were held out.
    trials : int
        Number of held-out trials.
    error : float
        Expected calibration error over ten bins of equal width [1].
    chance_error : float
        Mean of this error if the same probabilities were perfectly calibrated, for the same number
        of trials [1].
    bins : tuple of ReliabilityBin
        The bins that contain predictions, by increasing probability.
    """

    classifier: str
    scaling: str
    split: str
    trials: int
    error: float
    chance_error: float
    bins: tuple[ReliabilityBin, ...]


def measure_reliability(
    stated: npt.NDArray[np.float64],
    is_right: npt.NDArray[np.bool_],
    classifier: str = '',
    scaling: str = '',
    split: str = '',
) -> Reliability:
    """Measure the reliability of the probabilities of some predictions.

    Parameters
    ----------
    stated : ndarray of shape (trials,)
        Probability of each prediction [1].
    is_right : ndarray of bool, shape (trials,)
    classifier, scaling, split : str
        See `Reliability`.
    """
    rng = np.random.default_rng(RANDOM_STATE)
    drawn = rng.random((DRAWS, len(stated))) < stated
    bins = find_bins(stated)
    return Reliability(
        classifier,
        scaling,
        split,
        len(stated),
        binned_error(stated, is_right),
        float(np.mean([binned_error(stated, each) for each in drawn])),
        tuple(
            ReliabilityBin(
                int(inside.sum()),
                float(stated[inside].mean()),
                float(is_right[inside].mean()),
                accuracy_interval(is_right[inside], 'trials'),
            )
            for inside in (bins == i for i in range(BINS))
            if inside.any()
        ),
    )


def cross_validate_reliability(
    table: FeatureTable, columns: Sequence[str], classifier: str, scaling: str
) -> Reliability:
    """Return the reliability of one classifier on held-out folds.

    As for a model card, the scores of a fold are computed by a model that is fitted to the other
    folds, and the calibration is fitted to the held-out scores of the other folds.

    Parameters
    ----------
    columns : sequence of str
        Trials that agree in these are held out together; see `make_group_folds`.

    Raises
    ------
    EvaluationError
        If the trials do not allow it.
    """
    try:
        folds = make_group_folds(table, columns)
        scores, true = hold_out_scores(table, classifier, scaling, folds.fold)
    except (ClassifierError, ValueError) as error:
        raise EvaluationError(str(error)) from error
    probabilities = hold_out_probabilities(scores, true, folds.fold)
    is_right = probabilities.argmax(axis=1) == true
    return measure_reliability(
        probabilities.max(axis=1), is_right, classifier, scaling, folds.split
    )
