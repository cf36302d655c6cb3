# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Novelty: the distance of a window to the training trials, whatever the classifier."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
from sklearn.covariance import ledoit_wolf

from tactile_classifier.errors import TooFewTrialsError

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

METRICS = ('whitened', 'scaled', 'plain')
"""Spaces that distances are taken in. Whitened by the covariance of the trials about the mean of
their own label, shrunk after Ledoit and Wolf (2004): what differs between trials of one thing
counts little, what hardly ever differs counts much. Scaled: the same feature by feature. Plain:
the features as they are, which is right where all are amplitudes of one unit and noise is even.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class NoveltyMeasure:
    """Distance to the nearest training trial, in units of the usual distance within its label.

    The distance is divided by the median distance that trials of the same label have to the
    nearest of another fold of the training, such as another session.

    Attributes
    ----------
    centre : ndarray of shape (k,)
        Mean of all training trials, in the features' units.
    transform : ndarray of shape (k, k)
        From features to the space of the distance; see `METRICS`.
    references : ndarray of shape (trials, k)
        The training trials in that space.
    scale : ndarray of shape (trials,)
        What the distance to each of them is divided by.
    metric : str
        One of `METRICS`.
    """

    centre: Matrix
    transform: Matrix
    references: Matrix
    scale: Matrix
    metric: str

    @classmethod
    def fit(
        cls, values: Matrix, labels: npt.NDArray[np.str_], fold: Indices, metric: str = 'whitened'
    ) -> NoveltyMeasure:
        """Return the measure for training trials.

        A feature that never varies within a label has no scale and does not count.

        Parameters
        ----------
        values : ndarray of shape (trials, k)
        labels : ndarray of str, shape (trials,)
        fold : ndarray of int, shape (trials,)
            Fold that each trial belongs to, such as its session.
        metric : str
            One of `METRICS`.
        """
        classes, owner = np.unique(labels, return_inverse=True)
        centre = values.mean(axis=0)
        transform = _fit_transform(values, owner, metric)
        references = (values - centre) @ transform
        scales = [
            _median_distance(references[owner == i], fold[owner == i]) for i in range(len(classes))
        ]
        return cls(centre, transform, references, np.array(scales)[owner], metric)

    def compute(self, values: Matrix) -> Matrix:
        """Return the novelty of windows of shape (windows, k), one a window [1]."""
        return self._nearest(_distances((values - self.centre) @ self.transform, self.references))

    def compute_without(self, values: Matrix, labels: npt.NDArray[np.str_], label: str) -> Matrix:
        """Return the novelty as if the trials of one label had not been there.

        Parameters
        ----------
        values : ndarray of shape (windows, k)
        labels : ndarray of str, shape (trials,)
            Of the training trials.
        label : str
        """
        distance = _distances((values - self.centre) @ self.transform, self.references)
        distance[:, labels == label] = np.inf
        return self._nearest(distance)

    def _nearest(self, distance: Matrix) -> Matrix:
        nearest = distance.argmin(axis=1)
        return np.asarray(distance[np.arange(len(distance)), nearest] / self.scale[nearest])


def choose_metric(values: Matrix, labels: npt.NDArray[np.str_], fold: Indices) -> str:
    """Return the metric that best tells trials of one label when it is left out.

    On the training alone: folds are held out in turn, and in each fold every label once has
    no training trials; the area under the receiver operating characteristic, averaged,
    decides. Of equal ones the first of `METRICS`.

    Parameters
    ----------
    values, labels, fold
        As in `NoveltyMeasure.fit`.
    """
    areas: dict[str, list[float]] = {metric: [] for metric in METRICS}
    for metric, found in areas.items():
        for i in np.unique(fold):
            inside, outside = fold != i, fold == i
            if not inside.any():
                continue
            measure = NoveltyMeasure.fit(values[inside], labels[inside], fold[inside], metric)
            for label in np.unique(labels[outside]):
                is_new = labels[outside] == label
                if not is_new.all() and (labels[inside] != label).any():
                    novelty = measure.compute_without(values[outside], labels[inside], label)
                    found.append(compute_auroc(is_new, novelty))
    return max(METRICS, key=lambda metric: np.mean(areas[metric] or [0.0]))


def compute_auroc(is_new: npt.NDArray[np.bool_], novelty: Matrix) -> float:
    """Return the area under the receiver operating characteristic [1].

    This is the share of pairs in which the new trial has the higher novelty than the known
    one; an equal pair counts half. There is at least one trial of both.
    """
    known, new = np.sort(novelty[~is_new]), novelty[is_new]
    ranks = np.searchsorted(known, new) + np.searchsorted(known, new, side='right')
    return float(ranks.sum() / (2 * len(known) * len(new)))


def _fit_transform(values: Matrix, owner: Indices, metric: str) -> Matrix:
    """Return the matrix from centred features to the space of a metric."""
    means = np.stack([values[owner == i].mean(axis=0) for i in range(owner.max() + 1)])
    residuals = values - means[owner]
    spread = np.sqrt((residuals**2).mean(axis=0))
    # Rounding of the mean is no spread.
    varies = spread > 1e-12 * np.abs(values).max(axis=0)
    if metric == 'plain':
        return np.diag(varies.astype(np.float64))
    scale = np.divide(1.0, spread, out=np.zeros_like(spread), where=varies)
    if metric == 'scaled' or not varies.any():
        return np.diag(scale)
    shrunk = ledoit_wolf(residuals[:, varies] * scale[varies], assume_centered=True)[0]
    size, directions = np.linalg.eigh(shrunk)
    transform = np.zeros((values.shape[1], values.shape[1]))
    transform[np.ix_(varies, varies)] = scale[varies, np.newaxis] * directions / np.sqrt(size)
    return transform


def _distances(rows: Matrix, references: Matrix) -> Matrix:
    squares = (rows**2).sum(axis=1)[:, np.newaxis] + (references**2).sum(axis=1)
    squares -= 2.0 * rows @ references.T
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _median_distance(references: Matrix, fold: Indices) -> float:
    """Return the median distance to the nearest of another fold, or of all if there is one fold.

    1 where all trials are the same.
    """
    distance = _distances(references, references)
    same = fold[:, np.newaxis] == fold
    distance[np.eye(len(fold), dtype=bool) if same.all() else same] = np.inf
    nearest = distance.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    median = float(np.median(nearest)) if len(nearest) else 0.0
    return median if median > 0.0 else 1.0


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
    TooFewTrialsError
        When there are fewer than `trials_needed`.
    """
    if len(novelty) < trials_needed(false_alarm_rate):
        raise TooFewTrialsError(
            f'{len(novelty)} trials cannot bound false rejection at {false_alarm_rate:g}; '
            f'{trials_needed(false_alarm_rate)} are needed'
        )
    return _conformal_quantile(novelty, false_alarm_rate)


SESSIONS_BEYOND = 0.1
"""Share of new sessions that a threshold by sessions may fail in, where sessions are enough."""


def rank_of_sessions(count: int) -> int:
    """Return which of the sorted values of so many sessions bounds a new session's.

    A further session, exchangeable with them, has a value at most that one with probability
    ``rank / (count + 1)``: 1 - `SESSIONS_BEYOND` where there are nine sessions or more, and
    ``count / (count + 1)``, by the largest, where there are fewer.
    """
    return min(count, math.ceil(round((count + 1) * (1.0 - SESSIONS_BEYOND), 9)))


def compute_session_threshold(novelty: Matrix, session: Indices, false_alarm_rate: float) -> float:
    """Return a threshold that holds in most new sessions, not only on average over them.

    Each session's own conformal quantile, and of these the one of `rank_of_sessions`: conformal
    prediction with the session as the unit (Dunn, Wasserman and Ramdas 2022; Duchi, Gupta,
    Jiang and Sur 2024, over environments). In a share ``rank / (count + 1)`` of new
    sessions the quantile of their own trials is not above it. A session with fewer trials than
    `trials_needed` gives its largest novelty.

    Parameters
    ----------
    novelty : ndarray of shape (trials,)
        Of trials whose session the measure was not fitted on.
    session : ndarray of int, shape (trials,)
    false_alarm_rate : float
        Between 0 and 1 [1].

    Raises
    ------
    TooFewTrialsError
        When there are fewer than `trials_needed` in all.
    """
    compute_threshold(novelty, false_alarm_rate)  # refuses too few
    quantiles = [
        _conformal_quantile(novelty[session == i], false_alarm_rate) for i in np.unique(session)
    ]
    return float(np.sort(quantiles)[rank_of_sessions(len(quantiles)) - 1])


def _conformal_quantile(novelty: Matrix, false_alarm_rate: float) -> float:
    rank = math.ceil(round((len(novelty) + 1) * (1.0 - false_alarm_rate), 9))
    return float(np.sort(novelty)[min(rank, len(novelty)) - 1])
