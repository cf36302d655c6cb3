# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options for selecting and cutting trials of a recording, and for choosing features."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import TrialOptions
from tactile_analysis.trial_set import Columns, select_trials
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Split, stated_split
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.registry import CHOOSER, find_feature_set
from tactile_features.feature_sets.texture_spatial import SpatialWindow
from tactile_features.types import PHASE_GLIDE, SET_TEXTURE_SPATIAL
from tactile_ros.errors import TactileError


@dataclass(frozen=True, kw_only=True)
class FeatureOptions(TrialOptions):
    """Selection of trials and features of a recording, from the options of a command.

    The fields are options of the commands: see ``tactile evaluate --help``.
    ``window_s`` is the length of early windows [s], or None for full windows.

    Raises `TactileError` if only one of ``train_where`` and ``test_where`` is given.
    """

    task: str | None = None
    over: str | None = None
    detrend: str | None = None
    features: str | None = None
    window_s: float | None = None
    train_where: str | None = None
    test_where: str | None = None

    def __post_init__(self) -> None:
        if (self.train_where is None) != (self.test_where is None):
            raise TactileError('--train-where and --test-where must be given together')

    def choose_fields(self) -> dict[str, Any]:
        """Return the fields of `FeatureConfig` from ``over``, ``detrend`` and ``features``.

        Raises `TactileError` if they are inconsistent, or ``over`` is invalid.
        """
        if self.detrend is not None and self.over is not None:
            raise TactileError('--detrend and --over exclude each other: omit one of them')
        chosen = parse_over(self.over)
        if self.detrend is not None:
            chosen['spectrum_detrend'] = self.detrend
        for name in list_sets(self.features):
            found = find_feature_set(name)
            assert found is not None
            if self.over is not None and found.phase == PHASE_GLIDE and not found.needs_speed:
                raise TactileError(f'--over needs a feature set over distance, not {name}')
            chosen[CHOOSER[found.phase]] = name
        return chosen

    def early_fields(self, rate_hz: float) -> dict[str, Any]:
        """Return the fields of `FeatureConfig` from ``window_s``; empty for full windows."""
        if self.window_s is None:
            return {}
        count = round(self.window_s * rate_hz)
        return {'early_windows': True, 'texture_samples': count, 'stiffness_samples': count}

    def check_for_bags(self) -> None:
        """Raise `TactileError` if an option is given that bags with trial events do not allow.

        These are the options for selecting and cutting trials, the fields of `TrialOptions`.
        """
        for each in fields(TrialOptions):
            if getattr(self, each.name):
                option = each.name.replace('_', '-')
                raise TactileError(
                    f'--{option} is for archives; the trials of a bag are defined by its events'
                )

    def select_stated(
        self, columns: Columns
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
        """Return masks of the training and test trials; None unless both selections are given."""
        if self.train_where is None or self.test_where is None:
            return None
        return (
            select_trials(columns, self.train_where, 'train-where'),
            select_trials(columns, self.test_where, 'test-where'),
        )

    def training(self, table: FeatureTable) -> FeatureTable:
        """Return the training trials, or all trials if none are selected."""
        chosen = self.select_stated(table.columns)
        return table if chosen is None else table.take(chosen[0])

    def keep_stated(self, table: FeatureTable) -> FeatureTable:
        """Return the training and test trials, or all trials if none are selected."""
        chosen = self.select_stated(table.columns)
        return table if chosen is None else table.take(chosen[0] | chosen[1])

    def splits(self, table: FeatureTable) -> tuple[Split, ...]:
        """Return the split into training and test trials; empty if they are not selected.

        Raises `EvaluationError` if a trial is in both selections, or a label occurs only in the
        test trials.
        """
        chosen = self.select_stated(table.columns)
        if chosen is None:
            return ()
        return (stated_split(table, *chosen, str(self.train_where), str(self.test_where)),)


def list_sets(features: str | None) -> list[str]:
    """Return the feature sets in ``--features``; empty if it contains names of features."""
    names = [name.strip() for name in (features or '').split(',')]
    return names if all(map(find_feature_set, names)) else []


def parse_over(text: str | None) -> dict[str, Any]:
    """Return the fields of `FeatureConfig` from the option ``--over``, or an empty dictionary.

    ``text`` has the form ``LENGTH:FINEST``: length of the window and finest scale in millimetres.
    Raises `TactileError` if it does not, or if the window is too short for its finest scale.
    """
    if text is None:
        return {}
    length, _, finest = text.partition(':')
    try:
        window = SpatialWindow(float(length) / 1e3, float(finest) / 1e3)
        chosen: dict[str, Any] = {
            'texture_features': SET_TEXTURE_SPATIAL,
            'spatial_length_m': window.length_m,
            'spatial_finest_m': window.finest_m,
        }
        FeatureConfig(**chosen)
    except FeatureError as error:
        raise TactileError(f'--over: {error}') from error
    except ValueError as error:
        raise TactileError(f'--over: "{text}" is not LENGTH:FINEST in mm (45:0.5)') from error
    return chosen


def select_features(table: FeatureTable, names: str | None) -> FeatureTable:
    """Select features by name; the last part of a name is sufficient.

    Raises `TactileError` if a feature does not exist, or a name is ambiguous.
    """
    if names is None or list_sets(names):
        return table
    short = [name.rpartition('__')[2] for name in table.spec.names]
    chosen = []
    for name in (part.strip() for part in names.split(',')):
        exact = [i for i, full in enumerate(table.spec.names) if full == name]
        found = exact or [i for i, end in enumerate(short) if end == name]
        if not found:
            raise TactileError(
                f'there is no feature "{name}"; there are {", ".join(short[:8])}'
                + (' ...' if len(short) > 8 else '')
            )
        if len(found) > 1:
            fitting = ', '.join(table.spec.names[i] for i in found)
            raise TactileError(f'"{name}" is ambiguous: use one of {fitting}')
        chosen += found
    spec = replace(
        table.spec,
        names=tuple(table.spec.names[i] for i in chosen),
        units=tuple(table.spec.units[i] for i in chosen),
    )
    return replace(table, values=table.values[:, chosen], spec=spec)


def parse_span(text: str) -> tuple[float, float]:
    """Return start and stop in seconds from ``START:STOP``.

    Raises `TactileError` if the text does not have this form.
    """
    start, _, stop = text.partition(':')
    try:
        span = float(start), float(stop)
    except ValueError as error:
        raise TactileError(f'"{text}" is not START:STOP in seconds, such as 1:5') from error
    if not 0 <= span[0] < span[1] < float('inf'):
        raise TactileError(f'"{text}": START must not be negative and must be less than STOP')
    return span
