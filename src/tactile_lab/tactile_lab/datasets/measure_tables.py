# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measures of the trials of a feature table, which does not carry them itself."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.replaying.replay import recorded_config, replay_windows
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.records import Measure, Outcome


def read_measures(table: FeatureTable) -> list[tuple[Measure, ...]]:
    """Return what was measured in the window of each trial, by reading the bags again.

    Parameters
    ----------
    table : FeatureTable
        From `read_tables`: its columns say which bags and windows.

    Raises
    ------
    BagError
        When a bag cannot be read, or has no such window.
    """
    names = ('bag', 'namespace', 'window_start_ns', 'window_end_ns')
    trials = list(zip(*(table.column(name).tolist() for name in names), strict=True))
    found: dict[tuple[str, str, int, int], tuple[Measure, ...]] = {}
    for path, namespace in sorted({trial[:2] for trial in trials}):
        with TactileBag(Path(path)) as bag:
            config = recorded_config(bag)
            config = dataclasses.replace(config, measures=True, running_samples=())
            for window in replay_windows(bag, config, namespace, finish=True):
                if window.outcome == Outcome.OK:
                    key = (path, namespace, window.window_start_ns, window.window_end_ns)
                    found[key] = window.measures
    try:
        return [found[trial] for trial in trials]
    except KeyError as error:
        raise BagError(
            'the features are of other windows than those recorded, and measures are not '
            'made of these'
        ) from error
