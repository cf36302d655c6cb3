# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

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
