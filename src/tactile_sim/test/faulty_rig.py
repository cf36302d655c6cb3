# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated rig to break, and ears on its ports."""

import re

import serial

from waiting import wait_until

LINE = re.compile(rb'(\d+),(-?\d+\.\d{5}),kg,\r\n')


class Ear:
    """Everything that comes over a port."""

    def __init__(self, path):
        self.port = serial.Serial(path, 115200, timeout=0.0, exclusive=True)
        self.data = b''

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.port.close()

    def listen(self):
        self.data += self.port.read(100_000)
        return self.data

    def wait_for(self, condition, what):
        wait_until(lambda: condition(self.listen()), f'{what}: {self.data[-200:]!r}')
        taken, self.data = self.data, b''
        return taken

    def wait_for_lines(self, count):
        """Bytes from the next whole line on, with so many lines in them."""
        self.data = b''
        said = self.wait_for(lambda data: data.count(b'\n') > count, f'{count} lines')
        return said[said.index(b'\n') + 1 :]
