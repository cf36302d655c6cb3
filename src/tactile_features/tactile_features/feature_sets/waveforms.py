# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Waveforms: the tension itself, including its level, for classifiers that learn its shape."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactile_features.feature_sets.feature_set import (
    Feature,
    FeatureSet,
    FloatArray,
    RATE_TOLERANCE,
    WindowSamples,
    WindowSpec,
)
from tactile_features.feature_sets.texture_spatial import smooth_over_distance, TextureSpatial
from tactile_features.types import PHASE_GLIDE, PHASE_HOLD

GLIDE_PARTS = 600
"""Largest number of values of a glide. More values would make model files too large and training
too slow. For 3 s of samples, averages over 5 ms keep the shape up to 100 Hz."""

HOLD_PARTS = 100
"""Largest number of values of a hold. Relaxation is slow, and averages contain less noise."""


class GlideWaveform(FeatureSet):
    """The tension of a glide over a fixed time, as the means of at most 600 equal parts."""

    name = 'glide_waveform'
    version = 1
    phase = PHASE_GLIDE
    is_waveform = True
    can_be_early = True
    cut = ('texture_crop_start_s', 'max_gap_samples')
    count_field = 'texture_samples'

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        parts = min(sample_count, GLIDE_PARTS)
        per_part = sample_count / parts
        return tuple(
            Feature(f'tension__waveform__s_{i * per_part / rate_hz:.4f}', 'N')
            for i in range(parts)
        )

    def compute(self, samples: WindowSamples) -> FloatArray:
        return average_parts(samples.tension_n, GLIDE_PARTS)


class SpatialWaveform(TextureSpatial):
    """The tension over a stretch of surface, smoothed over the finest scale."""

    name = 'spatial_waveform'
    version = 1
    is_waveform = True

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        return tuple(
            Feature(f'tension__waveform__mm_{1e3 * at_m:.4f}', 'N') for at_m in self.stretch.grid_m
        )

    def compute(self, samples: WindowSamples) -> FloatArray:
        return smooth_over_distance(
            samples.tension_n, samples.speed_m_s, samples.rate_hz, self.stretch
        )


class HoldWaveform(FeatureSet):
    """The tension of a hold over a fixed time, as the means of at most 100 equal parts."""

    name = 'hold_waveform'
    version = 1
    phase = PHASE_HOLD
    is_waveform = True
    can_be_early = True
    cut = ('stiffness_settle_s', 'max_gap_samples')
    count_field = 'stiffness_samples'

    def window(self, rate_hz: float, speed_m_s: float) -> WindowSpec:
        shortest_s = (self.sample_count - 1) / rate_hz * (1 - RATE_TOLERANCE)
        return dataclasses.replace(super().window(rate_hz, speed_m_s), shortest_s=shortest_s)

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        parts = min(sample_count, HOLD_PARTS)
        step_s = sample_count / (parts * rate_hz)
        return tuple(Feature(f'tension__waveform__s_{i * step_s:.4f}', 'N') for i in range(parts))

    def compute(self, samples: WindowSamples) -> FloatArray:
        return average_parts(samples.tension_n, HOLD_PARTS)


def average_parts(tension_n: FloatArray, parts: int) -> FloatArray:
    """Return the means of equal parts of windows.

    A sample on the border of two parts is divided between them. Windows that have no more
    samples than parts are returned unchanged.

    Parameters
    ----------
    tension_n : ndarray of shape (..., n)
        Tension [N]; must be finite.
    parts : int

    Returns
    -------
    ndarray of shape (..., min(n, parts))
        Mean tension of each part [N].
    """
    n = tension_n.shape[-1]
    if n <= parts:
        return tension_n.copy()
    first = tension_n[..., :1]
    # With a large offset, differences to the first sample are exact.
    change = tension_n - first
    edges = np.arange(parts + 1) * n / parts
    at = np.minimum(edges.astype(np.intp), n - 1)
    sums = np.zeros((*tension_n.shape[:-1], n + 1))
    np.cumsum(change, axis=-1, out=sums[..., 1:])
    upto = sums[..., at] + (edges - at) * change[..., at]
    means: FloatArray = first + np.diff(upto) * (parts / n)
    return means
