# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion of raw scores to probabilities; `fit_calibration` fits its parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Map from raw scores to probabilities that preserves their order.

    The probabilities are the softmax of ``slope * scores`` (temperature scaling, Guo et al. 2017).
    Before the softmax, ``offset`` is added to the term of the predicted label, like the constant
    of Platt scaling (1999). ``slope`` is positive; its unit is the inverse of the unit of the
    scores. ``offset`` is a natural logarithm [1]. It is not negative: otherwise, another label
    could become more probable than the predicted label.
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
