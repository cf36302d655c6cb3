# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import time

from tendon_sensor_driver.records import TendonSensorConfig
from tendon_sensor_driver.sensors import make_sensor


def make(sensor):
    config = dataclasses.replace(TendonSensorConfig(), sensor=sensor)
    return make_sensor(config, print, time.time_ns)


def test_each_kind_of_sensor_has_its_client():
    names = {kind: type(make(kind)).__name__ for kind in ('line', 'net_ft')}
    assert names == {
        'line': 'TendonSensorClient',
        'net_ft': 'NetFtClient',
    }
