# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults on the ports, and requests that are refused."""

import os

import pytest
import serial

from tactile_sim import RigError
from tactile_testing.waiting import wait_until


def test_bad_requests_are_answered_with_a_sentence(rig):
    with pytest.raises(RigError, match="no device 'camera'; there are sensor, guide, tendon"):
        rig.fault('camera', 'mute')
    with pytest.raises(RigError, match='alarm is a moment; leave duration_s out'):
        rig.fault('guide', 'alarm', 1.0)
    with pytest.raises(RigError, match="share is 'all'; it must be a number from 0 to 1"):
        rig.fault('sensor', 'garbage', share='all')


def test_unplug_takes_the_port_away_and_brings_it_back_under_its_name(rig):
    name = rig.ports.sensor
    before = os.path.realpath(name)
    with serial.Serial(name, 115200, timeout=0.0) as port:
        rig.fault('sensor', 'unplug')

        def is_lost():
            try:
                port.read(100_000)
            except serial.SerialException:
                return True
            return False

        wait_until(is_lost, 'the open port is still readable')
        assert not os.path.lexists(name)
        with pytest.raises(serial.SerialException):
            serial.Serial(name)
        rig.fault('sensor', 'none')
        wait_until(lambda: os.path.exists(name), 'the port did not come back')
        assert os.path.realpath(name) != before  # our end of the old one is open yet
    with serial.Serial(name, 115200, timeout=10.0) as again:
        # Its power came through the cable: it counts from 0.
        assert b'Readings:\r\n0,' in again.read_until(b'\r\n16,')


def test_unplug_ends_by_itself(rig):
    rig.fault('guide', 'unplug', 0.2)
    wait_until(lambda: not os.path.lexists(rig.ports.guide), 'the port is still there')
    wait_until(lambda: os.path.exists(rig.ports.guide), 'the port did not come back')
    with serial.Serial(rig.ports.guide, 115200, timeout=10.0) as again:
        again.write(b'?')
        assert b'<Alarm|' in again.read_until(b'>')
