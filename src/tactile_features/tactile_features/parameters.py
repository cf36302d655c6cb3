# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the feature node that decide which samples are a window, and its values."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.configs import parameter

DETRENDS = ('none', 'mean', 'linear')
"""Trends to subtract before the transform of ``texture_spectrum``."""

WINDOWS = ('none', 'hann')
"""Weights of the samples before it."""


@dataclass(frozen=True)
class WindowParameters:
    """The part of a `FeatureConfig` that feature sets see; `FeatureConfig` checks it."""

    rate_hz: float = parameter(
        60.0, 'nominal sample rate of the tension', unit='Hz', range=(1.0, 20000.0)
    )
    texture_samples: int = parameter(
        180, 'samples in a texture window', unit='1', range=(2, 1000000)
    )
    texture_crop_start_s: float = parameter(
        0.6,
        'flat section that is left out at the start of the glide',
        unit='s',
        range=(0.0, 60.0),
    )
    texture_crop_end_s: float = parameter(
        0.1,
        'a texture window must end this long before the glide does',
        unit='s',
        range=(0.0, 60.0),
    )
    spectrum_detrend: str = parameter(
        'linear',
        'with texture_spectrum: what is subtracted before the transform, the mean or the '
        'least-squares line; mean is what the paper does',
        choices=DETRENDS,
    )
    spectrum_window: str = parameter(
        'none',
        'with texture_spectrum: window function before the transform',
        choices=WINDOWS,
    )
    spatial_crop_m: float = parameter(
        0.009,
        'with features over the surface: path that is left out at the start of the glide',
        unit='m',
        range=(0.0, 2.0),
    )
    spatial_length_m: float = parameter(
        0.045,
        'with features over the surface: path over the surface that is one window',
        unit='m',
        range=(0.0001, 2.0),
    )
    spatial_finest_m: float = parameter(
        0.0005,
        'with features over the surface: finest scale; samples must not be further apart on it',
        unit='m',
        range=(0.00001, 0.5),
    )
    stiffness_settle_s: float = parameter(
        0.5,
        'dynamic deformation that is left out at the start of the hold',
        unit='s',
        range=(0.0, 60.0),
    )
    stiffness_crop_end_s: float = parameter(
        0.1, 'what is left out at the end of the hold', unit='s', range=(0.0, 60.0)
    )
    stiffness_samples: int = parameter(
        180, 'with hold_waveform: samples in a window', unit='1', range=(9, 1000000)
    )
    stiffness_min_s: float = parameter(
        2.0, 'shortest stiffness window', unit='s', range=(0.05, 60.0)
    )
    max_gap_samples: int = parameter(
        0,
        'longest run of lost samples that is interpolated linearly; 0 rejects any loss',
        unit='1',
        range=(0, 1000),
    )
