# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulation of the palpation rig. Its simulated devices use the protocols of the real devices."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Catalogue': 'descriptions.catalogue',
    'ConvergenceError': 'errors',
    'DescriptionError': 'errors',
    'Move': 'physics.motion',
    'RigError': 'errors',
    'SimulatedRig': 'rig_process',
    'SimulatedTrials': 'physics.trials',
    'TactileSimError': 'errors',
    'Timeline': 'physics.motion',
    'list_objects': 'descriptions.catalogue',
    'move_duration_s': 'physics.motion',
    'simulate_trials': 'physics.trials',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Modules are imported when they are first used, so that processes start quickly.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
