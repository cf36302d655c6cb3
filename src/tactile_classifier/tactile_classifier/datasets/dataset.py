# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of features with labels. Training and evaluation use them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from functools import cached_property
import hashlib
import json
import re
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.copies import digest_rows, find_copies
from tactile_classifier.errors import DatasetError, NoFeaturesError
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import find_feature_set, task_of
from tactile_features.spec import ALL, FeatureSpec, MEAN

_CHANNEL = 'channel_'


@dataclasses.dataclass(frozen=True)
class FeatureTable:
    """Features, labels and metadata of many trials.

    Attributes
    ----------
    values : ndarray of shape (trials, k)
        Features, in the order and units of ``spec``.
    labels : ndarray of str, shape (trials,)
    spec : FeatureSpec
    columns : mapping of str to ndarray of shape (trials,)
        Metadata of each trial, such as ``trial_id``, ``session_id``, ``contact`` and
        ``simulated``. A column ``session`` is renamed to ``session_id`` if there is no column of
        that name. ``mounting`` is renamed to ``mounting_id`` in the same way.
    refused : int
        Number of labelled trials that are missing because they have no features.

    Raises
    ------
    DatasetError
        If shapes are inconsistent, a value is not finite, or a label is empty.
    """

    values: npt.NDArray[np.float64]
    labels: npt.NDArray[Any]
    spec: FeatureSpec
    columns: Mapping[str, npt.NDArray[Any]] = dataclasses.field(default_factory=dict)
    refused: int = 0

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        object.__setattr__(self, 'values', values)
        labels = np.asarray(self.labels).astype(str)
        object.__setattr__(self, 'labels', labels)
        names = {name: _OUR_NAMES.get(name, name) for name in self.columns}
        columns = {
            name if names[name] in self.columns else names[name]: np.asarray(column)
            for name, column in self.columns.items()
        }
        object.__setattr__(self, 'columns', columns)
        if values.ndim != 2 or values.shape[1] != len(self.spec.names) or not len(values):
            raise DatasetError(
                f'the features have shape {values.shape}; it must be '
                f'(trials, {len(self.spec.names)}) for {self.spec.feature_set}'
            )
        for name, column in [('labels', labels), *columns.items()]:
            if column.shape != (len(values),):
                raise DatasetError(
                    f'{name} has shape {column.shape}; it must be ({len(values)},), one per trial'
                )
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise DatasetError(f'the features of trial {bad[0]} are not finite')
        unlabelled = np.flatnonzero(labels == '')
        if len(unlabelled):
            raise DatasetError(f'trial {unlabelled[0]} has an empty label')

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def task(self) -> str:
        """``texture`` or ``stiffness``."""
        task = task_of(self.spec.feature_set)
        if not task:
            raise DatasetError(f'no task uses the feature set "{self.spec.feature_set}"')
        return task

    @property
    def channels(self) -> int:
        """Number of channels; the features are ordered by channel."""
        return (
            len({name.partition('__')[0] for name in self.spec.names if name.startswith(_CHANNEL)})
            or 1
        )

    @property
    def is_waveform(self) -> bool:
        """True if the features of each channel are consecutive samples of a signal."""
        found = find_feature_set(self.spec.feature_set)
        return found is not None and found.is_waveform

    def column(self, name: str) -> npt.NDArray[Any]:
        """Return a column.

        The names ``session`` and ``mounting`` also find ``session_id`` and ``mounting_id``.

        Raises DatasetError when there is no such column.
        """
        found = find_column(self.columns, name)
        if found not in self.columns:
            raise DatasetError(
                f'there is no column "{name}"; there are: {", ".join(self.columns) or "none"}'
            )
        return self.columns[found]

    def take(self, keep: npt.NDArray[Any]) -> FeatureTable:
        """Return the trials that a mask or an index array selects."""
        return dataclasses.replace(
            self,
            values=self.values[keep],
            labels=self.labels[keep],
            columns={name: column[keep] for name, column in self.columns.items()},
        )

    def compute_sha256(self) -> str:
        """Return the SHA-256 digest of the specification, the labels and the exact values."""
        digest = hashlib.sha256()
        text = json.dumps([self.spec.to_dict(), self.labels.tolist()], sort_keys=True)
        digest.update(text.encode())
        digest.update(self.values.astype('<f8').tobytes())
        return digest.hexdigest()

    def digest_trials(self) -> list[str]:
        """Return a digest of the features of each trial, 16 hex digits.

        The features are rounded to about a millionth of the largest feature of the trial.
        Computers that round differently therefore give the same digest, but different trials give
        different digests.
        """
        return digest_rows(self.values)

    @cached_property
    def copies(self) -> npt.NDArray[np.intp]:
        """Index of the original of each trial, shape (trials,); see `find_copies`."""
        return find_copies(self.values, self.labels)


def divide_groups(group: npt.NDArray[np.intp], column: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Divide groups by the values of a column; return the new group of each trial, from 0."""
    codes = np.unique(column, return_inverse=True)[1]
    return np.asarray(np.unique(group * (codes.max() + 1) + codes, return_inverse=True)[1])


_OUR_NAMES = {'session': 'session_id', 'mounting': 'mounting_id'}
"""Names of columns in imported recordings, and the corresponding names in a `FeatureTable`."""


def find_column(columns: Mapping[str, Any], name: str) -> str:
    """Return ``name`` if there is such a column, otherwise its standard name if it has one."""
    return name if name in columns else _OUR_NAMES.get(name, name)


_TITLES = {
    'session_id': 'session',
    'mounting_id': 'mounting',
    'trial_block': 'block of trials',
    'glide_speed_m_s': 'sliding speed',
}


def plain_name(column: str) -> str:
    """Return the display name of a standard column; other names are returned unchanged."""
    return _TITLES.get(column, column)


def name_channel(channel: int | str, channels: Sequence[str]) -> str:
    """Return the name of a channel, `MEAN` or `ALL`.

    ``channel`` is a name, an index from 0, `MEAN` or `ALL`. Raises DatasetError when there is no
    such channel.
    """
    name = str(channel)
    if name in (MEAN, ALL, *channels):
        return name
    if name.isdecimal() and int(name) < len(channels):
        return channels[int(name)]
    raise DatasetError(
        f'there is no channel {name}; the {len(channels)} channels are {", ".join(channels)}: '
        f'give a name, a number from 0, "{MEAN}" or "{ALL}"'
    )


def table_from_trials(
    task: str,
    x: npt.ArrayLike,
    labels: npt.ArrayLike,
    rate_hz: float,
    channel: int | str = 0,
    *,
    channels: Sequence[str] = (),
    unit: str = '',
    columns: Mapping[str, npt.NDArray[Any]] | None = None,
    config: FeatureConfig | None = None,
    speeds_m_s: npt.NDArray[Any] | None = None,
) -> FeatureTable:
    """Compute the features of trials that are already cut, for one channel or all channels.

    Parameters
    ----------
    task : str
        ``texture`` or ``stiffness``.
    x : array_like of shape (trials, channels, samples)
        Signals; each trial is one window. If the feature set is over distance, the middle of each
        trial is used.
    labels : array_like of str, shape (trials,)
    rate_hz : float
        Sample rate [Hz].
    channel : int or str
        Index of the channel, from 0, or its name. ``'all'`` concatenates the features of all
        channels; ``'mean'`` uses the mean of all channels.
    channels : sequence of str
        Names of the channels. Default: ``channel_0`` and so on.
    unit : str
        Unit of the signals. If unknown, newton is assumed for the units of the features.
    columns : mapping of str to ndarray of shape (trials,), optional
        Metadata for `FeatureTable`.
    config : FeatureConfig, optional
        Feature set and options; default values if omitted.
    speeds_m_s : ndarray of shape (trials,), optional
        Sliding speed of each trial [m/s], for feature sets that need it.

    Raises
    ------
    DatasetError
        If the channel does not exist.
    NoFeaturesError
        If some of the trials have no features.
    """
    x = np.asarray(x)
    channels = tuple(channels) or tuple(f'{_CHANNEL}{i}' for i in range(x.shape[1]))
    channel = name_channel(channel, channels)
    signals = [
        x[:, channels.index(one)]
        for one in (channels if channel == ALL else [channel])
        if one != MEAN
    ] or [x.mean(axis=1, dtype=np.float64)]
    try:
        found = [
            features_from_trials(
                task, signal.astype(np.float64), rate_hz, config=config, speeds_m_s=speeds_m_s
            )
            for signal in signals
        ]
    except FeatureError as error:
        message = f'no features from these trials: {error}'
        if isinstance(error, UndefinedFeatureError) and error.windows:
            reasons = dict.fromkeys(error.windows, str(error.__cause__ or error))
            raise NoFeaturesError(message, reasons) from error
        raise DatasetError(message) from error
    values, spec = found[0] if len(found) == 1 else _join(found)
    spec = _in_unit(spec, unit)
    if len(channels) > 1:
        spec = dataclasses.replace(spec, channel=channel, channels=channels)
    return FeatureTable(values, np.asarray(labels), spec, columns or {})


def _in_unit(spec: FeatureSpec, unit: str) -> FeatureSpec:
    """Return the specification for signals in ``unit`` instead of newton."""
    if unit in ('', 'N'):
        return spec
    units = tuple(re.sub(r'\bN\b', lambda _: unit, each) for each in spec.units)
    return dataclasses.replace(spec, units=units)


def _join(
    found: Sequence[tuple[npt.NDArray[np.float64], FeatureSpec]],
) -> tuple[npt.NDArray[np.float64], FeatureSpec]:
    """Concatenate the features of several channels."""
    spec = found[0][1]
    names = tuple(f'{_CHANNEL}{i:03d}__{name}' for i in range(len(found)) for name in spec.names)
    spec = dataclasses.replace(spec, names=names, units=spec.units * len(found))
    return np.hstack([values for values, _ in found]), spec
