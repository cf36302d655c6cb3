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

"""Bytes from a serial port."""

from __future__ import annotations

import errno
import os
import termios
import threading

import serial
from serial.tools import list_ports

from tendon_sensor_driver.errors import LinkError

READ_TIMEOUT_S = 0.25
_WRITE_TIMEOUT_S = 0.5

# What pyserial lets through when the other side of a port dies; termios.error is no OSError.
_FAILURES = (OSError, termios.error, ValueError)

_REMEDIES = {
    errno.ENOENT: 'there is no such device; check the cable and the parameter "port"',
    errno.EACCES: 'no permission; add the user to the group that owns it (usually dialout)',
    errno.EAGAIN: 'another program has it open; close that first',
    errno.EBUSY: 'another program has it open; close that first',
}


class SerialTransport:
    """A serial port that is open from construction to `close`.

    Boards that reset when their port is opened do so here.

    Parameters
    ----------
    port : str
        Name of the device.
    baud : int
        Its speed.

    Raises
    ------
    LinkError
        When the port cannot be opened.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._name = port
        self._lock = threading.Lock()
        try:
            # exclusive: two readers would each get half of the lines.
            self._port = serial.Serial(
                port,
                baud,
                timeout=READ_TIMEOUT_S,
                write_timeout=_WRITE_TIMEOUT_S,
                exclusive=True,
            )
        except _FAILURES as error:
            reason = _REMEDIES.get(getattr(error, 'errno', None) or 0, str(error))
            raise LinkError(f'cannot open serial port {port}: {reason}') from error

    def read(self) -> bytes:
        """Return what has arrived, or nothing after 0.25 s without any.

        Raises
        ------
        LinkError
            When the port has gone.
        """
        try:
            data: bytes = self._port.read(1)
            if data:
                data += self._port.read(self._port.in_waiting)
        except _FAILURES as error:
            raise LinkError(f'lost serial port {self._name}: {error}') from error
        return data

    def write(self, data: bytes) -> None:
        """Send bytes; may be called while another thread reads.

        Raises
        ------
        LinkError
            When the port has gone or takes nothing.
        """
        try:
            with self._lock:
                self._port.write(data)
        except _FAILURES as error:
            raise LinkError(f'cannot write to serial port {self._name}: {error}') from error

    def cancel(self) -> None:
        """Make a `read` that waits in another thread return. Harmless on a closed port."""
        # pyserial writes a byte to a pipe here; while the port is being closed, that
        # pipe's number may already belong to another file.
        with self._lock:
            self._port.cancel_read()

    def close(self) -> None:
        """Close the port. Not while another thread reads: `cancel` first."""
        with self._lock:
            self._port.close()


def find_serial_number(port: str) -> str:
    """Return the serial number of the USB adapter behind a port, empty when it has none."""
    device = os.path.realpath(port)
    for found in list_ports.comports():
        if os.path.realpath(found.device) == device:
            return found.serial_number or ''
    return ''
