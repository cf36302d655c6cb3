# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Offset of a session's features and threshold of novelty, from a few known trials of it.

Free of scikit-learn: the classifier node takes it, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError, refuse_damage, TooFewTrialsError

TRIALS = 5
"""Known trials of a new session that are needed, and that training draws for a trial run."""

TINY = 1e-12
"""So that a trial of novelty 0, a copy of a training trial, has a logarithm."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class SessionStatistics:
    """Effects of sessions on features and novelty, and how far known trials mend them.

    Attributes
    ----------
    means : ndarray of shape (labels, k)
        Mean features of each label over the training, in the order of the labels.
    share : ndarray of shape (k,)
        Part of the mean deviation of `TRIALS` known trials from their labels' means that is taken
        for the session's: its variance over that plus the variance of the mean (empirical
        Bayes, one factor a feature) [1].
    weight, centre : float
        Weight of the known trials' mean log novelty in the threshold, by least squares [1], and
        the mean of that in training sessions.
    log_threshold : float
        Logarithm of the threshold where the known trials lie at ``centre``.
    """

    means: Matrix
    share: Matrix
    weight: float
    centre: float
    log_threshold: float

    def recalibrate(
        self, values: Matrix, label: Indices, compute_novelty: Callable[[Matrix], Matrix]
    ) -> tuple[Matrix, float]:
        """Return the session's offset of the features, shape (k,), and its novelty threshold.

        Known trials have features of shape (trials, k) and the position of each label among the
        model's, shape (trials,); ``compute_novelty`` is the model's. Raises TooFewTrialsError when
        there are fewer than `TRIALS`.
        """
        if len(values) < TRIALS:
            raise TooFewTrialsError(
                f'{len(values)} known trials cannot recalibrate a model; {TRIALS} are needed'
            )
        offset = self.share * (values - self.means[label]).mean(axis=0)
        known = float(np.log(compute_novelty(values - offset) + TINY).mean())
        return offset, math.exp(self.log_threshold + self.weight * (known - self.centre))

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as what JSON can hold, without loss."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], labels: int, features: int) -> SessionStatistics:
        """Return what `to_dict` gave.

        Raises ModelFileError when a number is missing or not finite, or a shape does not fit.
        """
        with refuse_damage('its statistics of sessions are'):
            means, share = (np.array(entry[name], dtype=np.float64) for name in ('means', 'share'))
            rest = [float(entry[name]) for name in ('weight', 'centre', 'log_threshold')]
        fits = means.shape == (labels, features) and share.shape == (features,)
        if not fits or not all(np.isfinite(item).all() for item in (means, share, rest)):
            raise ModelFileError('its statistics of sessions do not fit its labels and features')
        return cls(means, share, *rest)
