# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What a vector of features is: the one description that node and model file compare."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
import hashlib
import json
import math
from types import MappingProxyType
from typing import Any

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.records import (
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
    SET_STIFFNESS_REGRESSION,
    SET_TEXTURE_SPATIAL,
    SET_TEXTURE_SPECTRUM,
)
from tactile_features.regression import REGRESSION_NAMES, REGRESSION_UNITS
from tactile_features.spatial import SpatialWindow
from tactile_features.spectrum import spectrum_names

TEXTURE_VERSION = 2
SPATIAL_VERSION = 1
STIFFNESS_VERSION = 2

_CUTS = {
    SET_TEXTURE_SPECTRUM: ('texture_crop_start_s', 'max_gap_samples'),
    SET_TEXTURE_SPATIAL: (
        'spatial_crop_m',
        'spatial_length_m',
        'spatial_finest_m',
        'max_gap_samples',
    ),
    SET_STIFFNESS_REGRESSION: ('stiffness_settle_s', 'stiffness_crop_end_s', 'max_gap_samples'),
}
"""What the parameters of each set may be: a file from elsewhere sets nothing but these."""

_DIGEST_DIGITS = 16


@dataclass(frozen=True)
class FeatureSpec:
    """A feature set as it comes out of one configuration.

    Attributes
    ----------
    feature_set : str
        One of the SET_ constants.
    version : int
        Changes when values of the same name would come out different.
    rate_hz : float
        Nominal sample rate of the window [Hz].
    sample_count : int
        Samples in a window; 0 where the phase or the sliding speed decides.
    names, units : tuple of str
        One a feature.
    parameters : mapping of str to float
        Which part of the phase the window is and which losses are filled, by the names of
        `FeatureConfig`. Empty for arrays of ready-cut windows. What refuses a window but
        changes no value is not among them.
    """

    feature_set: str
    version: int
    rate_hz: float
    sample_count: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """The first 16 hex digits of the SHA-256 of the specification as canonical JSON.

        Canonical: keys in order, no spaces, ASCII, each number as the shortest text of its
        double. So it is the same on every platform, and for 60 as for 60.0.
        """
        values = {
            **self.to_dict(),
            'version': int(self.version),
            'sample_count': int(self.sample_count),
            'rate_hz': float(self.rate_hz),
            # The sum takes the sign from a zero.
            'parameters': {name: float(value) + 0.0 for name, value in self.parameters.items()},
        }
        text = json.dumps(values, sort_keys=True, separators=(',', ':'), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()[:_DIGEST_DIGITS]

    @property
    def missing_parameters(self) -> tuple[str, ...]:
        """What a feature node's specification states and this one does not."""
        return tuple(n for n in _CUTS.get(self.feature_set, ()) if n not in self.parameters)

    def to_dict(self) -> dict[str, Any]:
        """Return the specification as plain JSON types."""
        return {
            'feature_set': self.feature_set,
            'version': self.version,
            'rate_hz': self.rate_hz,
            'sample_count': self.sample_count,
            'names': list(self.names),
            'units': list(self.units),
            'parameters': dict(self.parameters),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FeatureSpec:
        """Return the specification that `to_dict` wrote.

        Raises
        ------
        FeatureError
            When an entry is missing or of the wrong type.
        """
        try:
            parameters = {str(k): float(v) for k, v in data['parameters'].items()}
            if not parameters.get('max_gap_samples', 0.0).is_integer():
                raise ValueError(f'max_gap_samples is {parameters["max_gap_samples"]}')
            return cls(
                feature_set=str(data['feature_set']),
                version=int(data['version']),
                rate_hz=float(data['rate_hz']),
                sample_count=int(data['sample_count']),
                names=tuple(str(name) for name in data['names']),
                units=tuple(str(unit) for unit in data['units']),
                parameters=parameters,
            )
        except KeyError as error:
            raise FeatureError(f'the feature specification has no entry {error}') from error
        except (AttributeError, TypeError, ValueError) as error:
            raise FeatureError(f'the feature specification cannot be read: {error}') from error

    def config_values(self) -> dict[str, Any]:
        """Return what a `FeatureConfig` must say, by its fields' names, to yield these features.

        What ready-cut windows do not know, how they were cut, is left out.
        """
        values: dict[str, Any] = {'rate_hz': self.rate_hz}
        if self.feature_set in (SET_TEXTURE_SPECTRUM, SET_TEXTURE_SPATIAL):
            values['texture_features'] = self.feature_set
        if self.feature_set == SET_TEXTURE_SPECTRUM:
            values['texture_samples'] = self.sample_count
        for name in _CUTS.get(self.feature_set, ()):
            if name in self.parameters:
                value = self.parameters[name]
                values[name] = int(value) if name == 'max_gap_samples' else value
        return values

    def mismatch(self, other: FeatureSpec) -> str:
        """Return why features of ``other`` must not be taken for these, or an empty string.

        A parameter that only one of the two states is not compared: ready-cut
        windows do not know how they were cut.
        """
        pairs = [
            ('feature set', self.feature_set, other.feature_set),
            ('version of the feature set', self.version, other.version),
            ('rate in Hz', self.rate_hz, other.rate_hz),
            ('window in samples', self.sample_count, other.sample_count),
        ]
        pairs += [
            (f'window ({name})', self.parameters[name], other.parameters[name])
            for name in self.parameters
            if name in other.parameters
        ]
        for what, mine, theirs in pairs:
            if mine != theirs:
                return f'the {what} differs: {mine} here, {theirs} there'
        if self.names != other.names or self.units != other.units:
            return 'the names or units of the features differ'
        return ''


def texture_spec(config: FeatureConfig) -> FeatureSpec:
    """Return what the texture features of ``config`` are."""
    if config.texture_features == SET_TEXTURE_SPATIAL:
        crop = {
            'spatial_crop_m': config.spatial_crop_m,
            'max_gap_samples': config.max_gap_samples,
        }
        return spatial_spec(config.rate_hz, config.spatial_window(), crop)
    return _texture(
        config.rate_hz,
        config.texture_samples,
        {
            'texture_crop_start_s': config.texture_crop_start_s,
            'max_gap_samples': config.max_gap_samples,
        },
    )


def _texture(rate_hz: float, sample_count: int, parameters: dict[str, float]) -> FeatureSpec:
    names = spectrum_names(sample_count, rate_hz)
    return FeatureSpec(
        feature_set=SET_TEXTURE_SPECTRUM,
        version=TEXTURE_VERSION,
        rate_hz=float(rate_hz),
        sample_count=sample_count,
        names=names,
        units=('N',) * len(names),
        parameters=parameters,
    )


def spatial_spec(
    rate_hz: float, window: SpatialWindow, parameters: Mapping[str, float] = MappingProxyType({})
) -> FeatureSpec:
    """Return what the features of a stretch of surface are.

    Parameters
    ----------
    rate_hz : float
        Sample rate [Hz].
    window : SpatialWindow
    parameters : mapping of str to float, optional
        How the window was cut from the phase.
    """
    names = window.names()
    return FeatureSpec(
        feature_set=SET_TEXTURE_SPATIAL,
        version=SPATIAL_VERSION,
        rate_hz=float(rate_hz),
        sample_count=0,
        names=names,
        units=('N',) * len(names),
        parameters={
            'spatial_length_m': window.length_m,
            'spatial_finest_m': window.finest_m,
            **parameters,
        },
    )


def stiffness_spec(config: FeatureConfig) -> FeatureSpec:
    """Return what the stiffness features of ``config`` are."""
    return FeatureSpec(
        feature_set=SET_STIFFNESS_REGRESSION,
        version=STIFFNESS_VERSION,
        rate_hz=config.rate_hz,
        sample_count=0,
        names=REGRESSION_NAMES,
        units=REGRESSION_UNITS,
        parameters={
            'stiffness_settle_s': config.stiffness_settle_s,
            'stiffness_crop_end_s': config.stiffness_crop_end_s,
            'max_gap_samples': config.max_gap_samples,
        },
    )


def spec_for(task: str, config: FeatureConfig) -> FeatureSpec:
    """Return the specification for a task, ``texture`` or ``stiffness``.

    Raises
    ------
    FeatureError
        When the task is neither.
    """
    if task == PROTOCOL_TEXTURE:
        return texture_spec(config)
    if task == PROTOCOL_STIFFNESS:
        return stiffness_spec(config)
    raise FeatureError(f'there are no features for the task "{task}"; it is texture or stiffness')


def array_spec(task: str, sample_count: int, rate_hz: float) -> FeatureSpec:
    """Return the specification for ready-cut windows: without parameters of the cut.

    Raises
    ------
    FeatureError
        When the task is unknown or the rate is not positive.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise FeatureError(f'the rate is {rate_hz} Hz; it must be positive')
    if task == PROTOCOL_TEXTURE:
        return _texture(rate_hz, sample_count, {})
    return dataclasses.replace(
        spec_for(task, FeatureConfig()), rate_hz=float(rate_hz), parameters={}
    )
