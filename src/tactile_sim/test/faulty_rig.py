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
