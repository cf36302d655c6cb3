# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Novelty: the distance of a window to the training trials, whatever the classifier.

`fit_measure` fits the measure. docs/answers.md says how this kind of novelty was chosen.
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
"""Least squared distance to the mean of all, so that a window there has a finite novelty [1]."""


@dataclasses.dataclass(frozen=True, eq=False)
class NoveltyMeasure:
    """Distance to the nearest training trial times the relative distance to the nearest label.

    The first factor is the geometric mean of two distances to the nearest trial: between the
    features as they are, and between features whitened by the covariance within labels. Each is
    divided by the median distance that trials of the nearest trial's label have to the nearest of
    another fold of the training, such as another session. The second factor is d / D: the
    Mahalanobis distance to the nearest label's mean, with one covariance within labels, over the
    one to the mean of all trials, with the covariance of all. Covariances are shrunk after Ledoit
    and Wolf (2004).

    Attributes
    ----------
    SHAPES : mapping
        Dimensions of the arrays, for the model file; see `prediction`.
    centre : array of shape (k,)
        Mean of all trials, in the features' units.
    references : array of shape (trials, k)
        The trials minus the centre, with 0 in features that do not vary within a label.
    scales : array of shape (2, trials)
        Divisors of the plain and of the whitened distance to each trial.
    within, total : array of shape (k, k)
        Lead to the spaces in which the covariance within labels, or of all, is one.
    means : array of shape (labels, k)
        Means of the labels in the first.
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
        """Raise ModelFileError when values of the arrays do not fit together."""
        if not self.scales.size or not (self.scales > 0.0).all():
            raise ModelFileError('values of its array "scales" are not positive')

    def compute(self, values: Matrix) -> Matrix:
        """Return the novelty of windows of shape (windows, k), one a window [1]."""
        return np.array([self.compute_one(row) for row in values])

    def compute_one(self, values: Matrix) -> float:
        """Return the novelty of one window, shape (k,) [1]."""
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
    """Points with their squared lengths, shape (points, k)."""

    def __init__(self, points: Matrix) -> None:
        self._points = points
        self._squares = (points**2).sum(axis=1)

    def find_nearest(self, row: Matrix) -> tuple[int, float]:
        """Return the position of the nearest point, and the squared distance to it."""
        squares = self._squares - 2.0 * (self._points @ row)
        nearest = int(squares.argmin())
        return nearest, max(float(squares[nearest]) + float(row @ row), 0.0)
