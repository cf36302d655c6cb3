# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``stiffness_regression`` and ``stiffness_relaxation``: the line fitted to a hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.feature_sets.feature_set import (
    Feature,
    FeatureSet,
    FloatArray,
    WindowSamples,
)
from tactile_features.types import PHASE_HOLD, SET_STIFFNESS_REGRESSION

REGRESSION_NAMES = (
    'tension__regression__slope',
    'tension__regression__intercept',
    'tension__regression__correlation',
)
REGRESSION_UNITS = ('N/s', 'N', '1')


# Number of windows that are processed together, so that their data stay in the cache.
_BLOCK_WINDOWS = 240
# Largest ratio of a subtracted term to the remaining sum of squares. At this ratio, the
# subtraction cancels two bits.
_MOST_CANCELLED = 3.0
# Sums of squares outside this range would overflow or underflow in intermediate results.
_LEAST, _MOST = 1e-200, 1e200


class StiffnessRegression(FeatureSet):
    """Slope, intercept and correlation of a hold, as in the paper."""

    name = SET_STIFFNESS_REGRESSION
    version = 2
    phase = PHASE_HOLD
    cut = ('stiffness_settle_s', 'stiffness_crop_end_s', 'max_gap_samples')

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        return tuple(map(Feature, REGRESSION_NAMES, REGRESSION_UNITS))

    def compute(self, samples: WindowSamples) -> FloatArray:
        return compute_regression(samples.time_ns, samples.tension_n)


def compute_regression(time_ns: ArrayLike, tension_n: ArrayLike) -> FloatArray:
    """Return slope, intercept and Pearson's correlation coefficient of tension against time.

    Closed form with sums about the means: ``slope = S_tx / S_tt``,
    ``correlation = S_tx / sqrt(S_tt * S_xx)``. The first time is subtracted as an integer, and one
    sample is subtracted from the tensions. The time since 1970 and an offset of the sensor
    therefore cost no precision. A single window and a window in a batch are computed in the same
    way, and give the same bits. A constant window, for example without contact, has slope 0 and
    correlation 0.

    Parameters
    ----------
    time_ns : array_like of int, shape (n,)
        Times of the samples, shared by all windows [ns].
    tension_n : array_like of shape (..., n)
        Tension [N].

    Returns
    -------
    ndarray of shape (..., 3)
        Slope [N/s], intercept at the time of the first sample [N], and correlation coefficient
        between -1 and 1 [1].

    Raises
    ------
    FeatureError
        When shapes do not match, times are all equal or not integers, or a value is not finite.
    """
    time = np.asarray(time_ns)
    tension = np.asarray(tension_n, dtype=np.float64)
    if time.ndim != 1 or len(time) < 2 or tension.ndim == 0 or tension.shape[-1] != len(time):
        raise FeatureError(
            'a regression needs one time per sample and at least 2 samples; '
            f'the shapes are {time.shape} and {tension.shape}'
        )
    if not np.issubdtype(time.dtype, np.integer):
        raise FeatureError(f'times must be integer nanoseconds; they are {time.dtype}')
    axis = _centre_times(time)
    rows = np.ascontiguousarray(tension).reshape(-1, len(time))
    out = _fit(axis, rows)
    doubtful = np.flatnonzero(~np.isfinite(out).all(axis=1))
    if len(doubtful):
        out[doubtful] = _fit_scaled(axis, rows[doubtful])
    return out.reshape(*tension.shape[:-1], 3)


@dataclass(frozen=True)
class _TimeAxis:
    """Times relative to their mean [ns], the mean [ns], and the sum of squares [ns^2]."""

    centred: FloatArray
    mean: float
    square: float


def _centre_times(time_ns: NDArray[Any]) -> _TimeAxis:
    n = len(time_ns)
    span = int(time_ns.max()) - int(time_ns.min())
    if span == 0:
        raise FeatureError('a regression needs at least two different times; all are equal')
    # n * time - sum is exact in integers. If it does not fit into 64 bits, Python integers are
    # used.
    whole: Any = np.int64 if n * span < 2**62 else object
    elapsed = time_ns.astype(whole) - int(time_ns[0])
    total = elapsed.sum()
    centred = ((n * elapsed - total) / n).astype(np.float64)
    return _TimeAxis(centred, float(total / n), float(np.add.reduce(centred * centred)))


def _fit(axis: _TimeAxis, tension: FloatArray) -> FloatArray:
    """Return the fitted line of each window; after overflow or underflow, its values are NaN."""
    n = len(axis.centred)
    # The sample in the middle of a hold is closer to the mean than the first sample.
    near = tension[:, n // 2].copy()
    with np.errstate(all='ignore'):
        mean, s_tx, s_xx = _sum(axis, tension, near)
        # The subtracted sample was far from the mean: compute again with the mean instead.
        far = np.flatnonzero(n * mean * mean > _MOST_CANCELLED * s_xx)
        if len(far):
            near[far] += mean[far]
            mean[far], s_tx[far], s_xx[far] = _sum(axis, tension[far], near[far])
        slope = s_tx / axis.square
        out = np.empty((len(tension), 3))
        out[:, 0] = slope * 1e9
        out[:, 1] = near + (mean - slope * axis.mean)
        out[:, 2] = np.clip(s_tx / np.sqrt(axis.square * s_xx), -1.0, 1.0)
        out[~((s_xx > _LEAST) & (s_xx < _MOST))] = np.nan
    return out


def _sum(
    axis: _TimeAxis, tension: FloatArray, near: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, S_tx and S_xx of each row relative to ``near``.

    Each sum runs over one row in an order that depends only on the length of the row.
    `numpy.einsum` uses another order for a single row, so a second row is added to it.
    """
    count, n = tension.shape
    sums = np.empty((3, count + 1))
    change = np.zeros((min(count, _BLOCK_WINDOWS) + 1, n))
    for at in range(0, count, _BLOCK_WINDOWS):
        rows = min(_BLOCK_WINDOWS, count - at)
        np.subtract(tension[at : at + rows], near[at : at + rows, None], out=change[:rows])
        part = change[: max(rows, 2)]
        total, s_tx, square = sums[:, at : at + len(part)]
        np.add.reduce(part, axis=1, out=total)
        np.einsum('ij,j->i', part, axis.centred, out=s_tx)
        np.einsum('ij,ij->i', part, part, out=square)
    total, s_tx, square = sums[:, :count]
    mean = total / n
    return mean, s_tx, square - total * mean


def _fit_scaled(axis: _TimeAxis, tension: FloatArray) -> FloatArray:
    """Fit windows of extreme magnitude, and constant windows.

    Tensions are divided by a power of two, so that their squares neither overflow nor underflow.
    This division loses no precision.
    """
    if not np.isfinite(tension).all():
        raise FeatureError('the tension has values that are not finite')
    first = tension[:, :1]
    with np.errstate(over='ignore', under='ignore', invalid='ignore'):
        change = tension - first
        exponent = np.frexp(np.abs(change).max(axis=1))[1]
        out = _fit(axis, np.ldexp(change, -exponent[:, None]))
        out[:, :2] = np.ldexp(out[:, :2], exponent[:, None])
        out[:, 1] += first[:, 0]
    constant = (change == 0.0).all(axis=1)
    out[constant] = 0.0
    out[constant, 1] = first[constant, 0]
    if not np.isfinite(out).all():
        raise FeatureError('the tension is too large for its regression to be represented')
    return out


class StiffnessRelaxation(StiffnessRegression):
    """Slope, intercept and correlation of a hold, and the ratio of slope to intercept [1/s].

    The force of the press differs between mountings. It scales slope and intercept by the same
    factor, so their ratio does not depend on it. The sensor must be tared, because an offset
    changes the ratio.
    """

    name = 'stiffness_relaxation'
    version = 1

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        names = (*REGRESSION_NAMES, 'tension__regression__relative_slope')
        return tuple(map(Feature, names, (*REGRESSION_UNITS, '1/s')))

    def compute(self, samples: WindowSamples) -> FloatArray:
        line = super().compute(samples)
        with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
            relative = np.where(line[..., :1] == 0.0, 0.0, line[..., :1] / line[..., 1:2])
        bad = np.flatnonzero(~np.isfinite(relative))
        if len(bad):
            raise UndefinedFeatureError(
                'the intercept is zero, so the ratio of slope to intercept is undefined',
                windows=tuple(bad.tolist()),
            )
        return np.concatenate([line, relative], axis=-1)
