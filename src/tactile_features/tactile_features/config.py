# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the feature node: windows and feature sets, without ROS."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import FeatureSet, WindowParameters
from tactile_features.feature_sets.registry import check_choice, CHOOSER
from tactile_features.types import (
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
"""Lowest sample rate at which phases can be detected in the tension [Hz]."""


@dataclass(frozen=True)
class FeatureConfig(WindowParameters):
    """Parameters of the windows that are cut from the phases of a trial, and of their features.

    Raises
    ------
    FeatureError
        When a value is out of range, or a window does not fit into the buffer.
    """

    texture_features: str = parameter(
        SET_TEXTURE_SPECTRUM,
        'features of a glide: texture_spectrum, amplitudes over a fixed time; texture_spatial, '
        'features over a distance at any sliding speed that the trial events state; '
        'glide_waveform and spatial_waveform, the tension itself over time or over distance; '
        'or a feature set of another package',
    )
    stiffness_features: str = parameter(
        SET_STIFFNESS_REGRESSION,
        'features of a hold: stiffness_regression, a line fitted to the tension; '
        'stiffness_relaxation, the fitted line and the ratio of slope to intercept; '
        'hold_waveform, the tension itself; or a feature set of another package',
    )
    samples_timeout_s: float = parameter(
        5.0,
        'time to wait for missing samples after the end of a phase; then its window is refused',
        unit='s',
        range=(0.5, 600.0),
    )
    max_stamp_error_share: float = parameter(
        0.01,
        'largest permitted stamp error, as a fraction of the window length or, if shorter, '
        'of ten times the crop at its start; a window with a larger error is refused',
        unit='1',
        range=(0.0001, 1.0),
    )
    accept_unknown_stamp_error: bool = parameter(
        True,
        'accept windows whose stamp error is unknown, for example of a device without a clock',
    )
    buffer_s: float = parameter(
        120.0,
        'longest time that samples wait for trial events, and trial events for samples',
        unit='s',
        range=(1.0, 600.0),
    )
    phases: str = parameter(
        PHASES_STATED,
        'source of the phases of a trial: stated by trial events, or detected in the tension '
        'of a finger that follows the texture or the stiffness protocol',
        choices=(PHASES_STATED, PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS),
    )
    detected_rise_n: float = parameter(
        0.2,
        'detected phases: a trial begins when the tension rises this far above its rest level',
        unit='N',
        range=(0.0001, 1e6),
    )
    detected_object_label: str = parameter(
        '',
        'detected phases: label of the object under the finger, for recordings to train on',
    )
    detected_session_id: str = parameter(
        '', 'detected phases: identifier of the session, for recordings to train on'
    )
    detected_glide_speed_m_s: float = parameter(
        0.0,
        'detected phases: sliding speed of the glides; 0 if unknown',
        unit='m/s',
        range=(0.0, 1.0),
    )
    detected_contact: str = parameter(
        '',
        'detected phases: contact of the finger; empty if unknown',
        choices=('', CONTACT_FLEXION, CONTACT_ABDUCTION),
    )
    frame_id: str = parameter('tendon_sensor_link', 'frame of the sensor')

    def __post_init__(self) -> None:
        check_parameters(self, FeatureError)
        if self.phases != PHASES_STATED and self.rate_hz < MIN_DETECTION_HZ:
            raise FeatureError(
                f'rate_hz is {self.rate_hz:g}; detecting phases in the tension needs at least '
                f'{MIN_DETECTION_HZ:g} Hz'
            )
        self.feature_set(PHASE_GLIDE)
        self.feature_set(PHASE_HOLD)
        texture_s = self.texture_crop_start_s + self.texture_samples / self.rate_hz
        stiffness_s = self.stiffness_settle_s + self.stiffness_min_s
        if max(texture_s, stiffness_s) > self.buffer_s:
            raise FeatureError(
                f'buffer_s is {self.buffer_s}, but a window ends '
                f'{max(texture_s, stiffness_s):g} s after the start of its phase; raise buffer_s'
            )

    def at_rate(self, rate_hz: float) -> FeatureConfig:
        """Return these parameters for another sample rate [Hz]; windows keep their duration.

        Raises FeatureError if the rate is out of range.
        """
        scale = rate_hz / self.rate_hz
        return dataclasses.replace(
            self,
            rate_hz=rate_hz,
            texture_samples=max(2, round(scale * self.texture_samples)),
            stiffness_samples=max(9, round(scale * self.stiffness_samples)),
        )

    def without_detection(self) -> FeatureConfig:
        """Return a copy that does not detect phases; ``detected_*`` parameters have defaults."""
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
            When the feature set does not exist, or its parameters are invalid.
        """
        return _bind(self, phase)


@dataclass(frozen=True)
class FeaturesNodeConfig(FeatureConfig):
    """Parameters of the feature node: model files that choose features, and `FeatureConfig`."""

    models: str = parameter(
        '',
        'folder with model files (*.npz), or one file, that choose the features to compute; '
        'if empty, the parameters of this node choose them',
    )
    contact: str = parameter(
        '',
        'use only models of this contact; if empty, use models of any contact',
        choices=('', CONTACT_FLEXION, CONTACT_ABDUCTION),
    )

    def shared(self) -> FeatureConfig:
        """Return the parameters that affect windows: all except ``models`` and ``contact``."""
        names = (item.name for item in dataclasses.fields(FeatureConfig))
        return FeatureConfig(**{name: getattr(self, name) for name in names})


def round_rate(rate_hz: float) -> float:
    """Round a rate [Hz] to three digits, or to six if this changes it by 0.1 % or more."""
    short = float(f'{rate_hz:.3g}')
    return short if abs(short / rate_hz - 1.0) < 1e-3 else float(f'{rate_hz:.6g}')


@lru_cache(maxsize=64)
def _bind(config: FeatureConfig, phase: str) -> FeatureSet:
    parameter = CHOOSER[phase]
    return check_choice(parameter, getattr(config, parameter), phase)(config)
