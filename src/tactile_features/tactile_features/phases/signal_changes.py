# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where a signal changes: small least-squares problems on a few samples.

Everything here takes samples as arrays of time [s] and tension [N] and knows no state, so
that a place found in a stream is the place found in the same array.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

_JUMPED_SHARE = 0.3
"""A sample that has gone this share of a jump is no longer before it."""


def estimate_noise_n(tension_n: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences of neighbours [N].

    Their median absolute value knows neither the level nor a drift, and does not see the few
    samples where something happens. A converter's step, if coarser than the noise, can
    make it 0.
    """
    if len(tension_n) < 2:
        return 0.0
    return float(_MAD_TO_SIGMA / math.sqrt(2) * np.median(np.abs(np.diff(tension_n))))


def locate_bend(time_s: FloatArray, tension_n: FloatArray, least: int = 3) -> int:
    """Return the index of the sample where two straight lines meet best.

    Each line is fitted by itself; the sample that is returned belongs to both.

    Parameters
    ----------
    time_s, tension_n : ndarray of shape (n,)
        Samples around one bend, ``n >= 2 * least - 1``.
    least : int
        Fewest samples of a line.
    """
    errors = [
        _line_error(time_s[: i + 1], tension_n[: i + 1]) + _line_error(time_s[i:], tension_n[i:])
        for i in range(least - 1, len(time_s) - least + 1)
    ]
    return least - 1 + int(np.argmin(errors))


def _line_error(time_s: FloatArray, tension_n: FloatArray) -> float:
    """Return the squares that a straight line leaves."""
    t, x = time_s - time_s.mean(), tension_n - tension_n.mean()
    s_tx = float(t @ x)
    return float(x @ x) - s_tx * s_tx / float(t @ t)


class Step(NamedTuple):
    """Jump of a line between one sample and the next.

    Attributes
    ----------
    height_n : float
        The jump [N].
    spread : float
        Its standard deviation over that of one sample [1].
    before_n : float
        What a line of their own leaves of the samples before it, as a standard
        deviation [N].
    slope_n_s : float
        Slope of the line on both sides [N/s].
    """

    height_n: float
    spread: float
    before_n: float
    slope_n_s: float


def measure_step(time_s: FloatArray, tension_n: FloatArray, first_after: int) -> Step:
    """Return the jump of a straight line that is as steep before as behind.

    Ordinary least squares.

    Parameters
    ----------
    time_s, tension_n : ndarray of shape (n,)
        Time [s] and tension [N].
    first_after : int
        Index of the first sample behind the jump, from 3 to ``n - 1``.
    """
    time, tension = np.split(time_s, [first_after]), np.split(tension_n, [first_after])
    centres = [(float(t.mean()), float(x.mean())) for t, x in zip(time, tension, strict=True)]
    s_tt, s_tx = 0.0, 0.0
    for t, x, (t0, x0) in zip(time, tension, centres, strict=True):
        s_tt += float((t - t0) @ (t - t0))
        s_tx += float((t - t0) @ (x - x0))
    slope = s_tx / s_tt
    apart_s = centres[1][0] - centres[0][0]
    height_n = centres[1][1] - centres[0][1] - slope * apart_s
    before_n = math.sqrt(max(0.0, _line_error(time[0], tension[0])) / (first_after - 2))
    share = 1 / len(time[0]) + 1 / len(time[1]) + apart_s * apart_s / s_tt
    return Step(height_n, math.sqrt(share), before_n, slope)


def locate_step(time_s: FloatArray, tension_n: FloatArray, least: int) -> int:
    """Return the index of the last sample before a jump.

    Where a straight line with a jump fits best; from there back over the samples of a jump
    that took more than one.

    Parameters
    ----------
    time_s, tension_n : ndarray of shape (n,)
        Samples around one jump.
    least : int
        Fewest samples before it, at least 3.
    """
    steps = {i: measure_step(time_s, tension_n, i) for i in range(least, len(time_s) - 1)}
    first_after = max(steps, key=lambda i: abs(steps[i].height_n) / steps[i].spread)
    step = steps[first_after]
    level_n = tension_n - step.slope_n_s * time_s
    share = (level_n - level_n[:first_after].mean()) / step.height_n
    at = first_after - 1
    while at > 0 and share[at] > _JUMPED_SHARE:
        at -= 1
    return at
