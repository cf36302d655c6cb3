# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads the force sensor on the tendon and publishes the tension as strain blocks."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Bias': '.stream.tare',
    'Health': '.records',
    'LineDecoder': '.lines.line_protocol',
    'LinkError': '.errors',
    'Reading': '.records',
    'SensorClient': '.client_base',
    'StrainBlock': 'tactile_ros.strain',
    'StrainStatus': 'tactile_ros.strain',
    'StrainStream': '.stream.strain_stream',
    'Tare': '.stream.tare',
    'TareError': '.stream.tare',
    'TendonSensorClient': '.lines.line_client',
    'TendonSensorConfig': '.records',
    'TendonSensorError': '.errors',
    'encode_reading': '.lines.line_protocol',
    'make_sensor': '.sensors',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that who needs the records alone imports no serial port.
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name], __name__), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
