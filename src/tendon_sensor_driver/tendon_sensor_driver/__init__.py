# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver of the force sensor on the tendon; publishes the tension as strain blocks."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'TareValue': '.tare',
    'SensorHealth': '.types',
    'LineDecoder': '.line_sensor',
    'LinkError': '.errors',
    'LineReading': '.types',
    'SensorClient': '.client',
    'StrainBlock': 'tactile_ros.strain',
    'StrainStatus': 'tactile_ros.strain',
    'StrainStream': '.strain_stream',
    'Tare': '.tare',
    'TareError': '.tare',
    'TendonSensorClient': '.line_sensor',
    'TendonSensorConfig': '.config',
    'TendonSensorError': '.errors',
    'check_sensor': '.checks',
    'encode_reading': '.line_sensor',
    'make_sensor': '.sensors',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Imported on first use: the record types can be used without importing pyserial.
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name], __name__), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
