# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The palpation rig as physics, and simulated devices that speak the real wire protocols."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Catalogue': 'catalogue',
    'ConvergenceError': 'errors',
    'DescriptionError': 'errors',
    'Move': 'timeline',
    'RigError': 'errors',
    'SimulatedRig': 'rig_process',
    'SimulatedTrials': 'fast_trials',
    'TactileSimError': 'errors',
    'Timeline': 'timeline',
    'list_objects': 'catalogue',
    'move_duration_s': 'motion',
    'simulate_trials': 'fast_trials',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that the rig's process is started without the fast path's imports.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
