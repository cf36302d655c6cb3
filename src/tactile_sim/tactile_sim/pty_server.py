# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves the rig's devices on pseudo-terminals, in real time, from one thread."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from typing import Protocol, TypeVar

from tactile_sim.rig import STEP_S, PalpationRig

_READ_BYTES = 4096
_CHUNK_S = 0.02
_MOST_BEHIND_S = 0.5
_T = TypeVar('_T')


class Device(Protocol):
    """A device's core: bytes in, bytes out, told the time."""

    def receive(self, data: bytes, now_s: float) -> bytes: ...

    def poll(self, now_s: float) -> bytes: ...


class PtyServer:
    """Runs a rig by the host's clock and connects its devices to ptys.

    When the host is too slow, the rig's clock slips rather than run behind without end.

    Parameters
    ----------
    rig
        The rig; after `start` it belongs to the server's thread, see `call`.

    Attributes
    ----------
    ports : dict of str to str
        Paths of the ptys: guide, tendon, sensor.
    failure : Exception or None
        What ended the thread.
    slipped_s : float
        How much the rig's clock has slipped [s].
    """

    def __init__(self, rig: PalpationRig) -> None:
        self._rig = rig
        self._devices: dict[str, Device] = {
            'guide': rig.guide,
            'tendon': rig.tendon,
            'sensor': rig.sensor,
        }
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='pty_server', daemon=True)
        self.failure: Exception | None = None
        self.slipped_s = 0.0
        self.ports: dict[str, str] = {}
        self._masters: dict[int, str] = {}
        self._files: list[int] = []
        for name in self._devices:
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            # The spare slave stays open, or reading the master fails when a client closes.
            self._files += [master, slave]
            self._masters[master] = name
            self.ports[name] = os.ttyname(slave)

    def start(self) -> None:
        """Start the rig's clock."""
        self._thread.start()

    def call(self, function: Callable[[PalpationRig], _T]) -> _T:
        """Do something with the rig between two steps."""
        with self._lock:
            return function(self._rig)

    def close(self) -> None:
        """Stop the thread and close the ptys; harmless when called twice."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        while self._files:
            os.close(self._files.pop())

    def _run(self) -> None:
        try:
            self._serve()
        except Exception as error:
            self.failure = error

    def _serve(self) -> None:
        start_s = time.monotonic() - self._rig.now_s
        while not self._stopping.is_set():
            behind_s = time.monotonic() - start_s - self._rig.now_s
            if behind_s > _MOST_BEHIND_S:
                start_s += behind_s
                self.slipped_s += behind_s
            wait_s = 0.0 if behind_s > STEP_S else STEP_S - behind_s
            readable, _, _ = select.select(list(self._masters), [], [], wait_s)
            with self._lock:
                due_s = time.monotonic() - start_s
                now_s = self._rig.advance(min(due_s, self._rig.now_s + _CHUNK_S))
                for master, name in self._masters.items():
                    self._exchange(master, name, master in readable, now_s)

    def _exchange(self, master: int, name: str, has_input: bool, now_s: float) -> None:
        device = self._devices[name]
        output = b''
        if has_input:
            output = device.receive(os.read(master, _READ_BYTES), now_s)
        output += device.poll(now_s)
        if output:
            # A full pty loses bytes, as a serial line without handshake does.
            with contextlib.suppress(BlockingIOError):
                os.write(master, output)
