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

"""Reads the force sensor on the tendon and publishes the tension as strain blocks."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Bias': '.stream.tare',
    'Calibration': '.stream.calibration',
    'Health': '.records',
    'LineDecoder': '.lines.line_protocol',
    'LinkError': '.errors',
    'Reading': '.records',
    'SensorClient': '.sensors',
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
