# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration: raw scores to probabilities. `fit_calibration` fits the map."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A map from raw scores to probabilities that keeps their order.

    The softmax of ``slope * scores`` (temperature scaling, Guo et al. 2017) with the answer's own
    term raised by ``offset``, as the constant of Platt's (1999) map would. The slope is positive,
    in 1 over the unit of the scores. The offset is a natural logarithm [1]; it is never negative:
    below 0 the second label could come before the answer.
    """

    slope: float
    offset: float

    def compute(self, scores: Matrix) -> Matrix:
        """Return the probabilities for scores of shape (windows, labels)."""
        return np.array([self.compute_one(row) for row in scores]).reshape(scores.shape)

    def compute_one(self, scores: Matrix) -> Matrix:
        """Return the probabilities for the scores of one window, shape (labels,)."""
        size = self.slope * scores
        size[scores.argmax()] += self.offset
        size = np.exp(size - size.max())
        return np.asarray(size / size.sum())
