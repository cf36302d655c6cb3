# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A serial port with a reader thread."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import select
import termios
import threading

import serial

from linear_guide_driver.errors import DeviceConnectionError

LINE_ERRORS = (OSError, termios.error, TypeError)
"""Exceptions of pyserial when a port is lost: SerialException is an OSError, flushing a
lost tty raises termios.error, and closing during a read raises TypeError."""

TICK_S = 0.02
"""Longest time [s] between two calls of ``on_tick`` during a motion or the wait for an answer."""


class SerialLink:
    """An open serial port.

    Parameters
    ----------
    port : str
        Name of the port.
    baud : int
        Speed [bit/s].
    on_bytes : callable
        Called on the reader thread with the received bytes.
    on_tick : callable
        Called on the reader thread after each read. Returns the longest time until the next call
        [s].
    on_lost : callable
        Called once with the reason when the port is lost, on the thread that detects the loss:
        the reader thread, or the caller of `write` before it raises.

    Raises
    ------
    DeviceConnectionError
        If the port cannot be opened; also by `write`.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        *,
        on_bytes: Callable[[bytes], None],
        on_tick: Callable[[], float],
        on_lost: Callable[[str], None],
    ) -> None:
        try:
            self._serial = serial.Serial(port, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (*LINE_ERRORS, ValueError) as error:
            raise DeviceConnectionError(
                f'cannot open {port}: {error}; check that the device is plugged in, that the '
                f'parameter port is correct and that no other program uses the port'
            ) from error
        self._port = port
        self._on_bytes, self._on_tick, self._on_lost = on_bytes, on_tick, on_lost
        self._write_lock = threading.Lock()
        self._closing = threading.Event()
        self._losing = threading.RLock()
        self._is_lost = False
        self._thread = threading.Thread(target=self._read, name='serial reader', daemon=True)

    def start(self) -> None:
        """Start the reader thread."""
        self._thread.start()

    def write(self, data: bytes) -> None:
        """Write bytes to the port."""
        try:
            with self._write_lock:
                self._serial.write(data)
        except LINE_ERRORS as error:
            reason = f'the connection to {self._port} is lost: {error}'
            self._lose(reason)
            raise DeviceConnectionError(reason) from error

    def close(self) -> None:
        """Stop reading and close the port; idempotent."""
        self._closing.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(2.0)
        with suppress(*LINE_ERRORS):  # the port may be lost already
            self._serial.close()

    def _read(self) -> None:
        # Waits with `select.poll`, because pyserial's timeout is fixed when the port is opened.
        waiting = select.poll()
        wait_s = TICK_S
        try:
            waiting.register(self._serial, select.POLLIN)
            while not self._closing.is_set():
                data = b''
                try:
                    if waiting.poll(wait_s * 1000):  # also for a lost port; `read` then raises
                        data = bytes(self._serial.read(self._serial.in_waiting or 1))
                except LINE_ERRORS as error:
                    self._lose(f'the connection to {self._port} is lost: {error}')
                    return
                if data:
                    self._on_bytes(data)
                wait_s = self._on_tick()
        except DeviceConnectionError as error:  # a query could not be written
            self._lose(str(error))
        except Exception as error:  # without a reader, the port is unusable
            self._lose(f'reading {self._port} failed: {error!r}')
            raise

    def _lose(self, reason: str) -> None:
        with self._losing:  # a second thread waits until the first has reported the loss
            if not self._is_lost and not self._closing.is_set():
                self._is_lost = True
                self._on_lost(reason)
