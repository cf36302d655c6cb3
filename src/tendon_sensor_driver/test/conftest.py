# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures with a simulated load cell on a pseudo-terminal."""

import os
from pathlib import Path
import select
import sys
import tty

import pytest

from tendon_sensor_driver import encode_reading

# The simulated Net F/T is a module in the folder ``peers`` of the tests.
sys.path.insert(0, str(Path(__file__).parent / 'peers'))


class PtySensor:
    """A pseudo-terminal that replaces the serial port of a load-cell board.

    The test writes the lines of the board, which the client reads. ``port`` is a symbolic link,
    so that its name stays the same when the sensor is unplugged and plugged in.
    """

    def __init__(self, port):
        self.port = str(port)
        self.plug_in()

    def plug_in(self):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.symlink(os.ttyname(self._slave), self.port)

    def unplug(self):
        if self._master is None:
            return
        os.unlink(self.port)
        os.close(self._master)
        os.close(self._slave)
        self._master = None

    def read(self):
        """Return what the client has sent since the last call."""
        if not select.select([self._master], [], [], 0)[0]:
            return b''
        return os.read(self._master, 1000)

    def write(self, data):
        while data:
            data = data[os.write(self._master, data) :]

    def write_reading(self, device_ticks, value=0.5):
        self.write(encode_reading(device_ticks, value))


@pytest.fixture
def sensor(tmp_path):
    sensor = PtySensor(tmp_path / 'sensor')
    yield sensor
    sensor.unplug()
