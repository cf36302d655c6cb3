# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Novelty: distance of a window from the training trials. It does not depend on the classifier.

`fit_measure` fits the measure. docs/answers.md explains why this measure was chosen.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError

Matrix = npt.NDArray[np.float64]

NEAREST_TO_ALL = 1e-6
"""Lower bound of the squared distance to the mean of all trials; keeps the novelty finite [1]."""


@dataclasses.dataclass(frozen=True, eq=False)
class NoveltyMeasure:
    """Distance to the nearest training trial, multiplied by a distance to the nearest label.

    The first factor is the geometric mean of two distances to the nearest trial. The first
    distance is between the unchanged features. The second is between features that are whitened by
    the covariance within labels. Each distance is divided by a typical distance for the label of
    the nearest trial: the median, over the trials of this label, of the distance to the nearest
    trial of the label in another training fold, such as another session.

    The second factor is d / D. d is the Mahalanobis distance to the mean of the nearest label,
    with a common covariance within labels. D is the Mahalanobis distance to the mean of all
    trials, with the covariance of all trials. The covariances are shrunk (Ledoit and Wolf 2004).

    Attributes
    ----------
    SHAPES : mapping
        Dimensions of the arrays in the model file; see `prediction`.
    centre : array of shape (k,)
        Mean of all trials, in the units of the features.
    references : array of shape (trials, k)
        Trials minus ``centre``; 0 for features that do not vary within labels.
    scales : array of shape (2, trials)
        Divisors of the unchanged and the whitened distance to each trial.
    within, total : array of shape (k, k)
        Whitening matrices of the covariance within labels and of the covariance of all trials.
    means : array of shape (labels, k)
        Means of the labels, whitened by ``within``.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'centre': ('k',),
        'references': ('trials', 'k'),
        'scales': (2, 'trials'),
        'within': ('k', 'k'),
        'total': ('k', 'k'),
        'means': ('labels', 'k'),
    }

    centre: Matrix
    references: Matrix
    scales: Matrix
    within: Matrix
    total: Matrix
    means: Matrix

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError if values of the arrays are inconsistent."""
        if not self.scales.size or not (self.scales > 0.0).all():
            raise ModelFileError('values of its array "scales" are not positive')

    def compute(self, values: Matrix) -> Matrix:
        """Return the novelty [1] of each window; ``values`` has shape (windows, k)."""
        return np.array([self.compute_one(row) for row in values])

    def compute_one(self, values: Matrix) -> float:
        """Return the novelty [1] of one window of shape (k,)."""
        row = values - self.centre
        whitened, of_all = row @ self.within, row @ self.total
        to_label = math.sqrt(self._means.find_nearest(whitened)[1])
        to_all = math.sqrt(max(float(of_all @ of_all), NEAREST_TO_ALL))
        product = 1.0
        spaces = (self._plain, row * self._varies), (self._whitened, whitened)
        for (points, point), scale in zip(spaces, self.scales, strict=True):
            nearest, square = points.find_nearest(point)
            product *= math.sqrt(square) / float(scale[nearest])
        return math.sqrt(product) * to_label / to_all

    @cached_property
    def _varies(self) -> Matrix:
        return np.asarray(self.within.any(axis=1), dtype=np.float64)

    @cached_property
    def _means(self) -> _Points:
        return _Points(self.means)

    @cached_property
    def _plain(self) -> _Points:
        return _Points(self.references)

    @cached_property
    def _whitened(self) -> _Points:
        return _Points(self.references @ self.within)


class _Points:
    """Points of shape (points, k), with their precomputed squared lengths."""

    def __init__(self, points: Matrix) -> None:
        self._points = points
        self._squares = (points**2).sum(axis=1)

    def find_nearest(self, row: Matrix) -> tuple[int, float]:
        """Return the index of the nearest point and the squared distance to it."""
        squares = self._squares - 2.0 * (self._points @ row)
        nearest = int(squares.argmin())
        return nearest, max(float(squares[nearest]) + float(row @ row), 0.0)
