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

"""A simulated rig that each test may break, and its open ports."""

import dynamixel_sdk
from faulty_rig import Ear
import pytest

from tactile_sim import SimulatedRig
from waiting import wait_until


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=3) as rig:
        yield rig


@pytest.fixture(autouse=True)
def _sound_again(rig):
    yield
    for device in ('sensor', 'guide', 'tendon'):
        rig.fault(device, 'none')


@pytest.fixture
def sensor(rig):
    with Ear(rig.ports.sensor) as ear:
        ear.wait_for_lines(1)
        yield ear


@pytest.fixture
def guide(rig):
    with Ear(rig.ports.guide) as ear:
        rig.fault('guide', 'restart')  # forgets what the test before has left
        ear.wait_for(lambda data: b'to unlock]\r\n' in data, 'a banner')
        yield ear


@pytest.fixture
def servo(rig):
    port, packets = dynamixel_sdk.PortHandler(rig.ports.tendon), dynamixel_sdk.PacketHandler(2.0)
    assert port.openPort()
    rig.fault('tendon', 'restart')
    wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no answer to a ping')
    yield port, packets
    port.closePort()
