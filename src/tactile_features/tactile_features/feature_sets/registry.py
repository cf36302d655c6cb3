# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Registry of the feature sets of this package and of other installed packages.

To add a feature set to this package, write one module here and add its class to `BUILT_IN`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import FeatureSet
from tactile_features.feature_sets.stiffness import StiffnessRegression, StiffnessRelaxation
from tactile_features.feature_sets.texture_spatial import TextureSpatial
from tactile_features.feature_sets.texture_spectrum import TextureSpectrum
from tactile_features.feature_sets.waveforms import GlideWaveform, HoldWaveform, SpatialWaveform
from tactile_features.types import PHASE_GLIDE, PHASE_HOLD, PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE

GROUP = 'tactile.feature_sets'
"""Entry point group in which other packages register their feature sets."""

BUILT_IN: tuple[type[FeatureSet], ...] = (
    TextureSpectrum,
    TextureSpatial,
    StiffnessRegression,
    StiffnessRelaxation,
    GlideWaveform,
    SpatialWaveform,
    HoldWaveform,
)

PHASE_OF_TASK: Mapping[str, str] = MappingProxyType(
    {PROTOCOL_TEXTURE: PHASE_GLIDE, PROTOCOL_STIFFNESS: PHASE_HOLD}
)
"""For each task, the phase whose window is classified."""

CHOOSER: Mapping[str, str] = MappingProxyType(
    {PHASE_GLIDE: 'texture_features', PHASE_HOLD: 'stiffness_features'}
)
"""For each phase, the field of `FeatureConfig` that contains the name of its feature set."""


@lru_cache(maxsize=64)
def find_feature_set(name: str) -> type[FeatureSet] | None:
    """Return the feature set of that name, or None if no installed package has it."""
    for feature_set in BUILT_IN:
        if feature_set.name == name:
            return feature_set
    for entry in entry_points(group=GROUP, name=name):
        return _load(entry)
    return None


def _load(entry: Any) -> type[FeatureSet]:
    package = entry.dist.name if entry.dist else 'an installed package'
    try:
        found = entry.load()
    except Exception as error:
        raise FeatureError(
            f'the feature set {entry.name} of {package} cannot be loaded from {entry.value}: '
            f'{error}'
        ) from error
    if not (isinstance(found, type) and issubclass(found, FeatureSet)):
        raise FeatureError(f'{entry.value} of {package} is not a subclass of FeatureSet')
    name, phase = getattr(found, 'name', ''), getattr(found, 'phase', '')
    if name != entry.name or phase not in CHOOSER:
        raise FeatureError(
            f'{entry.value} of {package} has the name "{name}" and the phase "{phase}"; the name '
            f'must equal its entry point, "{entry.name}", and the phase must be glide or hold'
        )
    return found


def list_feature_sets(phase: str) -> tuple[str, ...]:
    """Return the names of the feature sets of a phase; those of this package come first."""
    others = [entry.name for entry in entry_points(group=GROUP)]
    names = dict.fromkeys([*(each.name for each in BUILT_IN), *sorted(others)])
    found = [(name, find_feature_set(name)) for name in names]
    return tuple(name for name, each in found if each is not None and each.phase == phase)


def check_choice(parameter: str, name: str, phase: str) -> type[FeatureSet]:
    """Return the feature set called ``name``.

    If it is not installed or belongs to another phase, raise `FeatureError` with the name of the
    parameter.
    """
    found = find_feature_set(name)
    if found is None or found.phase != phase:
        raise FeatureError(
            f'{parameter} is "{name}"; it must be {" or ".join(list_feature_sets(phase))}, or the '
            f'name of a feature set of the {phase} that a package registers in {GROUP}'
        )
    return found


def task_of(name: str) -> str:
    """Return the task of a feature set, ``texture`` or ``stiffness``; empty if it is unknown."""
    found = find_feature_set(name)
    return next(
        (task for task, phase in PHASE_OF_TASK.items() if found and found.phase == phase), ''
    )
