# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the feature node: the cut of windows and their features, free of ROS."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import FeatureSet, WindowParameters
from tactile_features.feature_sets.registry import check_choice, CHOOSER
from tactile_features.records import (
    CONTACT_ABDUCTION,
    CONTACT_FLEXION,
    PHASE_GLIDE,
    PHASE_HOLD,
    PHASES_STATED,
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
    SET_STIFFNESS_REGRESSION,
    SET_TEXTURE_SPECTRUM,
)
from tactile_ros.configs import check_parameters, parameter

MIN_DETECTION_HZ = 20.0
"""Slowest sensor in whose tension phases are found."""


@dataclass(frozen=True)
class FeatureConfig(WindowParameters):
    """Cut of windows from the phases of a trial, and their features.

    Raises
    ------
    FeatureError
        When a value is out of its range or the buffer cannot hold a window.
    """

    texture_features: str = parameter(
        SET_TEXTURE_SPECTRUM,
        'features of a glide: texture_spectrum, amplitudes over a fixed time; texture_spatial, '
        'over a stretch of surface at any sliding speed, which trial events must then state; '
        'glide_waveform and spatial_waveform, the tension itself over time and over the surface; '
        'or a set of another package',
    )
    stiffness_features: str = parameter(
        SET_STIFFNESS_REGRESSION,
        'features of a hold: stiffness_regression, the line through the tension; '
        'stiffness_relaxation, the line and its slope over its intercept; hold_waveform, '
        'the tension itself; or a set of another package',
    )
    samples_timeout_s: float = parameter(
        5.0,
        'a window is refused when no samples come for so long after its phase has ended',
        unit='s',
        range=(0.5, 600.0),
    )
    max_stamp_error_share: float = parameter(
        0.01,
        'largest error of stamps, as a share of the window, or of ten times the crop at its start '
        'where that is shorter; a larger one refuses the window',
        unit='1',
        range=(0.0001, 1.0),
    )
    accept_unknown_stamp_error: bool = parameter(
        True,
        'accept windows of samples whose stamp error is not known, as of a device without a clock',
    )
    buffer_s: float = parameter(
        120.0,
        'how long samples wait for the events of their trial, and events for samples',
        unit='s',
        range=(1.0, 600.0),
    )
    phases: str = parameter(
        PHASES_STATED,
        'where the phases of a trial come from: stated by trial events, or found in the tension '
        'of a finger that follows the texture or the stiffness protocol',
        choices=(PHASES_STATED, PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS),
    )
    detected_rise_n: float = parameter(
        0.2,
        'with phases found in the tension: what it must rise above rest to begin a trial',
        unit='N',
        range=(0.0001, 1e6),
    )
    detected_object_label: str = parameter(
        '',
        'with phases found in the tension: what lies under the finger, in recordings to train on',
    )
    detected_session_id: str = parameter(
        '', 'with phases found in the tension: the session, in recordings to train on'
    )
    detected_glide_speed_m_s: float = parameter(
        0.0,
        'with phases found in the tension: sliding speed of their glides; 0: not known',
        unit='m/s',
        range=(0.0, 1.0),
    )
    detected_contact: str = parameter(
        '',
        'with phases found in the tension: how the finger touches; empty: not known',
        choices=('', CONTACT_FLEXION, CONTACT_ABDUCTION),
    )
    frame_id: str = parameter('tendon_sensor_link', 'frame of the sensor')

    def __post_init__(self) -> None:
        check_parameters(self, FeatureError)
        if self.phases != PHASES_STATED and self.rate_hz < MIN_DETECTION_HZ:
            raise FeatureError(
                f'rate_hz is {self.rate_hz:g}; phases are found in a tension of at least '
                f'{MIN_DETECTION_HZ:g} Hz'
            )
        self.feature_set(PHASE_GLIDE)
        self.feature_set(PHASE_HOLD)
        texture_s = self.texture_crop_start_s + self.texture_samples / self.rate_hz
        stiffness_s = self.stiffness_settle_s + self.stiffness_min_s
        if max(texture_s, stiffness_s) > self.buffer_s:
            raise FeatureError(
                f'buffer_s is {self.buffer_s}, which cannot hold a window that ends '
                f'{max(texture_s, stiffness_s):g} s after its phase began; raise buffer_s'
            )

    def at_rate(self, rate_hz: float) -> FeatureConfig:
        """Return these parameters for another sample rate [Hz]; windows keep their duration.

        FeatureError: the rate is out of its range.
        """
        scale = rate_hz / self.rate_hz
        return dataclasses.replace(
            self,
            rate_hz=rate_hz,
            texture_samples=max(2, round(scale * self.texture_samples)),
            stiffness_samples=max(9, round(scale * self.stiffness_samples)),
        )

    def without_detection(self) -> FeatureConfig:
        """Return these parameters as if phases were stated: what windows can share."""
        found: dict[str, Any] = {
            item.name: item.default
            for item in dataclasses.fields(self)
            if item.name.startswith('detected_')
        }
        return dataclasses.replace(self, phases=PHASES_STATED, **found)

    def feature_set(self, phase: str) -> FeatureSet:
        """Return the feature set of a glide or a hold.

        Raises
        ------
        FeatureError
            When there is none of that name, or its parameters do not fit.
        """
        return _bind(self, phase)


@dataclass(frozen=True)
class FeaturesNodeConfig(FeatureConfig):
    """Parameters of the feature node: the model files that decide, and `FeatureConfig`."""

    models: str = parameter(
        '',
        'folder with model files (*.npz), or one file, whose features are computed; empty: the '
        'parameters of this node decide',
    )
    contact: str = parameter(
        '',
        'take no models of another contact than this; empty: take those of any',
        choices=('', CONTACT_FLEXION, CONTACT_ABDUCTION),
    )

    def shared(self) -> FeatureConfig:
        """Return the parameters that windows depend on: all but ``models`` and ``contact``."""
        names = (item.name for item in dataclasses.fields(FeatureConfig))
        return FeatureConfig(**{name: getattr(self, name) for name in names})


def round_rate(rate_hz: float) -> float:
    """Return a measured rate [Hz] with three digits, unless that changes it by 0.1 % or more."""
    short = float(f'{rate_hz:.3g}')
    return short if abs(short / rate_hz - 1.0) < 1e-3 else float(f'{rate_hz:.6g}')


@lru_cache(maxsize=64)
def _bind(config: FeatureConfig, phase: str) -> FeatureSet:
    parameter = CHOOSER[phase]
    return check_choice(parameter, getattr(config, parameter), phase)(config)
