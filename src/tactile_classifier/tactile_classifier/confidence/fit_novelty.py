# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fit the novelty measure to training trials."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from sklearn.covariance import ledoit_wolf

from tactile_classifier.confidence.novelty import Matrix, NoveltyMeasure
from tactile_classifier.datasets.dataset import divide_groups

Indices = npt.NDArray[np.intp]


def fit_measure(values: Matrix, labels: npt.NDArray[np.str_], fold: Indices) -> NoveltyMeasure:
    """Fit the novelty measure to training trials of shape (trials, k).

    A feature that varies within no label is ignored. ``fold`` contains the fold of each trial, for
    example the number of its session.
    """
    classes, owner = np.unique(labels, return_inverse=True)
    centre = values.mean(axis=0)
    residuals = _find_residuals(values, owner, fold)
    spread = np.sqrt((residuals**2).mean(axis=0))
    # Even a constant feature can have a small spread, because its mean is rounded.
    varies = spread > 1e-12 * np.abs(values).max(axis=0)
    scale = np.divide(1.0, spread, out=np.zeros_like(spread), where=varies)
    within = _whiten(residuals, scale)
    references = (values - centre) * varies
    whitened = references @ within
    each = [owner == i for i in range(len(classes))]
    scales = [
        [_median_distance(points[one], fold[one]) for one in each]
        for points in (references, whitened)
    ]
    return NoveltyMeasure(
        centre=centre,
        references=references,
        scales=np.array(scales)[:, owner],
        within=within,
        total=_whiten(values - centre, scale),
        means=np.stack([whitened[one].mean(axis=0) for one in each]),
    )


def _find_residuals(values: Matrix, owner: Indices, fold: Indices) -> Matrix:
    """Return the deviations from the mean of each label, corrected for the degrees of freedom.

    If there are two folds, the deviations are computed from the mean of each label in each fold.
    In this case, the measure for held-out trials is fitted to a single fold, so it contains no
    differences between folds. The measure of all trials must be comparable to it.
    """
    if len(np.unique(fold)) == 2:
        crossed = divide_groups(owner, fold)
        owner = crossed if np.bincount(crossed).max() > 1 else owner
    counts = np.bincount(owner)
    means = np.stack([values[owner == i].mean(axis=0) for i in range(len(counts))])
    unbiased = np.sqrt(counts / np.maximum(counts - 1, 1))[owner, np.newaxis]
    residuals: Matrix = ((values - means[owner]) * unbiased)[counts[owner] > 1]
    # If each label has only one trial, the deviations from the mean of all trials are used.
    return residuals if len(residuals) else values - values.mean(axis=0)


def _whiten(residuals: Matrix, scale: Matrix) -> Matrix:
    """Return the whitening matrix for the Ledoit-Wolf covariance of the residuals.

    Features whose ``scale`` is 0 are ignored.
    """
    counts = scale > 0.0
    transform = np.zeros((len(scale), len(scale)))
    if counts.any():
        scaled = residuals[:, counts] * scale[counts]
        size, directions = np.linalg.eigh(ledoit_wolf(scaled, assume_centered=True)[0])
        transform[np.ix_(counts, counts)] = scale[counts, np.newaxis] * directions / np.sqrt(size)
    return transform


def _median_distance(points: Matrix, fold: Indices) -> float:
    """Return the median distance between a point and the nearest point of another fold.

    If there is only one fold, the nearest point of the same fold is used. If the median is 0 or
    there are no other points, returns 1.
    """
    lengths = (points**2).sum(axis=1)
    squares = lengths[:, np.newaxis] + lengths - 2.0 * points @ points.T
    distance = np.sqrt(np.maximum(squares, 0.0))
    same = fold[:, np.newaxis] == fold
    distance[np.eye(len(fold), dtype=bool) if same.all() else same] = np.inf
    nearest = distance.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    median = float(np.median(nearest)) if len(nearest) else 0.0
    return median if median > 0.0 else 1.0
