# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Partial windows and physical measures, which a feature table lacks, reread from its bags."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replaying.replay import replay_windows
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.records import FeatureWindow, Measure, Outcome
from tactile_features.spec import WantedFeatures


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


def read_partial_tables(table: FeatureTable, seconds: Sequence[float]) -> dict[int, FeatureTable]:
    """Return one table for each part of the window, trial by trial as in the given one.

    Parameters
    ----------
    table : FeatureTable
        Texture, from `read_tables`: its columns say which bags are read again.
    seconds : sequence of float
        How much of the window has been seen [s].

    Returns
    -------
    dict of int to FeatureTable
        By samples.

    Raises
    ------
    BagError
        When a bag cannot be read or ``seconds`` do not fit.
    """
    fields = table.spec.config_values()
    counts = count_samples(seconds, FeatureConfig(**fields, buffer_s=600.0))
    found = {
        (*source, window.window_start_ns, window.sample_count): window.values
        for *source, window in _read_windows(
            table,
            lambda recorded: RecordedFeatures(
                replace(recorded.config, **fields, partial_samples=counts, measures=False)
            ),
        )
        if window.partial
    }
    columns = ('bag', 'namespace', 'window_start_ns')
    trials = list(zip(*(table.column(name).tolist() for name in columns), strict=True))
    try:
        return {
            count: replace(table, values=np.array([found[(*trial, count)] for trial in trials]))
            for count in counts
        }
    except KeyError as error:
        raise BagError(f'a window has no features of its first part: {error}') from error


def read_measures(table: FeatureTable) -> list[tuple[Measure, ...]]:
    """Return what was measured in the window of each trial.

    Parameters
    ----------
    table : FeatureTable
        From `read_tables`: its columns say which bags and windows.

    Raises
    ------
    BagError
        When a bag cannot be read, or has no such window.
    """
    found = {
        (*source, window.window_start_ns, window.window_end_ns): window.measures
        for *source, window in _read_windows(
            table,
            lambda recorded: RecordedFeatures(
                replace(recorded.config, measures=True, partial_samples=()),
                tuple(WantedFeatures(each.spec) for each in recorded.wanted),
            ),
        )
    }
    columns = ('bag', 'namespace', 'window_start_ns', 'window_end_ns')
    trials = zip(*(table.column(name).tolist() for name in columns), strict=True)
    try:
        return [found[trial] for trial in trials]
    except KeyError as error:
        raise BagError(
            'the features are of other windows than those recorded, and measures are not '
            'made of these'
        ) from error


def _read_windows(
    table: FeatureTable, change: Callable[[RecordedFeatures], RecordedFeatures]
) -> Iterator[tuple[str, str, FeatureWindow]]:
    """Yield bag, namespace and window of each usable window of the table's bags."""
    columns = (table.column(name).tolist() for name in ('bag', 'namespace'))
    for path, namespace in sorted(set(zip(*columns, strict=True))):
        with TactileBag(Path(path)) as bag:
            features = change(recorded_features(bag, namespace))
            for window in replay_windows(bag, features, namespace, finish=True):
                if window.outcome == Outcome.OK:
                    yield path, namespace, window
