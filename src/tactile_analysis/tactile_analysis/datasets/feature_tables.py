# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables of trials, the input of training and evaluation.

`compute_tables` accepts trials of any source. For bags with trial events, features are computed
again with the extractor of the live node. For other recordings, each trial is one window.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.feature_options import FeatureOptions, parse_span
from tactile_analysis.options import SourceOptions
from tactile_analysis.sources.signals import shared_columns
from tactile_analysis.trial_set import TrialSet
from tactile_bags.trial import Signal, Trial
from tactile_classifier.datasets.dataset import FeatureTable, name_channel, table_from_trials
from tactile_classifier.errors import DatasetError, NoFeaturesError
from tactile_features.config import FeatureConfig
from tactile_features.spec import ALL, MEAN, set_for
from tactile_features.types import PHASE_GLIDE, PROTOCOL_TEXTURE
from tactile_ros.errors import TactileError

Key = tuple[str, ...]
"""Key of a table: its task and contact. If several tables have the same task and contact, the keys
of all but the first also contain the digest of the feature specification."""

Tables = dict[Key, FeatureTable]

Fields = Mapping[str, Any]
"""Values of fields of `FeatureConfig`."""

NONE: Fields = MappingProxyType({})

_STATED_BY_TRIALS = ('rate_hz', 'texture_samples', 'stiffness_samples')
"""Fields of `FeatureConfig` that are determined by the trials: sample rate and lengths."""


def name_table(key: Key, table: FeatureTable) -> str:
    """Return a name of a table: task and contact, and the feature set if this is ambiguous."""
    more = [table.spec.feature_set] if len(key) > 2 else []
    return ', '.join(filter(None, (*key[:2], *more)))


@contextmanager
def open_trials(
    paths: Sequence[Path],
    options: FeatureOptions | None = None,
    sources: SourceOptions | None = None,
) -> Iterator[TrialSet]:
    """Open recordings and prepare their trials for features; see `TrialSet.load`, `prepare`."""
    options = options or FeatureOptions()
    with TrialSet.load(paths, sources) as trials:
        if options.task is None and not trials.is_own:
            raise TactileError(
                f'the task of {trials.name} is unknown: give --task texture or --task stiffness'
            )
        yield prepare(trials, options)


def prepare(trials: TrialSet, options: FeatureOptions, *, needs_label: bool = True) -> TrialSet:
    """Select, resample and crop the trials of files; bags with trial events are not changed.

    If the task is known, trials without features are left out as well.

    Raises
    ------
    TactileError, DatasetError
        If options and recording do not fit, or no trial can be used.
    """
    if trials.is_own:
        options.check_for_bags()
        options.choose_fields()
        return trials
    if options.where is not None:
        trials = trials.select(options.where, 'where')
    stated = options.select_stated(trials.columns)
    if stated is not None:
        trials = trials.select(stated[0] | stated[1])
    skip_bad = options.skip_bad
    trials = trials.even(skip_bad=skip_bad, needs_label=needs_label)
    if options.resample_hz is not None:
        trials = trials.resample(options.resample_hz)
    if options.crop is not None:
        trials = trials.crop(*parse_span(options.crop), skip_bad=skip_bad)
    if options.task is None:
        return trials
    if options.window_s is not None:
        trials = trials.crop(0.0, options.window_s, skip_bad=skip_bad)
    trials = trials.cut_to_shortest()
    while True:  # an error need not name all trials without features
        try:
            table = _compute_table(trials, options, NONE)
            break
        except NoFeaturesError as error:
            trials = trials.drop(error.reasons, skip_bad=skip_bad)
    if used := table.spec.describe_channel():
        trials = trials.add_step(f'channel: {used} (--channel NAME, mean or all)')
    return trials


def compute_tables(
    trials: TrialSet, options: FeatureOptions | None = None, fields: Fields = NONE
) -> tuple[Tables, tuple[str, ...]]:
    """Return the feature tables of the labelled trials, and the trials without features.

    Parameters
    ----------
    trials : TrialSet
        If the trials are from files and not from bags with trial events, each trial is one
        window. Cut such trials first.
    options : FeatureOptions, optional
        Task, channel and features.
    fields : mapping
        Fields of `FeatureConfig` that select other features than ``options``.

    Returns
    -------
    tables : dict of FeatureTable
        Tables by task and contact; see `Key`. If a recording has several feature specifications
        for a task, each has a table.
    left_out : tuple of str
        One sentence per trial without features or label.

    Raises
    ------
    TactileError, DatasetError
        If no trial has features, or none belongs to the task.
    """
    options = options or FeatureOptions()
    if trials.is_own:
        from tactile_analysis.datasets.bag_features import compute_bag_tables  # slow import

        refuse_new_signals(trials)
        tables, left_out = compute_bag_tables(trials, options, fields)
    else:
        if options.task is None:
            raise TactileError(f'the task of {trials.name} is unknown: state it')
        table = _compute_table(trials, options, fields)
        left_out = tuple(trials.skipped)
        tables = {(options.task, ''): replace(table, refused=len(left_out))}
    wanted = {key: table for key, table in tables.items() if options.task in (None, key[0])}
    if not wanted:
        raise TactileError(f'{trials.name} contains no {options.task} trials')
    return wanted, left_out


def refuse_new_signals(trials: TrialSet) -> None:
    """Raise TactileError if the signals of bags with trial events were cropped or resampled.

    The live extractor cuts the windows out of the recorded samples, as the feature specification
    states.
    """
    if trials.has_new_signals:
        raise TactileError(
            f'{trials.name} has trial events, which state the windows: compute its features '
            'before you crop or resample it, or use TrialSet.windows'
        )


def read_tables(
    paths: Sequence[Path], fields: Fields = NONE, options: FeatureOptions | None = None
) -> Tables:
    """Return the feature tables of recordings; ``fields`` selects other features."""
    with open_trials(paths, options) as trials:
        return compute_tables(trials, options, fields)[0]


def _compute_table(trials: TrialSet, options: FeatureOptions, fields: Fields) -> FeatureTable:
    """Return the features of trials from files; each trial is one window."""
    assert options.task is not None
    config = FeatureConfig(**options.choose_fields(), early_windows=options.window_s is not None)
    config = replace(
        config, **{name: v for name, v in fields.items() if name not in _STATED_BY_TRIALS}
    )
    feature_set = set_for(options.task, config)
    if options.window_s is not None and not feature_set.is_early:
        raise DatasetError(f'{feature_set.name}: early windows are not possible')
    trials = trials.cut_to_shortest()
    x, labels, _ = trials.windows()
    included = trials.included
    columns = shared_columns(included)
    columns.setdefault('trial_id', np.array([trial.name for trial in included]))
    signal = included[0].signal
    assert signal.rate_hz is not None, 'the set is even'
    return table_from_trials(
        options.task,
        x,
        labels,
        signal.rate_hz,
        options.channel or 0,
        channels=signal.channels,
        unit=trials.unit,
        columns=columns,
        config=config,
        speeds_m_s=speeds_of(trials, options.speed_column) if needs_speed(options) else None,
    )


def join_tables(tables: Sequence[FeatureTable]) -> FeatureTable:
    """Concatenate the trials of several tables; keep the columns that all tables have."""
    first = tables[0]
    names = [name for name in first.columns if all(name in table.columns for table in tables)]
    return FeatureTable(
        np.concatenate([table.values for table in tables]),
        np.concatenate([table.labels for table in tables]),
        first.spec,
        {name: np.concatenate([table.columns[name] for table in tables]) for name in names},
    )


def needs_speed(options: FeatureOptions) -> bool:
    """Return True if the options require or state sliding speeds of the trials."""
    config = FeatureConfig(**options.choose_fields())
    is_texture = options.task == PROTOCOL_TEXTURE
    if not is_texture and (options.over or config.feature_set(PHASE_GLIDE).needs_speed):
        raise TactileError('features over distance need a sliding finger: use --task texture')
    return is_texture and bool(
        options.over or options.speed_column or config.feature_set(PHASE_GLIDE).needs_speed
    )


def speeds_of(trials: TrialSet, name: str | None) -> NDArray[np.float64]:
    """Return the sliding speed of each included trial [m/s].

    ``name`` is the column with the speeds. It ends in the unit, ``_mm_s`` or ``_m_s``.
    """
    columns = shared_columns(trials.included)
    if name is None or name not in columns or columns[name].dtype.kind not in 'fiu':
        raise TactileError(
            'give the numeric column with the sliding speeds, for example --speed-column '
            f'speed_mm_s; there are: {", ".join(columns) or "none"}'
        )
    for ending, unit_m_s in (('_mm_s', 1e-3), ('_m_s', 1.0)):
        if name.endswith(ending):
            return np.asarray(columns[name].astype(np.float64) * unit_m_s)
    raise TactileError(f'--speed-column: the name "{name}" must end in its unit, _mm_s or _m_s')


def title(trials: TrialSet, options: FeatureOptions, key: Key, table: FeatureTable) -> str:
    """Return a description of the trials of a table."""
    if trials.is_own:
        return name_table(key, table)
    names = {'': '', MEAN: 'mean of all channels', ALL: 'all channels'}
    used = table.spec.channel
    parts = [key[0], trials.name, names.get(used, used), options.where]
    if options.resample_hz is not None:
        parts.append(f'at {options.resample_hz:g} Hz')
    if options.crop is not None:
        start_s, stop_s = parse_span(options.crop)
        parts.append(f'{start_s:g} to {stop_s:g} s')
    if options.over:
        parts.append(f'over {options.over} mm')
    return ', '.join(filter(None, (*parts, options.features)))


def find_window(trials: TrialSet, table: FeatureTable, row: int) -> tuple[Trial | None, Signal]:
    """Return the trial of a row, and the signal from which its features were computed.

    If there are several channels, the signal is the channel that the features use, or else the
    mean of all channels. The trial is None if it is not in ``trials``; this is the case for phases
    that were detected in the tension.
    """
    if not trials.is_own:
        trial = trials.included[row]
        signal = trial.signal
        name = table.spec.channel or name_channel(0, signal.channels)
        values = signal.values.mean(axis=0)
        if name in signal.channels:
            values = signal.values[signal.channels.index(name)]
        return trial, replace(signal, values=values[np.newaxis], channels=(name,))
    source, namespace, name, start_ns, end_ns = (
        table.column(each)[row].item()
        for each in ('bag', 'namespace', 'trial_id', 'window_start_ns', 'window_end_ns')
    )
    bag = next(bag for bag in trials.bags if str(bag.path) == source)
    return (
        trials.find_window(source, namespace, name, start_ns),
        bag.signal_between(namespace, start_ns, end_ns),
    )
