# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bytes from a serial port."""

from __future__ import annotations

from contextlib import suppress
import errno
import os
import select
import termios
import threading

import serial
from serial.tools import list_ports

from tendon_sensor_driver.errors import LinkError

_WRITE_TIMEOUT_S = 0.5
_MOST_BYTES = 4096

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
        By every method, when the port cannot be opened, has gone or takes nothing.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._name = port
        self._lock = threading.Lock()
        try:
            # exclusive: two readers would each get half of the lines.
            self._port = serial.Serial(
                port, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
        except _FAILURES as error:
            reason = _REMEDIES.get(getattr(error, 'errno', None) or 0, str(error))
            raise LinkError(f'cannot open serial port {port}: {reason}') from error
        self._cancelled, self._cancel = os.pipe()
        os.set_blocking(self._cancel, False)

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, or nothing after some time without any or after `cancel`."""
        # As pyserial's read, but with one wait and one read for all that has come.
        try:
            port = self._port.fileno()
            ready, _, _ = select.select([port, self._cancelled], [], [], timeout_s)
            if self._cancelled in ready:
                os.read(self._cancelled, 1)
                return b''
            data = os.read(port, _MOST_BYTES) if ready else b''
        except BlockingIOError:
            return b''
        except _FAILURES as error:
            raise LinkError(f'lost serial port {self._name}: {error}') from error
        if ready and not data:
            raise LinkError(
                f'lost serial port {self._name}: it is ready to read and gives nothing'
            )
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)
        except _FAILURES as error:
            raise LinkError(f'cannot write to serial port {self._name}: {error}') from error

    def cancel(self) -> None:
        """Make a `read` that waits in another thread return. Harmless on a closed port."""
        with self._lock:  # the pipe's number may belong to another file after close
            if self._port.is_open:
                with suppress(BlockingIOError):  # a full pipe ends the wait, too
                    os.write(self._cancel, b'x')

    def close(self) -> None:
        """Close the port. Not while another thread reads: `cancel` first."""
        with self._lock:
            if self._port.is_open:
                self._port.close()
                os.close(self._cancelled)
                os.close(self._cancel)


def find_serial_number(port: str) -> str:
    """Return the serial number of the USB adapter behind a port, empty when it has none."""
    device = os.path.realpath(port)
    try:
        ports = list_ports.comports()
    except (OSError, TypeError, ValueError):  # of pyserial, while a device is being unplugged
        return ''
    for found in ports:
        if os.path.realpath(found.device) == device:
            return found.serial_number or ''
    return ''
