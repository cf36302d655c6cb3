# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The straight line through a window of tension: ordinary least squares against time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError, UndefinedFeatureError

REGRESSION_NAMES = (
    'tension__regression__slope',
    'tension__regression__intercept',
    'tension__regression__correlation',
)
REGRESSION_UNITS = ('N/s', 'N', '1')


def compute_regression(time_ns: ArrayLike, tension_n: ArrayLike) -> NDArray[np.float64]:
    """Return slope, intercept and Pearson's correlation coefficient of tension against time.

    Closed form about the means: ``slope = S_tx / S_tt``,
    ``correlation = S_tx / sqrt(S_tt * S_xx)``. Times are differenced as integers and
    tensions against their first sample, sums are exactly rounded. Each window takes
    the same path whether it comes alone or in a batch, so that both give the same bits.

    Parameters
    ----------
    time_ns : array_like of int, shape (n,)
        Times of the samples, shared by all windows [ns].
    tension_n : array_like of shape (..., n)
        Tension [N].

    Returns
    -------
    ndarray of shape (..., 3)
        Slope [N/s], intercept at the first sample's time [N], correlation
        coefficient within -1 and 1 [1].

    Raises
    ------
    UndefinedFeatureError
        When a window is constant: its correlation is undefined.
    FeatureError
        When shapes do not fit, times are all equal or not integers, or a value is
        not finite.
    """
    time = np.asarray(time_ns)
    tension = np.asarray(tension_n, dtype=np.float64)
    if time.ndim != 1 or len(time) < 2 or tension.ndim == 0 or tension.shape[-1] != len(time):
        raise FeatureError(
            'a regression needs one time a sample and at least 2 samples; '
            f'the shapes are {time.shape} and {tension.shape}'
        )
    if not np.issubdtype(time.dtype, np.integer):
        raise FeatureError(f'times must be integer nanoseconds; they are {time.dtype}')
    if not np.isfinite(tension).all():
        raise FeatureError('the tension holds values that are not finite')
    elapsed = (time.astype(np.int64) - np.int64(time[0])).astype(np.float64)
    rows = tension.reshape(-1, len(time))
    out = np.empty((len(rows), 3))
    for index, row in enumerate(rows):
        if (row == row[0]).all():
            raise UndefinedFeatureError(
                'the tension is constant, so its correlation with time is undefined'
            )
        out[index] = _compute_one(elapsed, row)
    if not np.isfinite(out).all():
        raise FeatureError('the tension is too large for its regression to be represented')
    return out.reshape(*tension.shape[:-1], 3)


def _compute_one(
    elapsed_ns: NDArray[np.float64], tension_n: NDArray[np.float64]
) -> tuple[float, float, float]:
    first = float(tension_n[0])
    with np.errstate(over='ignore', invalid='ignore'):
        change = tension_n - first
    largest = float(np.abs(change).max())
    if not math.isfinite(largest):
        return math.inf, math.inf, math.inf
    # A power of two: squares neither overflow nor vanish, and no digit is lost.
    exponent = math.frexp(largest)[1]
    change = np.ldexp(change, -exponent)

    # The rounding of a mean enters squared, since both series are centred.
    mean_t = math.fsum(elapsed_ns) / len(elapsed_ns)
    mean_x = math.fsum(change) / len(change)
    t, x = elapsed_ns - mean_t, change - mean_x
    s_tt = math.fsum(t * t)
    s_xx = math.fsum(x * x)
    s_tx = math.fsum(t * x)
    if s_tt == 0.0:
        raise FeatureError('a regression needs at least two different times; all are equal')
    slope = s_tx / s_tt
    intercept = mean_x - slope * mean_t
    correlation = max(-1.0, min(1.0, s_tx / math.sqrt(s_tt * s_xx)))
    with np.errstate(over='ignore', under='ignore'):
        slope, intercept = np.ldexp([slope * 1e9, intercept], exponent)
    return float(slope), first + float(intercept), correlation
