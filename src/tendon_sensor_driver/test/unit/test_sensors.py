# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import sys
import time

import pytest

from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.lines.line_client import TendonSensorClient
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


def test_net_ft_without_pynetft_names_the_remedy_and_others_need_none(monkeypatch):
    for name in [
        name for name in sys.modules if name.startswith('tendon_sensor_driver.ati.net_ft')
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'pynetft', None)
    with pytest.raises(TendonSensorError, match='pip install pynetft'):
        make('net_ft')
    assert isinstance(make('line'), TendonSensorClient)
