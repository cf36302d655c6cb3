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

from tactile_classifier.datasets.archive import Channel, LabelledTrials
from tactile_classifier.datasets.copies import digest_rows, find_copies
from tactile_classifier.errors import DatasetError
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import find_feature_set, task_of
from tactile_features.spec import ALL, FeatureSpec

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

    Raises
    ------
    DatasetError
        If shapes are inconsistent, a value is not finite, or a label is empty.
    """

    values: npt.NDArray[np.float64]
    labels: npt.NDArray[Any]
    spec: FeatureSpec
    columns: Mapping[str, npt.NDArray[Any]] = dataclasses.field(default_factory=dict)

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
        return FeatureTable(
            self.values[keep],
            self.labels[keep],
            self.spec,
            {name: column[keep] for name, column in self.columns.items()},
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
"""Names of columns in imported recordings, and our names for them."""


def find_column(columns: Mapping[str, Any], name: str) -> str:
    """Return ``name`` if there is such a column, otherwise our name for it if there is one."""
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


def table_from_trials(
    task: str,
    trials: LabelledTrials,
    channel: Channel = 0,
    *,
    config: FeatureConfig | None = None,
    speeds_m_s: npt.NDArray[Any] | None = None,
) -> FeatureTable:
    """Compute the features of trials that are already cut, for one channel or all channels.

    The units of the features follow from the unit of the trials; if it is unknown, newton is
    assumed. If ``trials.skip_bad`` is set, trials without features are left out; `usable_table`
    also returns which trials remain.

    Parameters
    ----------
    task : str
        ``texture`` or ``stiffness``.
    trials : LabelledTrials
        Each trial is one window: cut the trials with `LabelledTrials.between` first. If the
        feature set is over distance, the middle of each trial is used.
    channel : int or str
        Index of the channel, from 0, or its name. ``'all'`` concatenates the features of all
        channels; ``'mean'`` uses the mean of all channels.
    config : FeatureConfig, optional
        Feature set and options; default values if omitted.
    speeds_m_s : ndarray of shape (trials,), optional
        Sliding speed of each trial [m/s], for feature sets that need it.

    Raises
    ------
    DatasetError
        If the channel does not exist, or if a trial has no features and ``skip_bad`` is not set.
    """
    return usable_table(task, trials, channel, config=config, speeds_m_s=speeds_m_s)[0]


def usable_table(
    task: str,
    trials: LabelledTrials,
    channel: Channel = 0,
    *,
    config: FeatureConfig | None = None,
    speeds_m_s: npt.NDArray[Any] | None = None,
) -> tuple[FeatureTable, LabelledTrials]:
    """Like `table_from_trials`, but also return the trials that have features."""
    trials = trials.cut_to_shortest()
    channel, channels = trials.name_channel(channel), trials.channels
    while True:
        signals = [trials.signal(one) for one in (channels if channel == ALL else [channel])]
        try:
            found = [
                features_from_trials(
                    task, signal, trials.rate_hz, config=config, speeds_m_s=speeds_m_s
                )
                for signal in signals
            ]
        except UndefinedFeatureError as error:
            if not error.windows:
                raise DatasetError(f'no features from these trials: {error}') from error
            bad = dict.fromkeys(error.windows, str(error.__cause__ or error))
            if speeds_m_s is not None:
                speeds_m_s = np.delete(speeds_m_s, list(bad))
            trials = trials.drop(bad)
        except FeatureError as error:
            raise DatasetError(f'no features from these trials: {error}') from error
        else:
            values, spec = found[0] if len(found) == 1 else _join(found)
            spec = _in_unit(spec, trials.unit)
            if len(channels) > 1:
                spec = dataclasses.replace(spec, channel=channel, channels=channels)
            return FeatureTable(values, trials.label, spec, trials.columns), trials


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
