# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interface of feature sets for training, replay and the live node."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.types import PHASE_GLIDE
from tactile_ros.configs import parameter

DETRENDS = ('none', 'mean', 'linear')
"""Options of ``texture_spectrum``: trend to subtract before the transform."""

WINDOWS = ('none', 'hann')
"""Options of ``texture_spectrum``: window function applied before the transform."""

FloatArray = NDArray[np.float64]
RATE_TOLERANCE = 0.02
"""Largest relative deviation of the mean rate of a window from its nominal rate [1]. A deviation
of this size shifts the upper end of the spectrum of 180 samples by less than two bins."""


@dataclass(frozen=True)
class WindowParameters:
    """The fields of a `FeatureConfig` that feature sets use; `FeatureConfig` checks them."""

    rate_hz: float = parameter(
        60.0,
        'nominal sample rate of the tension. If this is the default and no models are given, the '
        'node uses the rate of the sensor instead; windows keep their duration',
        unit='Hz',
        range=(1.0, 20000.0),
    )
    texture_samples: int = parameter(
        180, 'samples in a texture window', unit='1', range=(2, 1000000)
    )
    texture_crop_start_s: float = parameter(
        0.6,
        'crop at the start of the glide',
        unit='s',
        range=(0.0, 60.0),
    )
    texture_crop_end_s: float = parameter(
        0.1,
        'crop at the end of the glide; a texture window must end before the crop',
        unit='s',
        range=(0.0, 60.0),
    )
    spectrum_detrend: str = parameter(
        'linear',
        'texture_spectrum: subtract the mean or the least-squares line before the transform; '
        'the paper subtracts the mean',
        choices=DETRENDS,
    )
    spectrum_window: str = parameter(
        'none',
        'texture_spectrum: window function before the transform',
        choices=WINDOWS,
    )
    spatial_crop_m: float = parameter(
        0.009,
        'features over distance: distance that is cropped at the start of the glide',
        unit='m',
        range=(0.0, 2.0),
    )
    spatial_length_m: float = parameter(
        0.045,
        'features over distance: length of a window along the surface',
        unit='m',
        range=(0.0001, 2.0),
    )
    spatial_finest_m: float = parameter(
        0.0005,
        'features over distance: finest scale; the distance between samples must not exceed it',
        unit='m',
        range=(0.00001, 0.5),
    )
    stiffness_settle_s: float = parameter(
        0.5,
        'crop at the start of the hold, for the dynamic deformation',
        unit='s',
        range=(0.0, 60.0),
    )
    stiffness_crop_end_s: float = parameter(
        0.1, 'crop at the end of the hold', unit='s', range=(0.0, 60.0)
    )
    stiffness_samples: int = parameter(
        180, 'hold_waveform: samples in a window', unit='1', range=(9, 1000000)
    )
    stiffness_min_s: float = parameter(
        2.0, 'shortest stiffness window', unit='s', range=(0.05, 60.0)
    )
    max_gap_samples: int = parameter(
        0,
        'largest number of consecutive lost samples that are interpolated linearly; if more are '
        'lost, the window is refused',
        unit='1',
        range=(0, 1000),
    )
    early_windows: bool = parameter(
        False,
        'texture_spectrum, glide_waveform, hold_waveform: publish a window as soon as its last '
        'sample has arrived; a refusal follows if the phase ends inside the window',
    )


class Feature(NamedTuple):
    """Name and unit of one feature."""

    name: str
    unit: str


@dataclass(frozen=True)
class WindowSpec:
    """Position of a window within its phase.

    Attributes
    ----------
    crop_start_s, crop_end_s : float
        Time that is left out at the start and at the end of the phase [s].
    shortest_s : float
        If the part of the phase between the crops is shorter than this, the window is refused
        [s].
    sample_count : int
        Number of samples in the window, which begins after the crop at the start; 0 for all
        samples between the crops.
    """

    crop_start_s: float
    crop_end_s: float
    shortest_s: float
    sample_count: int = 0


@dataclass(frozen=True, eq=False)
class WindowSamples:
    """The samples of one window, or of several windows with common sample times.

    Attributes
    ----------
    time_ns : ndarray of int, shape (n,)
        Times of the samples [ns].
    tension_n : ndarray of shape (..., n)
        Tension [N], finite and in C order.
    rate_hz : float
        Nominal sample rate [Hz].
    speed_m_s : float
        Sliding speed [m/s]; 0 if the feature set does not need it.
    """

    time_ns: NDArray[np.int64]
    tension_n: FloatArray
    rate_hz: float
    speed_m_s: float = 0.0


class FeatureSet(ABC):
    """A feature set with the parameters of one configuration.

    To add a feature set in another package, derive a class from this one. Register it in the
    ``setup.py`` of that package, in the entry point group ``tactile.feature_sets``, under the
    ``name`` of the class. See docs/feature_sets.md.

    Parameters
    ----------
    config : FeatureConfig
        Parameters of the windows. A feature set uses only those that affect its values.

    Attributes
    ----------
    name : str
    version : int
        Must be increased whenever a change of the code changes the values of the features.
    phase : str
        The phase that contains the window: ``glide`` or ``hold``.
    needs_speed : bool
        True if the features depend on the sliding speed.
    is_waveform : bool
        True if the features are consecutive values of one signal, for classifiers of its shape.
    can_be_early : bool
        True if the window may be returned as soon as its last sample has arrived, before the
        phase ends. Requires ``count_field``, and features that need no later samples.
    cut : tuple of str
        Fields of `FeatureConfig` for the position of the window within the phase. They are left
        out of the specification of windows that are already cut.
    options : tuple of str
        Fields of `FeatureConfig` that affect the computation of the features.
    count_field : str
        The field of `FeatureConfig` with the number of samples in a window; empty if this number
        depends on the phase or on the speed.
    """

    name: ClassVar[str]
    version: ClassVar[int]
    phase: ClassVar[str]
    needs_speed: ClassVar[bool] = False
    is_waveform: ClassVar[bool] = False
    can_be_early: ClassVar[bool] = False
    cut: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[tuple[str, ...]] = ()
    count_field: ClassVar[str] = ''

    def __init__(self, config: WindowParameters) -> None:
        self.config = config

    def window(self, rate_hz: float, speed_m_s: float) -> WindowSpec:
        """Return the position of the window within its phase.

        By default, the window of a glide has ``sample_count`` samples between the crops of a
        texture window. The window of a hold is between the crops of a stiffness window. If
        ``sample_count`` is 0, the window has all samples between its crops.

        Parameters
        ----------
        rate_hz : float
            Nominal sample rate [Hz].
        speed_m_s : float
            Sliding speed of the phase [m/s]; 0 if unknown.

        Raises
        ------
        FeatureError
            When the feature set has no window at that speed.
        """
        if self.phase == PHASE_GLIDE:
            return glide_window(self.config, self.sample_count, rate_hz)
        return WindowSpec(
            self.config.stiffness_settle_s,
            self.config.stiffness_crop_end_s,
            self.config.stiffness_min_s,
            self.sample_count,
        )

    @abstractmethod
    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        """Return names and units of the features, in the order of the values.

        Parameters
        ----------
        sample_count : int
            Samples in a window; 0 if that number is not fixed.
        rate_hz : float
            Nominal sample rate [Hz].
        """

    @abstractmethod
    def compute(self, samples: WindowSamples) -> FloatArray:
        """Return the features of windows, of shape (..., k).

        A single window must give the same bits as the same window in a batch.

        Raises
        ------
        UndefinedFeatureError
            When a feature of a window is undefined. ``windows`` contains the indices of all such
            windows.
        FeatureError
            When the samples are invalid.
        """

    @property
    def is_early(self) -> bool:
        """True if a window is returned with its last sample, before the phase ends."""
        return self.can_be_early and self.config.early_windows

    @property
    def sample_count(self) -> int:
        """Number of samples in a window; 0 if it depends on the phase or on the speed."""
        return int(getattr(self.config, self.count_field)) if self.count_field else 0


def glide_window(config: WindowParameters, sample_count: int, rate_hz: float) -> WindowSpec:
    """Return the position of a window between the crops of a texture window.

    If ``sample_count`` is 0, the window has all samples between the crops. These must be at least
    ``texture_samples``.
    """
    count = sample_count or config.texture_samples
    shortest_s = (count - 1) / rate_hz * (1 - RATE_TOLERANCE)
    return WindowSpec(
        config.texture_crop_start_s, config.texture_crop_end_s, shortest_s, sample_count
    )
