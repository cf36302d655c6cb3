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

from tendon_sensor_driver.errors import LinkError, TendonSensorError
from tendon_sensor_driver.lines.line_client import TendonSensorClient
from tendon_sensor_driver.lines.line_protocol import encode_reading, LineDecoder
from tendon_sensor_driver.records import (
    Block,
    Health,
    Reading,
    StrainStatus,
    TendonSensorConfig,
)
from tendon_sensor_driver.sensors import make_sensor, SensorClient
from tendon_sensor_driver.stream.calibration import Calibration
from tendon_sensor_driver.stream.strain_stream import StrainStream
from tendon_sensor_driver.stream.tare import Bias, Tare, TareError

__all__ = [
    'Bias',
    'Block',
    'Calibration',
    'Health',
    'LineDecoder',
    'LinkError',
    'Reading',
    'SensorClient',
    'StrainStatus',
    'StrainStream',
    'Tare',
    'TareError',
    'TendonSensorClient',
    'TendonSensorConfig',
    'TendonSensorError',
    'encode_reading',
    'make_sensor',
]
