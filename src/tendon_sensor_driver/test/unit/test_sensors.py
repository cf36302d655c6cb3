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
    names = {kind: type(make(kind)).__name__ for kind in ('line', 'net_ft', 'digital_ft')}
    assert names == {
        'line': 'TendonSensorClient',
        'net_ft': 'NetFtClient',
        'digital_ft': 'DigitalFtClient',
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
