# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``texture_spatial``: features over distance instead of time, for variable sliding speed."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from functools import lru_cache
import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import (
    Feature,
    FeatureSet,
    FloatArray,
    glide_window,
    WindowParameters,
    WindowSamples,
    WindowSpec,
)
from tactile_features.types import PHASE_GLIDE, SET_TEXTURE_SPATIAL

QUANTILES = 13
"""Number of quantiles that describe a distribution, from minimum to maximum."""

GRID_PER_SCALE = 4
"""Grid points per finest scale."""

KERNEL_REACH = 4
"""Half width of the smoothing kernel, in finest scales."""

MAX_SAMPLES = 100_000
"""Largest number of samples in a window: 14 s at 7 kHz."""

LARGEST_SHARE = 4
"""The largest scale is at most the window length divided by this number. A second difference
spans twice its scale. At larger scales, it could be computed only in the middle of the window, and
would depend on the position of the window."""


@dataclasses.dataclass(frozen=True)
class SpatialWindow:
    """A stretch of the surface and its finest scale.

    Attributes
    ----------
    length_m : float
        Path of the fingertip over the surface [m].
    finest_m : float
        Finest scale [m]: structures with a period below twice this length are ignored.

    Raises
    ------
    FeatureError
        When the stretch is too short for its finest scale.
    """

    length_m: float
    finest_m: float

    def __post_init__(self) -> None:
        if not 0.0 < self.finest_m * LARGEST_SHARE <= self.length_m < math.inf:
            raise FeatureError(
                f'the finest scale is {self.finest_m:g} m in a window of {self.length_m:g} m; '
                f'it must be positive, and the window at least {LARGEST_SHARE} times as long'
            )

    @property
    def scales(self) -> tuple[int, ...]:
        """The scales as multiples of the finest scale: 1, 2, 4, and so on."""
        octaves = math.floor(math.log2(self.length_m / (LARGEST_SHARE * self.finest_m) + 1e-9))
        return tuple(2**octave for octave in range(octaves + 1))

    @property
    def component_count(self) -> int:
        """Number of spatial frequencies, starting with one cycle per window."""
        return math.floor(self.length_m / (2.0 * self.finest_m) + 1e-9)

    def sample_count(self, speed_m_s: float, rate_hz: float) -> int:
        """Return the number of samples that cover the stretch at a sliding speed.

        Raises
        ------
        FeatureError
            When the speed is unknown, so high that the distance between samples exceeds the finest
            scale, or so low that the window has too many samples.
        """
        if not (math.isfinite(speed_m_s) and speed_m_s > 0.0):
            raise FeatureError(
                'features over distance need the sliding speed; '
                'state glide_speed_m_s in the trial event'
            )
        step_m = speed_m_s / rate_hz
        if step_m > self.finest_m * (1 + 1e-9):
            raise FeatureError(
                f'at {speed_m_s:g} m/s samples are {step_m:.3g} m apart, but the finest '
                f'scale is {self.finest_m:g} m; glide slower, or train with a coarser scale'
            )
        # Checked before the division: a speed close to zero would make the quotient infinite.
        if self.length_m > (MAX_SAMPLES - 1) * step_m:
            raise FeatureError(
                f'at {speed_m_s:g} m/s a window of {self.length_m:g} m has more than '
                f'{MAX_SAMPLES} samples; glide faster, or shorten the window'
            )
        return math.ceil(self.length_m / step_m - 1e-9) + 1

    @property
    def grid_m(self) -> FloatArray:
        """Positions at which the smoothed signal is evaluated [m]."""
        step_m = self.finest_m / GRID_PER_SCALE
        return np.asarray(np.arange(0.0, self.length_m * (1 + 1e-9), step_m), dtype=np.float64)

    def names(self) -> tuple[str, ...]:
        """Return the names of the features in the order of the values."""
        levels = [f'q_{level:.3f}' for level in np.linspace(0.0, 1.0, QUANTILES)]
        lengths_mm = [f'{1e3 * self.finest_m * scale:g}' for scale in self.scales]
        groups = ['value', *(f'{what}__mm_{mm}' for what in _DIFFERENCES for mm in lengths_mm)]
        return (
            *(
                f'tension__spatial_spectrum__per_m_{k / self.length_m:.3f}'
                for k in range(1, self.component_count + 1)
            ),
            *(f'tension__spatial_{group}__{level}' for group in groups for level in levels),
        )


_DIFFERENCES = ('change', 'bend')


class TextureSpatial(FeatureSet):
    """Texture features over distance, for any sliding speed; trial events state the speed."""

    name = SET_TEXTURE_SPATIAL
    version = 1
    phase = PHASE_GLIDE
    needs_speed = True
    cut = ('spatial_crop_m', 'max_gap_samples')
    options = ('spatial_length_m', 'spatial_finest_m')

    def __init__(self, config: WindowParameters) -> None:
        super().__init__(config)
        self.stretch = SpatialWindow(config.spatial_length_m, config.spatial_finest_m)

    def window(self, rate_hz: float, speed_m_s: float) -> WindowSpec:
        count = self.stretch.sample_count(speed_m_s, rate_hz)
        return dataclasses.replace(
            glide_window(self.config, count, rate_hz),
            crop_start_s=self.config.spatial_crop_m / speed_m_s,
        )

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        return tuple(Feature(name, 'N') for name in self.stretch.names())

    def compute(self, samples: WindowSamples) -> FloatArray:
        return compute_spatial(samples.tension_n, samples.speed_m_s, samples.rate_hz, self.stretch)


def compute_spatial(
    tension_n: ArrayLike, speed_m_s: float, rate_hz: float, window: SpatialWindow
) -> FloatArray:
    """Compute features that depend neither on the position of the fingertip nor on its speed.

    There are three kinds of features, all in newtons:

    - Amplitudes of the spatial frequencies 1, 2, ... cycles per window, single-sided, with a
      Hann window. They describe periodic structure.
    - Quantiles of the tension minus its mean, smoothed over the finest scale with a Gaussian.
    - Quantiles of first differences (*change*) and of second differences (*bend*) of the smoothed
      tension, at each scale from the finest one on, each twice the one before. First differences
      respond to steps, second differences to ridges and grooves. They describe structure that is
      not periodic. They correspond to structure functions, but describe the whole distribution
      of the differences instead of one moment.

    If the path of the fingertip is shifted, the features change only because of the parts of the
    surface that enter and leave the window. The time affects the features only through the speed.

    A single window and the same window in a batch give the same bits.

    Parameters
    ----------
    tension_n : array_like of shape (..., n)
        Samples from the start of the window [N]; n is `SpatialWindow.sample_count`.
    speed_m_s : float
        Sliding speed [m/s].
    rate_hz : float
        Sample rate [Hz].
    window : SpatialWindow

    Returns
    -------
    ndarray of shape (..., k)
        Features in the order of `SpatialWindow.names` [N].

    Raises
    ------
    FeatureError
        When the window cannot be computed at that speed, the number of samples is wrong, or a
        value is not finite.
    """
    return _compute_each(_compute_one, tension_n, speed_m_s, rate_hz, window)


def smooth_over_distance(
    tension_n: ArrayLike, speed_m_s: float, rate_hz: float, window: SpatialWindow
) -> FloatArray:
    """Return the tension over the surface, smoothed over the finest scale with a Gaussian.

    Parameters and errors are the same as in `compute_spatial`. The result has shape (..., k) and
    contains the tension at the positions ``window.grid_m`` [N].
    """
    return _compute_each(_smooth_one, tension_n, speed_m_s, rate_hz, window)


def _compute_each(
    compute_one: Callable[[FloatArray, SpatialWindow, _Maps], FloatArray],
    tension_n: ArrayLike,
    speed_m_s: float,
    rate_hz: float,
    window: SpatialWindow,
) -> FloatArray:
    tension = np.asarray(tension_n, dtype=np.float64)
    count = window.sample_count(speed_m_s, rate_hz)
    if tension.ndim == 0 or tension.shape[-1] != count:
        raise FeatureError(
            f'a window of {window.length_m:g} m at {speed_m_s:g} m/s has {count} samples; '
            f'the shape is {tension.shape}'
        )
    if not np.isfinite(tension).all():
        raise FeatureError('the tension has values that are not finite')
    maps = _maps(window, speed_m_s / rate_hz, count)
    rows = np.ascontiguousarray(tension.reshape(-1, count))
    out = np.array([compute_one(row, window, maps) for row in rows])
    if not np.isfinite(out).all():
        raise FeatureError('the tension is too large for its features to be represented')
    return out.reshape(*tension.shape[:-1], -1)


class _Maps(NamedTuple):
    """Linear maps from samples to amplitudes and to the smoothed tension on the grid.

    ``cosine`` and ``sine`` have one row for each spatial frequency. For each grid point, ``first``
    contains the index of the first sample within the kernel, and ``weights`` has one row with the
    weights of this sample and the following ones.
    """

    cosine: FloatArray
    sine: FloatArray
    first: NDArray[np.intp]
    weights: FloatArray


@lru_cache(maxsize=4)
def _maps(window: SpatialWindow, step_m: float, count: int) -> _Maps:
    # The samples cover slightly more than the window, which lies in their middle.
    at_m = step_m * np.arange(count)
    at_m -= (at_m[-1] - window.length_m) / 2.0
    inside = (at_m > 0.0) & (at_m < window.length_m)
    hann = np.where(inside, np.sin(np.pi * at_m / window.length_m) ** 2, 0.0)
    cycles = np.arange(1, window.component_count + 1)[:, None] / window.length_m
    phase = 2.0 * np.pi * cycles * at_m
    weight = 2.0 * hann / hann.sum()
    # After weighting, a constant tension would contribute to component 1. This is corrected here.
    level = np.ones(count) / count
    cosine, sine = weight * np.cos(phase), weight * np.sin(phase)
    cosine -= cosine.sum(axis=1, keepdims=True) * level
    sine -= sine.sum(axis=1, keepdims=True) * level
    grid_m = window.grid_m
    reach_m = KERNEL_REACH * window.finest_m
    width = min(count, math.ceil(2.0 * reach_m / step_m) + 1)
    first = np.minimum(np.searchsorted(at_m, grid_m - reach_m), count - width)
    apart_m = at_m[first[:, None] + np.arange(width)] - grid_m[:, None]
    weights = np.exp(-0.5 * (apart_m / window.finest_m) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    return _Maps(cosine, sine, first, weights)


def _compute_one(tension_n: FloatArray, window: SpatialWindow, maps: _Maps) -> FloatArray:
    with np.errstate(over='ignore', invalid='ignore'):
        # With a large offset, differences to the first sample are exact, as in texture_spectrum.
        change = tension_n - tension_n[0]
        change -= change.mean()
        amplitude = np.hypot(maps.cosine @ change, maps.sine @ change)
        value = _smooth(change, maps)
        value -= value.mean()
        parts = [value]
        lags = [GRID_PER_SCALE * scale for scale in window.scales]
        parts += [value[lag:] - value[:-lag] for lag in lags]
        parts += [value[2 * lag :] - 2.0 * value[lag:-lag] + value[: -2 * lag] for lag in lags]
        quantiles = [_quantiles(part) for part in parts]
    return np.concatenate([amplitude, *quantiles])


def _smooth_one(tension_n: FloatArray, window: SpatialWindow, maps: _Maps) -> FloatArray:
    return np.asarray(tension_n[0] + _smooth(tension_n - tension_n[0], maps))


def _smooth(change: FloatArray, maps: _Maps) -> FloatArray:
    near = sliding_window_view(change, maps.weights.shape[1])[maps.first]
    return np.asarray((maps.weights * near).sum(axis=1))


def _quantiles(values: FloatArray) -> FloatArray:
    ordered = np.sort(values)
    place = np.linspace(0.0, len(ordered) - 1.0, QUANTILES)
    return np.asarray(np.interp(place, np.arange(len(ordered)), ordered))
