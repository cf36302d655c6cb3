# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of features: the interface that training, replay and the live node see."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.records import PHASE_GLIDE
from tactile_ros.configs import parameter

DETRENDS = ('none', 'mean', 'linear')
"""Trends to subtract before the transform of ``texture_spectrum``."""

WINDOWS = ('none', 'hann')
"""Weights of the samples before it."""

FloatArray = NDArray[np.float64]
RATE_TOLERANCE = 0.02
"""Largest deviation of the mean rate of a window from its nominal rate [1]: less than two bins
at the upper end of the spectrum of 180 samples."""


@dataclass(frozen=True)
class WindowParameters:
    """The part of a `FeatureConfig` that feature sets see; `FeatureConfig` checks it."""

    rate_hz: float = parameter(
        60.0,
        'nominal sample rate of the tension. The node takes the rate of the sensor instead, with '
        'windows of the same duration, unless models or another value than the default decide',
        unit='Hz',
        range=(1.0, 20000.0),
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
    early_windows: bool = parameter(
        False,
        'texture_spectrum, glide_waveform, hold_waveform: publish the window when its last sample '
        'has come; a refusal follows if its phase ends inside it',
    )


class Feature(NamedTuple):
    """Name and unit of one feature."""

    name: str
    unit: str


@dataclass(frozen=True)
class WindowSpec:
    """The samples of a phase that are its window.

    Attributes
    ----------
    crop_start_s, crop_end_s : float
        What is left out at the start of the phase and at its end [s].
    shortest_s : float
        The window is refused when the phase leaves less between its crops [s].
    sample_count : int
        Length of the window after the crop, in samples; 0: all samples between the crops.
    """

    crop_start_s: float
    crop_end_s: float
    shortest_s: float
    sample_count: int = 0


@dataclass(frozen=True, eq=False)
class WindowSamples:
    """The samples of one window, or of many windows that share their times.

    Attributes
    ----------
    time_ns : ndarray of int, shape (n,)
        Times of the samples [ns].
    tension_n : ndarray of shape (..., n)
        Tension [N]; finite.
    rate_hz : float
        Nominal sample rate [Hz].
    speed_m_s : float
        Sliding speed [m/s]; 0 where the set does not need it.
    """

    time_ns: NDArray[np.int64]
    tension_n: FloatArray
    rate_hz: float
    speed_m_s: float = 0.0


class FeatureSet(ABC):
    """A set of features, bound to the parameters of one configuration.

    A set in a package of yours is a subclass that its ``setup.py`` names in the entry point group
    ``tactile.feature_sets``, under the set's ``name``. See docs/feature_sets.md.

    Parameters
    ----------
    config : FeatureConfig
        Of it, a set sees the parameters that decide values.

    Attributes
    ----------
    name : str
    version : int
        Changes when values of the same name would come out different.
    phase : str
        The phase that holds the window: ``glide`` or ``hold``.
    needs_speed : bool
        Whether the features depend on the sliding speed.
    is_waveform : bool
        Whether the features are values of one signal in their order, for classifiers of its shape.
    can_be_early : bool
        Whether the first samples of a phase may be a window that is given out as soon as they are
        there: ``count_field`` is set, and the features need no more of the phase.
    cut : tuple of str
        Fields of `FeatureConfig` which say what part of the phase the window is. Ready-cut
        windows do not state them.
    options : tuple of str
        Fields of `FeatureConfig` which say what is computed.
    count_field : str
        The field of `FeatureConfig` with the number of samples in a window; empty: there is none,
        because the phase or the speed decides.
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
        """Return which samples of a phase are its window.

        Unless a set says otherwise: of a glide, ``sample_count`` samples between the crops of a
        texture window; of a hold, all between those of a stiffness window.

        Parameters
        ----------
        rate_hz : float
            Nominal sample rate [Hz].
        speed_m_s : float
            Sliding speed of the phase; 0: not known [m/s].

        Raises
        ------
        FeatureError
            When there is no window at that speed.
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
        """Return names and units of the features, in their order.

        Parameters
        ----------
        sample_count : int
            Samples in a window; 0 where that is not fixed.
        rate_hz : float
            Nominal sample rate [Hz].
        """

    @abstractmethod
    def compute(self, samples: WindowSamples) -> FloatArray:
        """Return the features of windows, of shape (..., k).

        A window must give the same bits alone and in a batch.

        Raises
        ------
        UndefinedFeatureError
            When a window has no value; of a batch, its ``windows`` are their places.
        FeatureError
            When the samples do not fit.
        """

    @property
    def is_early(self) -> bool:
        """True if a window is given out with its last sample, before the phase ends."""
        return self.can_be_early and self.config.early_windows

    @property
    def sample_count(self) -> int:
        """Samples in a window of this configuration; 0: the phase or the speed decides."""
        return int(getattr(self.config, self.count_field)) if self.count_field else 0


def glide_window(config: WindowParameters, sample_count: int, rate_hz: float) -> WindowSpec:
    """Return a window of a glide, between the crops of a texture window.

    Without a number of samples it is all between them, and at least ``texture_samples``.
    """
    count = sample_count or config.texture_samples
    shortest_s = (count - 1) / rate_hz * (1 - RATE_TOLERANCE)
    return WindowSpec(
        config.texture_crop_start_s, config.texture_crop_end_s, shortest_s, sample_count
    )
