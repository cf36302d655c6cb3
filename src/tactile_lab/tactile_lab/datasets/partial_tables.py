# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables of the first part of each window, for answers while it fills."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from pathlib import Path

import numpy as np

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.replaying.replay import recorded_config, replay_windows
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.records import FeatureWindow, Outcome


def count_samples(seconds: Sequence[float], config: FeatureConfig) -> tuple[int, ...]:
    """Return the ``running_samples`` of windows that have filled for so long.

    Raises
    ------
    BagError
        When they do not rise, or do not fit into the window.
    """
    counts = tuple(round(second * config.rate_hz) for second in seconds)
    try:
        return dataclasses.replace(config, running_samples=counts).running_samples
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
    counts: tuple[int, ...] = ()
    found: dict[tuple[str, str, int, int], FeatureWindow] = {}
    sources = sorted(set(zip(table.column('bag'), table.column('namespace'), strict=True)))
    for path, namespace in sources:
        with TactileBag(Path(path)) as bag:
            config = dataclasses.replace(recorded_config(bag), **table.spec.config_values())
            counts = count_samples(seconds, config)
            config = dataclasses.replace(config, running_samples=counts, measures=False)
            for window in replay_windows(bag, config, namespace):
                if window.running and window.outcome == Outcome.OK:
                    key = (path, namespace, window.window_start_ns, window.sample_count)
                    found[key] = window
    columns = ('bag', 'namespace', 'window_start_ns')
    trials = list(zip(*(table.column(name).tolist() for name in columns), strict=True))
    try:
        return {
            count: dataclasses.replace(
                table, values=np.array([found[(*trial, count)].values for trial in trials])
            )
            for count in counts
        }
    except KeyError as error:
        raise BagError(f'a window has no features of its first part: {error}') from error
