# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""How unlike all training trials a window is, whatever the classifier."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
from sklearn.covariance import ledoit_wolf

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class NoveltyMeasure:
    """Distance to the nearest training trial, against what is usual for that trial's label.

    Features are whitened by the covariance of the trials about the mean of their
    own label, shrunk after Ledoit and Wolf (2004): what differs between trials of one
    thing counts little, what hardly ever differs counts much. The distance is divided by
    the median distance that trials of the same label have to the nearest of another
    part of the training. Mounting and temperature are in both as far as the training has
    several sessions.

    Attributes
    ----------
    centre : ndarray of shape (k,)
        Mean of all training trials, in the features' units.
    whitening : ndarray of shape (k, k)
    references : ndarray of shape (trials, k)
        The training trials, whitened.
    usual : ndarray of shape (trials,)
        What the distance to each of them is divided by.
    """

    centre: Matrix
    whitening: Matrix
    references: Matrix
    usual: Matrix

    @classmethod
    def fit(cls, values: Matrix, labels: npt.NDArray[np.str_], fold: Indices) -> NoveltyMeasure:
        """Return the measure for training trials.

        A feature that never varies within a label has no scale and does not count.

        Parameters
        ----------
        values : ndarray of shape (trials, k)
        labels : ndarray of str, shape (trials,)
        fold : ndarray of int, shape (trials,)
            Part that each trial belongs to, such as its session.
        """
        classes, owner = np.unique(labels, return_inverse=True)
        means = np.stack([values[owner == i].mean(axis=0) for i in range(len(classes))])
        residuals = values - means[owner]
        spread = np.sqrt((residuals**2).mean(axis=0))
        # Rounding of the mean is no spread.
        varies = spread > 1e-12 * np.abs(values).max(axis=0)
        whitening = np.zeros((values.shape[1], values.shape[1]))
        if varies.any():
            shrunk = ledoit_wolf(residuals[:, varies] / spread[varies], assume_centered=True)[0]
            size, directions = np.linalg.eigh(shrunk)
            used = np.ix_(varies, varies)
            whitening[used] = directions / np.sqrt(size) / spread[varies][:, np.newaxis]
        centre = values.mean(axis=0)
        references = (values - centre) @ whitening
        usual = [
            _usual_distance(references[owner == i], fold[owner == i]) for i in range(len(classes))
        ]
        return cls(centre, whitening, references, np.array(usual)[owner])

    def compute(self, values: Matrix) -> Matrix:
        """Return the novelty of windows of shape (windows, k), one a window [1]."""
        distance = _distances((values - self.centre) @ self.whitening, self.references)
        nearest = distance.argmin(axis=1)
        return np.asarray(distance[np.arange(len(distance)), nearest] / self.usual[nearest])


def _distances(rows: Matrix, references: Matrix) -> Matrix:
    squares = (rows**2).sum(axis=1)[:, np.newaxis] + (references**2).sum(axis=1)
    squares -= 2.0 * rows @ references.T
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _usual_distance(references: Matrix, fold: Indices) -> float:
    """Return the median distance to the nearest of another part, or of all if there is one part.

    1 where all trials are the same.
    """
    distance = _distances(references, references)
    same = fold[:, np.newaxis] == fold
    distance[np.eye(len(fold), dtype=bool) if same.all() else same] = np.inf
    nearest = distance.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    usual = float(np.median(nearest)) if len(nearest) else 0.0
    return usual if usual > 0.0 else 1.0


def trials_needed(rate: float) -> int:
    """Return how many calibration trials a conformal threshold at a rate needs at least."""
    return math.ceil(round(1.0 / rate, 9)) - 1


def compute_threshold(novelty: Matrix, false_alarm_rate: float) -> float:
    """Return the conformal threshold of calibration trials of known labels.

    The ``ceil((n + 1) * (1 - rate))``-th smallest of ``n`` novelties: a further trial,
    exchangeable with them, lies above it with at most that probability (split conformal
    prediction: Vovk, Gammerman and Shafer 2005; Lei et al. 2018).

    Parameters
    ----------
    novelty : ndarray of shape (trials,)
        Of trials that the measure was not fitted on.
    false_alarm_rate : float
        Between 0 and 1 [1].

    Raises
    ------
    ValueError
        When there are fewer trials than `trials_needed`.
    """
    if len(novelty) < trials_needed(false_alarm_rate):
        raise ValueError(
            f'{len(novelty)} trials cannot bound false alarms at {false_alarm_rate:g}; '
            f'{trials_needed(false_alarm_rate)} are needed'
        )
    rank = math.ceil(round((len(novelty) + 1) * (1.0 - false_alarm_rate), 9))
    return float(np.sort(novelty)[rank - 1])
