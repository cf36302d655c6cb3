# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""First-order lag, solved exactly: the sensor's low pass, creep, the branches of an object."""

from __future__ import annotations

import math

_SERIES_BELOW = 1.0
_SERIES_TERMS = 22  # the first term left out is below 1e-21


def compute_relaxation(step_s: float, time_s: float) -> tuple[float, float, float]:
    """Coefficients (alpha, beta, gamma) of one step of ``y' = (u - y) / time_s``.

    ``y1 = alpha y0 + beta u0 + gamma u1`` is exact for an input u that is linear over the
    step (first-order hold). With a = step / time they are exp(-a), (1 - exp(-a)) / a - exp(-a)
    and 1 - (1 - exp(-a)) / a, and add up to 1. For an endless step they are (0, 0, 1).

    Parameters
    ----------
    step_s
        Length of the step, from 0 to infinity [s].
    time_s
        Time constant, above 0 [s].
    """
    if math.isinf(step_s):
        return 0.0, 0.0, 1.0
    a = step_s / time_s
    alpha = math.exp(-a)
    if a >= _SERIES_BELOW:
        mean = -math.expm1(-a) / a
        return alpha, mean - alpha, 1 - mean
    # The quotients cancel for short steps; their Taylor series do not.
    beta = gamma = 0.0
    term = 1.0
    for k in range(1, _SERIES_TERMS):
        term *= -a / (k + 1)  # (-a)^k / (k + 1)!
        beta -= k * term
        gamma -= term
    return alpha, beta, gamma
