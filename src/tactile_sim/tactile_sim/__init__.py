# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The palpation rig as physics, and simulated devices that speak the real wire protocols."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Catalogue': 'descriptions.catalogue',
    'ConvergenceError': 'errors',
    'DescriptionError': 'errors',
    'Move': 'physics.timeline',
    'RigError': 'errors',
    'SimulatedRig': 'rig_process',
    'SimulatedTrials': 'physics.fast_trials',
    'TactileSimError': 'errors',
    'Timeline': 'physics.timeline',
    'list_objects': 'descriptions.catalogue',
    'move_duration_s': 'physics.motion',
    'simulate_trials': 'physics.fast_trials',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that the rig's process is started without the fast path's imports.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
