# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables of a recording, the input of training and evaluation.

`features_of` accepts any recording. For bags with trial events, features are computed again with
the extractor of the live node. For other recordings, each trial is one window.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.reading import parse_span, Reading
from tactile_analysis.options import SourceOptions
from tactile_analysis.trial_set import select_trials, TrialSet
from tactile_bags.trial import Trial
from tactile_classifier.datasets.archive import LabelledTrials, Skipped
from tactile_classifier.datasets.dataset import FeatureTable, usable_table
from tactile_classifier.errors import DatasetError
from tactile_features.config import FeatureConfig
from tactile_features.spec import ALL, MEAN, set_for
from tactile_features.types import PHASE_GLIDE, PROTOCOL_TEXTURE
from tactile_ros.errors import TactileError

Key = tuple[str, ...]
"""Task and contact of a table, and the digest for further specifications of the same task."""

Fields = Mapping[str, Any]
"""Values of fields of `FeatureConfig`."""

NONE: Fields = MappingProxyType({})

Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times since the first sample [s], and values, each of shape (n,)."""


@dataclass(frozen=True)
class FeatureTables:
    """The feature tables of a recording.

    ``tables`` is indexed by task and contact. If a recording has several specifications of a task,
    each has a table; the keys of further tables include the digest. ``left_out`` contains one
    sentence per trial without features or label. ``refused`` is the number of labelled trials
    without features, for example because of lost samples, by key.
    """

    tables: dict[Key, FeatureTable]
    left_out: tuple[str, ...] = ()
    refused: Mapping[Key, int] = field(default_factory=dict)


def name_table(key: Key, table: FeatureTable) -> str:
    """Return task and contact of a table, and the feature set if it is needed to distinguish."""
    more = [table.spec.feature_set] if len(key) > 2 else []
    return ', '.join(filter(None, (*key[:2], *more)))


class RecordingFeatures(ABC):
    """Features of an open recording; created by `features_of`.

    ``steps`` describes the processing of the signals. ``skipped`` contains the unusable trials of
    an archive. ``has_speeds`` is False if feature sets over distance are not possible.
    """

    has_speeds = True
    steps: tuple[str, ...] = ()
    skipped: tuple[Skipped, ...] = ()

    def __init__(self, recording: TrialSet, reading: Reading) -> None:
        self.recording = recording
        self.reading = reading

    def tables(self, fields: Fields = NONE) -> FeatureTables:
        """Return the feature tables of the labelled trials, by task and contact.

        ``fields`` selects other features than ``reading``. Raises `TactileError` or `DatasetError`
        if no trial has features, or none belongs to the task.
        """
        found = self._compute(fields)
        task = self.reading.task
        wanted = {key: table for key, table in found.tables.items() if task in (None, key[0])}
        if not wanted:
            raise TactileError(f'{self.recording.name} contains no {task} trials')
        return replace(found, tables=wanted)

    @abstractmethod
    def _compute(self, fields: Fields) -> FeatureTables: ...

    @abstractmethod
    def title(self, key: Key, table: FeatureTable) -> str:
        """Return a description of the trials of a table."""

    @abstractmethod
    def windows(self, table: FeatureTable, rows: Sequence[int]) -> list[Samples]:
        """Return the samples in the windows of the given trials."""

    def find_trial(self, table: FeatureTable, row: int) -> Trial | None:
        """Return the trial of a row with its phases, or None if these are unknown."""
        return None


def features_of(
    recording: TrialSet, reading: Reading | None = None, *, folds: int = 0
) -> RecordingFeatures:
    """Return the features of an open recording.

    Archives with fewer trials than ``folds`` are refused. Raises `TactileError` or `DatasetError`
    if options and recording do not fit, or an archive contains no usable trials.
    """
    if recording.is_own:
        from tactile_analysis.datasets.bag_features import BagFeatures  # readers of bags

        return BagFeatures(recording, reading or Reading())
    return TrialFeatures(recording, reading or Reading(), folds)


@contextmanager
def open_features(
    paths: Sequence[Path],
    reading: Reading | None = None,
    statements: SourceOptions | None = None,
    *,
    folds: int = 0,
) -> Iterator[RecordingFeatures]:
    """Open recordings for their features; see `features_of`.

    ``statements`` are the options for imported recordings.
    """
    with load_recording(paths, statements) as recording:
        yield features_of(recording, reading, folds=folds)


def load_recording(paths: Sequence[Path], statements: SourceOptions | None = None) -> TrialSet:
    """Open recordings; see `TrialSet.load`.

    Raises `TactileError` if ``statements`` are given for bags with trial events.
    """
    recording = TrialSet.load(paths, statements)
    if recording.is_own and statements not in (None, SourceOptions()):
        recording.close()
        raise TactileError(
            'these bags contain trial events, which define the trials: omit '
            '--force-column, --rate-hz, --label, --label-from, --labels and --field'
        )
    return recording


def read_tables(paths: Sequence[Path], fields: Fields = NONE) -> FeatureTables:
    """Return the feature tables of bags; ``fields`` selects other features."""
    with open_features(paths) as features:
        return features.tables(fields)


def prepare_trials(trials: LabelledTrials, reading: Reading) -> LabelledTrials:
    """Select, resample and crop the trials."""
    if reading.where is not None:
        trials = trials.take(select_trials(trials.columns, reading.where, 'where'))
    trials = reading.keep_stated(trials)
    if reading.resample_hz is not None:
        trials = trials.resample(reading.resample_hz)
    if reading.crop is not None:
        trials = trials.between(*parse_span(reading.crop))
    return trials


def speeds_of(trials: LabelledTrials, name: str | None) -> NDArray[np.float64]:
    """Return the sliding speed of each trial [m/s]; the name of the column contains its unit."""
    if name is None or name not in trials.columns or trials.columns[name].dtype.kind not in 'fiu':
        raise TactileError(
            'give the numeric column with the sliding speeds, for example --speed-column '
            f'speed_mm_s; there are: {", ".join(trials.columns) or "none"}'
        )
    for ending, unit_m_s in (('_mm_s', 1e-3), ('_m_s', 1.0)):
        if name.endswith(ending):
            return np.asarray(trials.columns[name].astype(np.float64) * unit_m_s)
    raise TactileError(f'--speed-column: the name "{name}" must end in its unit, _mm_s or _m_s')


_STATED_BY_TRIALS = ('rate_hz', 'texture_samples', 'stiffness_samples')
"""Fields of `FeatureConfig` that follow from the trials: rate and length."""


class TrialFeatures(RecordingFeatures):
    """Features of labelled trials after selection, resampling and cropping; one window each."""

    def __init__(self, recording: TrialSet, reading: Reading, folds: int = 0) -> None:
        super().__init__(recording, reading)
        if reading.task is None:
            raise TactileError(
                f'the task of {recording.name} is unknown: give --task texture or --task stiffness'
            )
        self._task = reading.task
        self._channel = reading.channel or '0'
        self._config = FeatureConfig(
            **reading.choose_fields(), early_windows=reading.window_s is not None
        )
        trials = recording.to_arrays(folds=folds, skip_bad=reading.skip_bad)
        trials = prepare_trials(trials, reading)
        if reading.window_s is not None:
            trials = trials.between(0.0, reading.window_s)
        is_texture = self._task == PROTOCOL_TEXTURE
        self._needs_speed = bool(
            reading.over
            or self._config.feature_set(PHASE_GLIDE).needs_speed
            or (is_texture and reading.speed_column)
        )
        self.has_speeds = self._needs_speed
        self._table, self._trials = self._usable(trials, self._config)
        self.steps, self.skipped = self._trials.steps, self._trials.skipped
        if used := self._table.spec.describe_channel():
            self.steps += (f'channel: {used} (--channel NAME, mean or all)',)

    def title(self, key: Key, table: FeatureTable) -> str:
        reading = self.reading
        names = {'': '', MEAN: 'mean of all channels', ALL: 'all channels'}
        used = table.spec.channel
        parts = [self._task, self.recording.name, names.get(used, used), reading.where]
        if reading.resample_hz is not None:
            parts.append(f'at {reading.resample_hz:g} Hz')
        if reading.crop is not None:
            start_s, stop_s = parse_span(reading.crop)
            parts.append(f'{start_s:g} to {stop_s:g} s')
        if reading.over:
            parts.append(f'over {reading.over} mm')
        return ', '.join(filter(None, (*parts, reading.features)))

    def _compute(self, fields: Fields) -> FeatureTables:
        changed = {name: v for name, v in fields.items() if name not in _STATED_BY_TRIALS}
        table = self._table
        if changed:
            table, _ = self._usable(self._trials, replace(self._config, **changed))
        left_out = tuple(f'row {each.row}: {each.reason}' for each in self.skipped)
        key = (self._task, '')
        return FeatureTables({key: table}, left_out, {key: len(self.skipped)})

    def _usable(
        self, trials: LabelledTrials, config: FeatureConfig
    ) -> tuple[FeatureTable, LabelledTrials]:
        """Return the features, and the trials that have features."""
        feature_set = set_for(self._task, config)
        if self.reading.window_s is not None and not feature_set.is_early:
            raise DatasetError(f'{feature_set.name}: early windows are not possible')
        speeds_m_s = self._speeds_m_s(trials) if self._needs_speed else None
        table, trials = usable_table(
            self._task, trials, self._channel, config=config, speeds_m_s=speeds_m_s
        )
        if 'trial_id' not in table.columns:
            rows = trials.columns.get('trial', trials.rows).astype(str)
            table = replace(table, columns={**table.columns, 'trial_id': rows})
        return table, trials

    def _speeds_m_s(self, trials: LabelledTrials) -> NDArray[np.float64]:
        """Return the sliding speed of each trial [m/s]."""
        if self._task != PROTOCOL_TEXTURE:
            raise TactileError('features over distance need a sliding finger: use --task texture')
        return speeds_of(trials, self.reading.speed_column)

    def windows(self, table: FeatureTable, rows: Sequence[int]) -> list[Samples]:
        signals = self._trials.signal(MEAN if self._channel == ALL else self._channel)
        time_s = np.asarray(np.arange(signals.shape[1]) / self._trials.rate_hz, dtype=np.float64)
        return [(time_s, signals[row]) for row in rows]
