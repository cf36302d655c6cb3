# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Specifications of features. They show whether a model fits the windows of a feature node."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import dataclasses
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
import hashlib
import json
import math
from typing import Any

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import FeatureSet
from tactile_features.feature_sets.registry import (
    CHOOSER,
    find_feature_set,
    PHASE_OF_TASK,
    task_of,
)

EARLY = 'early_windows'
"""Parameter of the specification of early windows, which are returned before the phase ends."""

MEAN, ALL = 'mean', 'all'
"""Values of ``channel``: the mean of all channels, or the features of every channel."""

SAME_RATE = 1e-3
"""Two sample rates count as equal if their relative difference is smaller than this. Stamps cannot
show smaller differences."""

_DIGEST_DIGITS = 16

_MOST_CHANNELS = 8  # largest number of channels that a text lists by name


def is_same_rate(first_hz: float, second_hz: float) -> bool:
    """Return True if the relative difference of two sample rates [Hz] is below `SAME_RATE`."""
    return abs(first_hz - second_hz) < SAME_RATE * abs(second_hz)


def format_rates(first_hz: float, second_hz: float) -> tuple[str, str]:
    """Format two rates [Hz] with enough digits to show their difference, at least 6."""
    for digits in range(6, 17):
        texts = f'{first_hz:.{digits}g}', f'{second_hz:.{digits}g}'
        if texts[0] != texts[1]:
            break
    return texts


@dataclass(frozen=True)
class FeatureSpec:
    """Everything that determines the values of a vector of features.

    Attributes
    ----------
    feature_set : str
        Name of the feature set.
    version : int
        Version of the feature set; increased when the same features get other values.
    rate_hz : float
        Nominal sample rate of the window [Hz].
    sample_count : int
        Number of samples in a window; 0 if it depends on the phase or on the sliding speed.
    names, units : tuple of str
        One per feature.
    parameters : mapping of str to float or str
        Position of the window within the phase, gap policy, and options of the feature set. The
        keys are fields of `FeatureConfig`. If windows are already cut, only the options are
        included. Limits that refuse windows, but do not change values, are not included. If
        windows are early, ``early_windows`` is included with the value 1.
    channel : str
        For a recording with several channels, the name of the channel from which the features are
        computed, `MEAN` or `ALL`. Empty if the signal has only one channel, as in a live node.
    channels : tuple of str
        Names of all channels of the recording; empty if ``channel`` is empty.
    """

    feature_set: str
    version: int
    rate_hz: float
    sample_count: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    channel: str = ''
    channels: tuple[str, ...] = ()

    @cached_property
    def digest(self) -> str:
        """The first 16 hex digits of the SHA-256 of the specification as canonical JSON.

        Canonical JSON has sorted keys, no spaces and only ASCII; each number is written as the
        shortest text of its double. The digest is therefore the same on every platform, and the
        same for 60 and 60.0. Unused channels are ignored.
        """
        parameters = {  # adding 0.0 turns -0.0 into 0.0
            name: value if isinstance(value, str) else float(value) + 0.0
            for name, value in self.parameters.items()
        }
        values = {**self.to_dict(), 'parameters': parameters}
        if self.channel not in (MEAN, ALL):
            values.pop('channels', None)
        text = json.dumps(values, sort_keys=True, separators=(',', ':'), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()[:_DIGEST_DIGITS]

    @property
    def is_early(self) -> bool:
        """True if windows are returned with their last sample, before the phase ends."""
        return bool(self.parameters.get(EARLY))

    @property
    def missing_parameters(self) -> tuple[str, ...]:
        """Parameters that a specification of a feature node has, but this one does not have."""
        found = find_feature_set(self.feature_set)
        names = (*found.cut, *found.options) if found else ()
        return tuple(name for name in names if name not in self.parameters)

    def to_dict(self) -> dict[str, Any]:
        """Return the specification for JSON; without channels if the signal has only one."""
        values = dataclasses.asdict(self)
        if not self.channel:
            del values['channel'], values['channels']
        return values

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FeatureSpec:
        """Return the specification from a dictionary that `to_dict` wrote.

        Raises
        ------
        FeatureError
            When an entry is missing or of the wrong type.
        """
        try:
            parameters = {
                str(k): v if isinstance(v, str) else float(v)
                for k, v in data['parameters'].items()
            }
            if not float(parameters.get('max_gap_samples', 0.0)).is_integer():
                raise ValueError(f'max_gap_samples is {parameters["max_gap_samples"]}')
            rate_hz = float(data['rate_hz'])
            if not 0.0 < rate_hz < math.inf:
                raise ValueError(f'rate_hz is {rate_hz:g}')
            channel = str(data.get('channel', ''))
            channels = tuple(str(name) for name in data.get('channels', ()))
            if channel not in ((MEAN, ALL, *channels) if channels else ('',)):
                raise ValueError(f'channel is "{channel}", and channels are {channels}')
            return cls(
                feature_set=str(data['feature_set']),
                version=int(data['version']),
                rate_hz=rate_hz,
                sample_count=int(data['sample_count']),
                names=tuple(str(name) for name in data['names']),
                units=tuple(str(unit) for unit in data['units']),
                parameters=parameters,
                channel=channel,
                channels=channels,
            )
        except KeyError as error:
            raise FeatureError(f'the feature specification has no entry {error}') from error
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            raise FeatureError(f'the feature specification cannot be read: {error}') from error

    def config_values(self) -> dict[str, Any]:
        """Return the fields of `FeatureConfig` that yield these features.

        If the windows are already cut, their position within the phase is not known and is left
        out.
        """
        values: dict[str, Any] = {'rate_hz': self.rate_hz}
        found = find_feature_set(self.feature_set)
        if found is None:
            return values
        values[CHOOSER[found.phase]] = self.feature_set
        if found.count_field:
            values[found.count_field] = self.sample_count
        if found.can_be_early:
            values[EARLY] = self.is_early
        for name in (*found.cut, *found.options):
            if name in self.parameters:
                value = self.parameters[name]
                values[name] = int(value) if name == 'max_gap_samples' else value
        return values

    @property
    def task(self) -> str:
        """The task of the feature set; empty if the feature set is not installed."""
        return task_of(self.feature_set)

    def bind(self, config: FeatureConfig) -> FeatureConfig:
        """Return a configuration that yields these features.

        Parameters
        ----------
        config : FeatureConfig
            The remaining parameters: limits, time-outs, and parameters that this specification
            does not have because its windows were already cut.

        Raises
        ------
        FeatureError
            When these features cannot be computed, or their windows exceed the limits of
            ``config``.
        """
        found = find_feature_set(self.feature_set)
        if found is None:
            raise FeatureError(
                f'the feature set "{self.feature_set}" is not installed: install the package '
                'that the model was trained with'
            )
        values = self.config_values()
        for name, value in values.items():
            if isinstance(value, str) != isinstance(getattr(config, name), str):
                raise FeatureError(f'{name} of the {self.feature_set} features is {value!r}')
        bound = dataclasses.replace(config, **values)
        computed = spec_of(bound.feature_set(found.phase))
        reason = self.mismatch(computed)
        if unknown := sorted(set(self.parameters) - set(computed.parameters)):
            reason = reason or f'the parameter {unknown[0]} is unknown'
        if reason:
            raise FeatureError(
                f'the installed {self.feature_set} gives other features than required: '
                f'{reason}; train the model again'
            )
        return bound

    def mismatch(self, other: FeatureSpec) -> str | None:
        """Return how ``other`` differs from this specification, or None if they agree.

        A parameter or a channel is compared only if both specifications have it, because windows
        that are already cut have fewer parameters, and live signals have no channel name. Rates
        are compared with `is_same_rate`. Feature set, version, length and options determine the
        names of the features, except for the frequencies in them.
        """
        pairs = [
            ('feature set', self.feature_set, other.feature_set),
            ('version of the feature set', self.version, other.version),
            ('window in samples', self.sample_count, other.sample_count),
            (f'window ({EARLY})', self.is_early, other.is_early),
        ]
        pairs += [
            (f'window ({name})', mine, other.parameters[name])
            for name, mine in self.parameters.items()
            if name in other.parameters and name != EARLY
        ]
        if self.channel and other.channel:
            pairs.append(('channel', self.channel, other.channel))
            if self.channel in (MEAN, ALL):
                pairs.append(
                    ('list of channels', ', '.join(self.channels), ', '.join(other.channels))
                )
        if not is_same_rate(self.rate_hz, other.rate_hz):
            pairs.insert(2, ('rate in Hz', *format_rates(self.rate_hz, other.rate_hz)))
        for what, mine, theirs in pairs:
            if mine != theirs:
                return f'the {what} differs: required {mine}, found {theirs}'
        # Names can contain frequencies, so they are compared only if the rates are equal.
        has_names = self.rate_hz != other.rate_hz or self.names == other.names
        if not has_names or self.units != other.units:
            return 'the names or units of the features differ'
        return None

    def describe_channel(self) -> str:
        """Return a text with the used and the unused channels; empty if there is only one."""
        if self.channel in (MEAN, ALL):
            return f'{self.channel} of {len(self.channels)} ({_list_some(self.channels)})'
        unused = [name for name in self.channels if name != self.channel]
        return f'{self.channel}; not used: {_list_some(unused)}' if unused else ''


def _list_some(names: Sequence[str]) -> str:
    more = len(names) - _MOST_CHANNELS
    return ', '.join(names[:_MOST_CHANNELS]) + (f' and {more} more' if more > 0 else '')


@dataclass(frozen=True)
class FeatureSpecifications:
    """Specifications that a feature node announces.

    Attributes
    ----------
    specs : tuple of FeatureSpec
        The specifications, with distinct digests.
    config : mapping
        Parameters of the node, common to all windows. The keys are fields of `FeatureConfig`.
    stamp_ns : int
        Time at which the node was configured, ROS time [ns].
    """

    specs: tuple[FeatureSpec, ...]
    config: Mapping[str, Any] = field(default_factory=dict)
    stamp_ns: int = 0


def _describe(
    feature_set: FeatureSet, sample_count: int, rate_hz: float, stated: tuple[str, ...]
) -> FeatureSpec:
    features = feature_set.describe(sample_count, rate_hz)
    parameters = {name: getattr(feature_set.config, name) for name in stated}
    if feature_set.is_early:
        parameters[EARLY] = 1.0
    return FeatureSpec(
        feature_set=feature_set.name,
        version=feature_set.version,
        rate_hz=float(rate_hz),
        sample_count=sample_count,
        names=tuple(feature.name for feature in features),
        units=tuple(feature.unit for feature in features),
        parameters=parameters,
    )


@lru_cache(maxsize=64)
def spec_of(feature_set: FeatureSet) -> FeatureSpec:
    """Return the specification of a feature set in a feature node."""
    stated = (*feature_set.cut, *feature_set.options)
    return _describe(feature_set, feature_set.sample_count, feature_set.config.rate_hz, stated)


def shared_rate_hz(specs: Iterable[FeatureSpec]) -> float:
    """Return the common sample rate of all specifications [Hz], or 0 if there is none."""
    rates = [spec.rate_hz for spec in specs]
    return rates[0] if rates and all(is_same_rate(each, rates[0]) for each in rates) else 0.0


def spec_for(task: str, config: FeatureConfig) -> FeatureSpec:
    """Return the specification for a task, ``texture`` or ``stiffness``.

    Raises
    ------
    FeatureError
        When the task is unknown.
    """
    return spec_of(set_for(task, config))


def set_for(task: str, config: FeatureConfig) -> FeatureSet:
    """Return the feature set for a task, ``texture`` or ``stiffness``; see `spec_for`."""
    if task not in PHASE_OF_TASK:
        raise FeatureError(f'unknown task "{task}"; it must be {" or ".join(PHASE_OF_TASK)}')
    return config.feature_set(PHASE_OF_TASK[task])


def array_spec(
    task: str, sample_count: int, rate_hz: float, config: FeatureConfig | None = None
) -> FeatureSpec:
    """Return the specification of windows that are already cut.

    ``config`` selects the feature set and its options; defaults if omitted. If the task is unknown
    or the rate [Hz] is not positive, raises `FeatureError`.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise FeatureError(f'the rate is {rate_hz} Hz; it must be positive')
    feature_set = set_for(task, config or FeatureConfig())
    count = sample_count if feature_set.count_field else 0
    return _describe(feature_set, count, rate_hz, feature_set.options)
