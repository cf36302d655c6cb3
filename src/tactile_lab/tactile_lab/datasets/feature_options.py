# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sets of features, and the single ones, that options name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.registry import CHOOSER, find_feature_set
from tactile_features.feature_sets.texture_spatial import SpatialWindow
from tactile_features.records import PHASE_GLIDE, SET_TEXTURE_SPATIAL
from tactile_ros.errors import TactileError


def choose_features(
    over: str | None, detrend: str | None, features: str | None = None
) -> dict[str, Any]:
    """Return the fields of `FeatureConfig` that ``--over``, ``--detrend`` and ``--features`` say.

    Raises
    ------
    TactileError
        When they do not go together, or ``--over`` is no window.
    """
    if detrend is not None and over is not None:
        raise TactileError('--detrend is for the spectrum over time: leave --over or it out')
    fields = parse_over(over) if detrend is None else {'spectrum_detrend': detrend}
    for name in list_sets(features):
        found = find_feature_set(name)
        assert found is not None
        if over is not None and found.phase == PHASE_GLIDE and not found.needs_speed:
            raise TactileError(f'--over is for sets over the surface, and {name} is none')
        fields[CHOOSER[found.phase]] = name
    return fields


def list_sets(features: str | None) -> list[str]:
    """Return the sets of features that ``--features`` names; none when it names features."""
    names = [name.strip() for name in (features or '').split(',')]
    return names if all(map(find_feature_set, names)) else []


def parse_over(text: str | None) -> dict[str, Any]:
    """Return the fields of `FeatureConfig` that ``LENGTH:FINEST`` in millimetres says.

    None says nothing.

    Raises
    ------
    TactileError
        When it is not of that form, or the window is too short for its finest scale.
    """
    if text is None:
        return {}
    length, _, finest = text.partition(':')
    try:
        window = SpatialWindow(float(length) / 1e3, float(finest) / 1e3)
        fields: dict[str, Any] = {
            'texture_features': SET_TEXTURE_SPATIAL,
            'spatial_length_m': window.length_m,
            'spatial_finest_m': window.finest_m,
        }
        FeatureConfig(**fields)
    except FeatureError as error:
        raise TactileError(f'--over: {error}') from error
    except ValueError as error:
        raise TactileError(f'--over: "{text}" is not LENGTH:FINEST in mm, as in 45:0.5') from error
    return fields


def select_features(table: FeatureTable, names: str | None) -> FeatureTable:
    """Return the table with only the named features; the last part of a name is enough.

    Raises
    ------
    TactileError
        When there is no such feature, or several whose names end so.
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
            raise TactileError(f'"{name}" is the end of several names; write one of {fitting}')
        chosen += found
    spec = replace(
        table.spec,
        names=tuple(table.spec.names[i] for i in chosen),
        units=tuple(table.spec.units[i] for i in chosen),
    )
    return FeatureTable(table.values[:, chosen], table.labels, spec, table.columns)
