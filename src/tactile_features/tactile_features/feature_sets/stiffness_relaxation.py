# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``stiffness_relaxation``: the line through a hold, and how fast it falls for its height."""

from __future__ import annotations

import numpy as np

from tactile_features.errors import UndefinedFeatureError
from tactile_features.feature_sets.feature_set import Feature, FloatArray, WindowSamples
from tactile_features.feature_sets.stiffness_regression import (
    REGRESSION_NAMES,
    REGRESSION_UNITS,
    StiffnessRegression,
)


class StiffnessRelaxation(StiffnessRegression):
    """Slope, intercept and correlation of a hold, and slope over intercept [1/s].

    The mounting scales slope and intercept together, as it scales the force of the press. Their
    quotient is left. It needs a tared sensor: an offset changes it.
    """

    name = 'stiffness_relaxation'
    version = 1

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        names = (*REGRESSION_NAMES, 'tension__regression__relative_slope')
        return tuple(map(Feature, names, (*REGRESSION_UNITS, '1/s')))

    def compute(self, samples: WindowSamples) -> FloatArray:
        line = super().compute(samples)
        with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
            relative = line[..., :1] / line[..., 1:2]
        bad = np.flatnonzero(~np.isfinite(relative))
        if len(bad):
            raise UndefinedFeatureError(
                'the intercept is zero, so the slope over it is undefined',
                windows=tuple(bad.tolist()),
            )
        return np.concatenate([line, relative], axis=-1)
