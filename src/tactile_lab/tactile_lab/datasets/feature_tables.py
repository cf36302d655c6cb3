# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables of a recording: what training, evaluation and comparison start from.

`features_of` takes any recording. Of our own bags the samples run through the extractor again, as
in the live node; of others each trial is one window.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.recording import RecordedBag, Recording
from tactile_bags.replay import replay_phases, replay_windows
from tactile_bags.sources.files import SourceOptions
from tactile_bags.trial import Trial
from tactile_classifier.datasets.archive import LabelledTrials, Skipped
from tactile_classifier.datasets.dataset import ALL, Channel, FeatureTable, usable_table
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import task_of
from tactile_features.records import (
    FeatureWindow,
    Measure,
    Outcome,
    PHASE_ABORTED,
    PHASE_DONE,
    PHASE_GLIDE,
    PROTOCOL_SLIP,
    PROTOCOL_TEXTURE,
    TrialEvent,
)
from tactile_features.spec import FeatureSpec, WantedFeatures
from tactile_lab.datasets.reading import parse_span, Reading, select_trials
from tactile_ros.errors import TactileError

BLOCKS = 6
"""Into how many parts the trials of a session are cut in the order of time, as many as folds."""

Key = tuple[str, ...]
"""Task and contact of a table; then, but of the first specification of a task, its digest."""

Fields = Mapping[str, Any]
"""Values of fields of `FeatureConfig`."""

NONE: Fields = MappingProxyType({})

Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times from the first one [s] and values, each of shape (n,)."""


@dataclass(frozen=True)
class FeatureTables:
    """The feature tables of a recording.

    Attributes
    ----------
    tables : dict of tuple to FeatureTable
        By task and contact. Where a recording has several specifications of a task, each has a
        table; those after the first have the digest in their key, too.
    left_out : tuple of str
        One sentence for each trial that gave no features, or has no label.
    """

    tables: dict[Key, FeatureTable]
    left_out: tuple[str, ...] = ()


def name_table(key: Key, table: FeatureTable) -> str:
    """Return task and contact of a table, and the set of features where they are not enough."""
    more = [table.spec.feature_set] if len(key) > 2 else []
    return ', '.join(filter(None, (*key[:2], *more)))


class RecordingFeatures(ABC):
    """Features of an open recording; made by `features_of`.

    Attributes
    ----------
    recording : Recording
    reading : Reading
    steps : tuple of str
        What was done to the signals first, in words.
    skipped : tuple of Skipped
        Trials of an archive that cannot be used.
    """

    steps: tuple[str, ...] = ()
    skipped: tuple[Skipped, ...] = ()

    def __init__(self, recording: Recording, reading: Reading) -> None:
        self.recording = recording
        self.reading = reading

    def tables(self, fields: Fields = NONE) -> FeatureTables:
        """Return the labelled trials of the wanted task, by task and kind of contact.

        Parameters
        ----------
        fields : mapping
            Other features than those that ``reading`` names.

        Raises
        ------
        TactileError, DatasetError
            When no trial gives features, or none is of that task.
        """
        found = self._compute(fields)
        task = self.reading.task
        wanted = {key: table for key, table in found.tables.items() if task in (None, key[0])}
        if not wanted:
            raise TactileError(f'{self.recording.name} holds no {task} trials')
        return replace(found, tables=wanted)

    @abstractmethod
    def _compute(self, fields: Fields) -> FeatureTables: ...

    @abstractmethod
    def title(self, key: Key, table: FeatureTable) -> str:
        """Return what the trials of a table are, in words."""

    @abstractmethod
    def partial_tables(
        self, table: FeatureTable, seconds: Sequence[float]
    ) -> dict[int, FeatureTable]:
        """Return features of the first parts of each window, trial by trial, by samples.

        Parameters
        ----------
        table : FeatureTable
            Of texture, of this recording.
        seconds : sequence of float
            How much of the window has been seen [s].

        Raises
        ------
        TactileError
            When ``seconds`` do not fit into the window.
        """

    @abstractmethod
    def measures(self, table: FeatureTable) -> list[tuple[Measure, ...]]:
        """Return what was measured in the window of each trial.

        Raises
        ------
        TactileError
            When the recording has no such windows.
        """

    @abstractmethod
    def windows(self, table: FeatureTable, rows: Sequence[int]) -> list[Samples]:
        """Return the samples in the windows of some trials."""

    def find_trial(self, table: FeatureTable, row: int) -> Trial | None:
        """Return the trial of a row with its phases; None: they are not known."""
        return None


def features_of(
    recording: Recording, reading: Reading | None = None, *, folds: int = 0
) -> RecordingFeatures:
    """Return the features of an open recording.

    Parameters
    ----------
    folds : int
        An archive with fewer trials than this is refused.

    Raises
    ------
    TactileError, DatasetError
        When options and recording do not fit, or no trial of an archive can be used.
    """
    kind = BagFeatures if recording.is_own else TrialFeatures
    return kind(recording, reading or Reading(), folds)


@contextmanager
def open_features(
    paths: Sequence[Path],
    reading: Reading | None = None,
    statements: SourceOptions | None = None,
    *,
    folds: int = 0,
) -> Iterator[RecordingFeatures]:
    """Open recordings for their features; see `features_of`.

    Parameters
    ----------
    statements : SourceOptions, optional
        What is stated about recordings of others.
    """
    with load_recording(paths, statements) as recording:
        yield features_of(recording, reading, folds=folds)


def load_recording(paths: Sequence[Path], statements: SourceOptions | None = None) -> Recording:
    """Open recordings; see `Recording.load`.

    Raises
    ------
    TactileError
        When something is stated about our own bags, which say it themselves.
    """
    recording = Recording.load(paths, statements)
    if recording.is_own and statements not in (None, SourceOptions()):
        recording.close()
        raise TactileError(
            'these are bags with trial events, which say themselves what a trial is: leave '
            '--column, --rate-hz, --label, --label-from, --labels and --field out'
        )
    return recording


def read_tables(paths: Sequence[Path], fields: Fields = NONE) -> FeatureTables:
    """Return the feature tables of our own bags; ``fields`` name other features."""
    with Recording.of_bags(paths) as recording:
        return features_of(recording).tables(fields)


# -- our own bags ------------------------------------------------------------------------------

Row = tuple[FeatureWindow, TrialEvent, str, str]
"""A labelled window, its trial's last event before it, bag and namespace."""


class BagFeatures(RecordingFeatures):
    """Features of our own bags: every finger (namespace) of each counts."""

    def __init__(self, recording: Recording, reading: Reading, _folds: int = 0) -> None:
        super().__init__(recording, reading)
        reading.check_for_bags()
        self._fields = reading.choose_fields()
        self._bags = {str(bag.path): bag for bag in recording.bags}

    def title(self, key: Key, table: FeatureTable) -> str:
        return name_table(key, table)

    def _compute(self, fields: Fields) -> FeatureTables:
        chosen = {**self._fields, **fields}
        first: RecordedFeatures | None = None
        found: defaultdict[tuple[str, str, str], list[Row]] = defaultdict(list)
        specs: dict[str, FeatureSpec] = {}
        left_out: list[str] = []
        paths = list(self._bags)
        for path, bag in self._bags.items():
            for namespace in bag.namespaces:
                features = _choose(path, recorded_features(bag, namespace), chosen)
                first = first or features
                if _compared(features) != _compared(first):
                    finger = f'{namespace} of ' if namespace else ''
                    raise BagError(
                        f'{finger}{path} was recorded with other feature parameters than '
                        f'{paths[0]}; train on each of them alone, or name the features'
                    )
                specs |= _collect(bag, namespace, features, found, left_out)
        if not found:
            raise BagError(
                f'no labelled trial with features in {", ".join(paths) or "no bag"}'
                + (f'; the first reason: {left_out[0]}' if left_out else '')
            )
        tables: dict[Key, FeatureTable] = {}
        places = {digest: place for place, digest in enumerate(specs)}
        for task, contact, digest in sorted(found, key=lambda key: (*key[:2], places[key[2]])):
            key: Key = (task, contact)
            key = (*key, digest) if key in tables else key
            tables[key] = _table(found[task, contact, digest], specs[digest])
        return FeatureTables(tables, tuple(dict.fromkeys(left_out)))

    def partial_tables(
        self, table: FeatureTable, seconds: Sequence[float]
    ) -> dict[int, FeatureTable]:
        fields = table.spec.config_values()
        counts = count_samples(seconds, FeatureConfig(**fields, buffer_s=600.0))
        found = {
            (*source, window.window_start_ns, window.sample_count): window.values
            for *source, window in self._replay(
                table,
                lambda recorded: RecordedFeatures(
                    replace(recorded.config, **fields, partial_samples=counts, measures=False)
                ),
            )
            if window.partial
        }
        trials = _list_rows(table, 'bag', 'namespace', 'window_start_ns')
        try:
            return {
                count: replace(
                    table, values=np.array([found[(*trial, count)] for trial in trials])
                )
                for count in counts
            }
        except KeyError as error:
            raise BagError(f'a window has no features of its first part: {error}') from error

    def measures(self, table: FeatureTable) -> list[tuple[Measure, ...]]:
        found = {
            (*source, window.window_start_ns, window.window_end_ns): window.measures
            for *source, window in self._replay(
                table,
                lambda recorded: RecordedFeatures(
                    replace(recorded.config, measures=True, partial_samples=()),
                    tuple(WantedFeatures(each.spec) for each in recorded.wanted),
                ),
            )
        }
        trials = _list_rows(table, 'bag', 'namespace', 'window_start_ns', 'window_end_ns')
        try:
            return [found[trial] for trial in trials]
        except KeyError as error:
            raise BagError(
                'the features are of other windows than those recorded, and measures are not '
                'made of these'
            ) from error

    def _replay(
        self, table: FeatureTable, change: Callable[[RecordedFeatures], RecordedFeatures]
    ) -> Iterator[tuple[str, str, FeatureWindow]]:
        """Yield bag, namespace and window of each usable window of the table's bags."""
        for path, namespace in sorted(set(_list_rows(table, 'bag', 'namespace'))):
            bag = self._bags[path]
            features = change(recorded_features(bag, namespace))
            for window in replay_windows(bag, features, namespace, finish=True):
                if window.outcome == Outcome.OK:
                    yield path, namespace, window

    def windows(self, table: FeatureTable, rows: Sequence[int]) -> list[Samples]:
        trials = _list_rows(table, 'bag', 'namespace', 'window_start_ns', 'window_end_ns')
        samples = []
        for path, namespace, start_ns, end_ns in (trials[row] for row in rows):
            signal = self._bags[path].signal_between(namespace, start_ns, end_ns)
            assert signal.time_s is not None
            samples.append((signal.time_s, signal.values[0]))
        return samples

    def find_trial(self, table: FeatureTable, row: int) -> Trial | None:
        path, namespace, name = _list_rows(table, 'bag', 'namespace', 'trial_id')[row]
        found = [
            trial
            for trial in self.recording.trials
            if (trial.source, trial.namespace, trial.name) == (path, namespace, name)
        ]
        return found[0] if len(found) == 1 else None  # else its phases cannot be told apart


def _list_rows(table: FeatureTable, *names: str) -> list[tuple[Any, ...]]:
    """Return these columns of each trial."""
    return list(zip(*(table.column(name).tolist() for name in names), strict=True))


def count_samples(seconds: Sequence[float], config: FeatureConfig) -> tuple[int, ...]:
    """Return the ``partial_samples`` of windows that have filled for so long.

    Raises
    ------
    BagError
        When they do not rise, or do not fit into the window.
    """
    counts = tuple(round(second * config.rate_hz) for second in seconds)
    try:
        return replace(config, partial_samples=counts).partial_samples
    except FeatureError as error:
        raise BagError(f'no early predictions after {list(seconds)} s: {error}') from error


def _choose(path: str, recorded: RecordedFeatures, chosen: Fields) -> RecordedFeatures:
    # A table has features of full windows alone: measures would be made in vain.
    if not chosen:
        return recorded.without_parts()
    try:
        config = replace(recorded.bound(), partial_samples=(), measures=False, **chosen)
    except FeatureError as error:
        raise BagError(f'{path}: {error}') from error
    return RecordedFeatures(config)


def _compared(features: RecordedFeatures) -> tuple[object, ...]:
    """Return what the recordings of a table must share."""
    digests = tuple(sorted(spec.digest for spec in features.specifications))
    return features.bound().without_detection(), digests


def _collect(
    bag: RecordedBag,
    namespace: str,
    features: RecordedFeatures,
    found: defaultdict[tuple[str, str, str], list[Row]],
    left_out: list[str],
) -> dict[str, FeatureSpec]:
    """Collect the labelled windows of a finger; return their specifications by digest."""
    replayed = replay_phases(bag, features, namespace, finish=True)
    dropped = {name: each.why_not for name, each in bag.corrections.items() if each.why_not}
    events: defaultdict[str, list[TrialEvent]] = defaultdict(list)
    for event in replayed.events:
        events[event.trial_id].append(event)
    left_out.extend(
        f'{trial_id}: a slip trial, and there are no slip features yet'
        for trial_id, (event, *_) in events.items()
        if event.protocol == PROTOCOL_SLIP
    )
    for window in replayed.windows:
        event = _event_before(window, events[window.trial_id])
        end = _end_after(window, events[window.trial_id])
        if window.trial_id in dropped:
            left_out.append(f'{window.trial_id}: {dropped[window.trial_id]}')
        elif window.outcome != Outcome.OK:
            left_out.append(f'{window.trial_id}: {window.reason}')
        elif end is not None and end.phase == PHASE_ABORTED:
            reason = end.message or 'no reason given'
            left_out.append(f'{window.trial_id}: the trial was aborted later: {reason}')
        elif not event.object_label:
            left_out.append(f'{window.trial_id}: the trial has no label')
        else:
            # By what the features are: a trial of one protocol may have a window of the other.
            key = task_of(window.feature_set), event.contact, window.specification_digest
            found[key].append((window, event, str(bag.path), namespace))
    return {spec.digest: spec for spec in replayed.specifications}


def _event_before(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent:
    """Return its trial's last event before the window; a trial's name may come again."""
    return max(
        (event for event in events if event.stamp_ns <= window.window_start_ns),
        key=lambda event: event.stamp_ns,
    )


def _end_after(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent | None:
    """Return how its trial ended after the window, if that was recorded."""
    ends = (
        event
        for event in events
        if event.stamp_ns >= window.window_end_ns and event.phase in (PHASE_DONE, PHASE_ABORTED)
    )
    return min(ends, key=lambda event: event.stamp_ns, default=None)


def _table(rows: Sequence[Row], spec: FeatureSpec) -> FeatureTable:
    windows, events, bags, namespaces = zip(*rows, strict=True)
    labels = np.array([event.object_label for event in events])
    session_ids = np.array([event.session_id for event in events])
    starts_ns = np.array([window.window_start_ns for window in windows])
    return FeatureTable(
        values=np.array([window.values for window in windows]),
        labels=labels,
        spec=spec,
        columns={
            'trial_id': np.array([event.trial_id for event in events]),
            'session_id': session_ids,
            'mounting_id': np.array([event.mounting_id for event in events]),
            'trial_block': number_blocks(starts_ns, session_ids, labels),
            'contact': np.array([event.contact for event in events]),
            'glide_speed_m_s': np.array([event.glide_speed_m_s for event in events]),
            'simulated': np.array([window.simulated for window in windows]),
            'bag': np.array(bags),
            'namespace': np.array(namespaces),
            'window_start_ns': starts_ns,
            'window_end_ns': np.array([window.window_end_ns for window in windows]),
        },
    )


def number_blocks(
    starts_ns: NDArray[np.int64], session_ids: NDArray[np.str_], labels: NDArray[np.str_]
) -> NDArray[np.intp]:
    """Return which sixth of its label's trials in its session each trial belongs to, from 0.

    Trials that follow each other share wear, warmth and drift; with random folds they stand
    on both sides. Held out in turn, these blocks keep neighbours together.

    Parameters
    ----------
    starts_ns, session_ids, labels : ndarray of shape (trials,)
    """
    blocks = np.zeros(len(labels), dtype=np.intp)
    for session in np.unique(session_ids):
        for label in np.unique(labels):
            (trials,) = np.nonzero((session_ids == session) & (labels == label))
            in_order = trials[np.argsort(starts_ns[trials], kind='stable')]
            blocks[in_order] = np.arange(len(trials)) * BLOCKS // max(len(trials), 1)
    return blocks


# -- recordings of others ----------------------------------------------------------------------


_STATED_BY_TRIALS = ('rate_hz', 'texture_samples', 'stiffness_samples')
"""Fields of `FeatureConfig` that the trials state: rate and length."""


class TrialFeatures(RecordingFeatures):
    """Features of labelled trials, selected, resampled and cropped: each trial is one window."""

    def __init__(self, recording: Recording, reading: Reading, folds: int = 0) -> None:
        super().__init__(recording, reading)
        if reading.task is None:
            raise TactileError(
                f'say what {recording.name} is about: --task texture or --task stiffness'
            )
        self._task = reading.task
        self._channel = reading.parse_channel()
        self._config = FeatureConfig(**reading.choose_fields())
        trials = recording.to_arrays(folds=folds, skip_bad=reading.skip_bad)
        if reading.where is not None:
            trials = trials.take(select_trials(trials.columns, reading.where, 'where'))
        trials = reading.keep_stated(trials)
        if reading.resample_hz is not None:
            trials = trials.resample(reading.resample_hz)
        if reading.crop is not None:
            trials = trials.between(*parse_span(reading.crop))
        is_texture = self._task == PROTOCOL_TEXTURE
        self._needs_speed = bool(
            reading.over
            or self._config.feature_set(PHASE_GLIDE).needs_speed
            or (is_texture and reading.speed_column)
        )
        self._table, self._trials = self._usable(trials, self._config)
        self.steps, self.skipped = self._trials.steps, self._trials.skipped

    def title(self, key: Key, table: FeatureTable) -> str:
        reading = self.reading
        names: dict[Channel, str] = {None: 'mean of all channels', ALL: 'all channels'}
        channel = names.get(self._channel, f'channel {self._channel}')
        parts = [self._task, self.recording.name, channel, reading.where]
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
        return FeatureTables({(self._task, ''): table}, left_out)

    def _usable(
        self, trials: LabelledTrials, config: FeatureConfig
    ) -> tuple[FeatureTable, LabelledTrials]:
        """Return the features and the trials that give them; the table names each trial."""
        speeds_m_s = self._speeds_m_s(trials) if self._needs_speed else None
        table, trials = usable_table(
            self._task, trials, self._channel, config=config, speeds_m_s=speeds_m_s
        )
        if 'trial_id' not in table.columns:
            rows = trials.columns.get('trial', trials.rows).astype(str)
            table = replace(table, columns={**table.columns, 'trial_id': rows})
        return table, trials

    def _speeds_m_s(self, trials: LabelledTrials) -> NDArray[np.float64]:
        """Return the sliding speed of each trial, in the unit that its column's name says."""
        if self._task != PROTOCOL_TEXTURE:
            raise TactileError('features over the surface are for texture; a hold goes nowhere')
        name = self.reading.speed_column
        if (
            name is None
            or name not in trials.columns
            or trials.columns[name].dtype.kind not in 'fiu'
        ):
            raise TactileError(
                'name the column with the sliding speeds as numbers, as in --speed-column '
                f'speed_mm_s; there are: {", ".join(trials.columns) or "none"}'
            )
        for ending, unit_m_s in (('_mm_s', 1e-3), ('_m_s', 1.0)):
            if name.endswith(ending):
                return trials.columns[name].astype(np.float64) * unit_m_s
        raise TactileError(
            f'--speed-column: the name "{name}" must end in its unit, _mm_s or _m_s'
        )

    def partial_tables(
        self, table: FeatureTable, seconds: Sequence[float]
    ) -> dict[int, FeatureTable]:
        trials = self._trials
        samples = trials.x.shape[2]
        longest_s = max(self._config.buffer_s, 1.0 + samples / trials.rate_hz)
        config = replace(
            self._config, rate_hz=trials.rate_hz, texture_samples=samples, buffer_s=longest_s
        )
        channels = range(trials.x.shape[1]) if self._channel == ALL else [self._channel]

        def compute(count: int) -> NDArray[np.float64]:
            parts = [
                features_from_trials(
                    self._task,
                    trials.signal(channel),
                    trials.rate_hz,
                    first_samples=count,
                    config=self._config,
                )[0]
                for channel in channels
            ]
            return np.hstack(parts)

        counts = count_samples(seconds, config)
        return {count: replace(table, values=compute(count)) for count in counts}

    def measures(self, table: FeatureTable) -> list[tuple[Measure, ...]]:
        raise TactileError('needs the stream of a bag; an archive has windows alone')

    def windows(self, table: FeatureTable, rows: Sequence[int]) -> list[Samples]:
        signals = self._trials.signal(None if self._channel == ALL else self._channel)
        time_s = np.asarray(np.arange(signals.shape[1]) / self._trials.rate_hz, dtype=np.float64)
        return [(time_s, signals[row]) for row in rows]
