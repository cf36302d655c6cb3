# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drivers of the linear guide (Grbl) and of the tendon actuator (Dynamixel), as ROS 2 actions."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'DeviceConnectionError': 'errors',
    'DeviceRefusedError': 'errors',
    'GuideState': 'types',
    'LinearGuideClient': 'grbl.guide_client',
    'LinearGuideConfig': 'config',
    'LinearGuideDriverError': 'errors',
    'MotionFailedError': 'errors',
    'MotionRefusedError': 'errors',
    'MotionStoppedError': 'errors',
    'TendonActuatorClient': 'dynamixel.tendon_client',
    'TendonActuatorConfig': 'config',
    'TendonState': 'types',
    'TendonSafety': 'safety',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Modules are imported on first use, so that `TendonState` and other records can be used
    # without the libraries of the devices.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
