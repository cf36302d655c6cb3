# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

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
    'TendonSafety': 'safety',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that who needs the records alone does not need the devices' libraries.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
