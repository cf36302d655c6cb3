# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Novelty: the distance of a window to the training trials, whatever the classifier.

`fit_novelty` fits the measure.
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

WHITENED, RELATIVE = 'whitened', 'relative'
METRICS = ('plain', 'scaled', WHITENED, RELATIVE)
"""Kinds of novelty, the usual one first.

The first three are spaces of the distance to the nearest trial. Plain: the features as they are,
which is right where all are amplitudes of one unit and noise is even. Scaled: each divided by its
spread within a label. Whitened: by the covariance within labels, shrunk after Ledoit and Wolf
(2004). Relative: without a distance to trials. docs/answers.md has the measurements.
"""

NEAREST_TO_ALL = 1e-6
"""Least squared distance to the mean of all, so that a window there has a finite novelty [1]."""


@dataclasses.dataclass(frozen=True, eq=False)
class NoveltyMeasure:
    """Distance to the nearest training trial times the relative distance to the nearest label.

    The distance to the nearest trial is divided by the median distance that trials of its label
    have to the nearest of another fold of the training, such as another session. The second factor
    is d / D: the Mahalanobis distance to the nearest label's mean, with one covariance within
    labels, over that to the mean of all, with the covariance of all. Both covariances are shrunk
    after Ledoit and Wolf.

    The metric `RELATIVE` has the difference of the squares alone, r = (d^2 - D^2) / 2k (Ren et al.
    2021, "A simple fix to Mahalanobis distance", arXiv:2106.09022), as the positive r + sqrt(1 +
    r^2).

    Attributes
    ----------
    SHAPES : mapping
        Dimensions of the arrays, for the model file; see `prediction`.
    metric : str
        One of `METRICS`.
    centre : array of shape (k,)
        Mean of all trials, in the features' units.
    factors : array of shape (k,)
        Lead to the space of the distance to trials, unless that is the one of ``within``.
    references : array of shape (trials, k)
        The trials in that space.
    scale : array of shape (trials,)
        Divisor of the distance to each trial.
    within, total : array of shape (k, k)
        Lead to the spaces in which the covariance within labels, or of all, is one.
    means : array of shape (labels, k)
        Means of the labels in the first.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'centre': ('k',),
        'factors': ('k',),
        'references': ('trials', 'k'),
        'scale': ('trials',),
        'within': ('k', 'k'),
        'total': ('k', 'k'),
        'means': ('labels', 'k'),
    }

    metric: str
    centre: Matrix
    factors: Matrix
    references: Matrix
    scale: Matrix
    within: Matrix
    total: Matrix
    means: Matrix

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError when values of the arrays do not fit together."""
        if not len(self.scale) or not (self.scale > 0.0).all():
            raise ModelFileError('values of its array "scale" are not positive')

    def compute(self, values: Matrix) -> Matrix:
        """Return the novelty of windows of shape (windows, k), one a window [1]."""
        return np.array([self.compute_one(row) for row in values])

    def compute_one(self, values: Matrix) -> float:
        """Return the novelty of one window, shape (k,) [1]."""
        row = values - self.centre
        whitened, of_all = row @ self.within, row @ self.total
        # Squared distances, each without the square of the row at first.
        to_label = float((self._mean_squares - 2.0 * (self.means @ whitened)).min())
        to_label = max(to_label + float(whitened @ whitened), 0.0)
        to_all = float(of_all @ of_all)
        if self.metric == RELATIVE:
            excess = (to_label - to_all) / (2 * len(row))
            return excess + math.sqrt(1.0 + excess**2)
        near = whitened if self.metric == WHITENED else row * self.factors
        squares = self._reference_squares - 2.0 * (self.references @ near)
        nearest = int(squares.argmin())
        distance = math.sqrt(max(float(squares[nearest]) + float(near @ near), 0.0))
        distance /= float(self.scale[nearest])
        return distance * math.sqrt(to_label / max(to_all, NEAREST_TO_ALL))

    @cached_property
    def _mean_squares(self) -> Matrix:
        return np.asarray((self.means**2).sum(axis=1))

    @cached_property
    def _reference_squares(self) -> Matrix:
        return np.asarray((self.references**2).sum(axis=1))
