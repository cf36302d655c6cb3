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

"""Moves the linear guide (Grbl) and the tendon actuator (Dynamixel) as ROS 2 actions."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'DeviceConnectionError': 'errors',
    'DeviceRefusedError': 'errors',
    'GuideState': 'records',
    'LinearGuideClient': 'grbl.guide_client',
    'LinearGuideConfig': 'records',
    'LinearGuideDriverError': 'errors',
    'MotionFailedError': 'errors',
    'MotionRefusedError': 'errors',
    'MotionStoppedError': 'errors',
    'TendonActuatorClient': 'dynamixel.tendon_client',
    'TendonActuatorConfig': 'records',
    'TendonState': 'records',
    'TendonSafety': 'safety.tendon_safety',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that who needs the records alone does not need the devices' libraries.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
