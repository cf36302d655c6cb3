# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads the force sensor on the tendon and publishes the tension as strain blocks."""

from tendon_sensor_driver.calibration import Calibration
from tendon_sensor_driver.client import TendonSensorClient
from tendon_sensor_driver.errors import LinkError, TendonSensorError
from tendon_sensor_driver.line_protocol import LineDecoder, encode_reading
from tendon_sensor_driver.records import (
    Block,
    Health,
    Reading,
    StrainStatus,
    TendonSensorConfig,
)
from tendon_sensor_driver.sensors import SensorClient, make_sensor
from tendon_sensor_driver.stream import StrainStream
from tendon_sensor_driver.tare import Bias, Tare, TareError

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
