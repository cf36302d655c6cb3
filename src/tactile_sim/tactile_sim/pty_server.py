# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serve simulated devices on pseudo-terminals (ptys): a rig, or a load cell with weights."""

from __future__ import annotations

from collections.abc import Collection, Sequence
import contextlib
import math
import os
from pathlib import Path
import select
import tempfile
import threading
import time
import tty
from typing import Any

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.faults import FaultRequest, FaultyLine, GuideLine, SensorLine, TendonLine
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.errors import RigError
from tactile_sim.physics.variation import make_generator
from tactile_sim.rig import PalpationRig

_READ_BYTES = 4096

_CHUNK_S = 0.02
_MOST_BEHIND_S = 0.5
_STAND_STEP_S = 0.002
_SETTLE_S = 0.15
"""Time constant with which a hung weight comes to rest [s]."""


class PtyPort:
    """The pty of one device; drivers open it through the symbolic link ``link``.

    Drivers must not use the name of the pty itself, because the kernel can reuse this name for
    another program after the port has been unplugged. Raises `RigError` if ``link`` exists and is
    not a symbolic link.
    """

    def __init__(self, link: Path) -> None:
        self._link = link
        self._files: list[int] = []
        if link.exists() and not link.is_symlink():
            raise RigError(f'{link} exists and is not a symbolic link; choose another --links')
        self.open()

    @property
    def is_open(self) -> bool:
        """True while the port is plugged in."""
        return bool(self._files)

    def fileno(self) -> int:
        """Return the file descriptor that the device reads and writes (the master of the pty)."""
        return self._files[0]

    def open(self) -> None:
        """Create a pty and the symbolic link to it."""
        master, slave = os.openpty()
        # This process keeps the slave open. Otherwise, reading from the master would fail as soon
        # as a driver closes the port.
        self._files = [master, slave]
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))

    def close(self) -> None:
        """Remove the pty and its link. May be called repeatedly."""
        if self._files:
            self._link.unlink(missing_ok=True)
        while self._files:
            os.close(self._files.pop())

    def read(self) -> bytes:
        """Return bytes from the driver. Call this only when `select` reports available bytes."""
        return os.read(self.fileno(), _READ_BYTES)

    def write(self, data: bytes) -> None:
        """Send bytes to the driver. If the buffer of the pty is full, the bytes are lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self.fileno(), data)


class ServedRig:
    """A rig whose devices are connected to ptys; `exchange` advances its time.

    The symbolic links to the ptys are in the folder ``links``. If this is None, they are in a
    temporary folder, which `close` removes. A device that is unplugged and plugged in again gets
    a new pty, but the name of its link stays the same.

    Raises `RigError` if the path of a link exists and is not a link.
    """

    def __init__(self, rig: PalpationRig, links: Path | None = None, seed: int = 0) -> None:
        self.rig = rig
        self._lines: dict[str, FaultyLine[Any]] = {
            'guide': GuideLine(rig.guide, seed),
            'tendon': TendonLine(rig.tendon, seed + 1),
            'sensor': SensorLine(rig.sensor, seed + 2),
        }
        self._own_folder = None
        if links is None:
            self._own_folder = tempfile.TemporaryDirectory(prefix='tactile_rig_')
            links = Path(self._own_folder.name)
        links = links.absolute()
        links.mkdir(parents=True, exist_ok=True)
        self.ports = {name: str(links / name) for name in self._lines}
        self._ports: dict[str, PtyPort] = {}
        try:
            for name in self._lines:
                self._ports[name] = PtyPort(links / name)
        except BaseException:
            self.close()
            raise

    @property
    def files(self) -> list[int]:
        """File descriptors of the plugged-in ports, for `select`."""
        return [port.fileno() for port in self._ports.values() if port.is_open]

    @property
    def due_s(self) -> float:
        """Time of the rig [s] at which `exchange` must be called if no driver sends anything."""
        return self.rig.step_time_s(min(map(self._find_due_s, self._lines)))

    def _find_due_s(self, name: str) -> float:
        line, port = self._lines[name], self._ports[name]
        return line.due_s if port.is_open != line.is_unplugged else -math.inf

    def exchange(self, now_s: float, readable: Collection[int]) -> None:
        """Advance the rig to ``now_s``, and pass on bytes between drivers and devices."""
        now_s = self.rig.advance(now_s)
        for name, port in self._ports.items():
            line = self._lines[name]
            has_input = port.is_open and port.fileno() in readable
            if not has_input and self._find_due_s(name) > now_s:
                continue
            output = line.receive(port.read(), now_s) if has_input else b''
            output += line.poll(now_s)
            if line.is_unplugged:
                port.close()
                continue
            if not port.is_open:
                port.open()
            if output:
                port.write(output)

    def fault(self, request: FaultRequest) -> None:
        """Begin a fault, or end the faults of a device."""
        self._lines[request.device].begin(request, self.rig.now_s)

    def close(self) -> None:
        """Remove the ports. May be called repeatedly."""
        for port in self._ports.values():
            port.close()
        if self._own_folder is not None:
            self._own_folder.cleanup()


class RigClock:
    """Runs one or several rigs in real time, starting from time 0.

    If the host is too slow to compute all steps in time, the time of the rigs passes more slowly
    than the time of the host.
    """

    def __init__(self, rigs: Sequence[ServedRig]) -> None:
        self._rigs = rigs
        self._start_s = time.monotonic()
        self._now_s = 0.0

    def run(self, other: int) -> bool:
        """Wait for the next byte to send or receive, and serve it.

        ``other`` is a file descriptor, such as standard input. If it becomes readable, the wait
        ends and the result is True.

        Raises `RigError` when the simulation has stopped.
        """
        # The wait is limited to _CHUNK_S, so that few steps have to be computed after it.
        due_s = min(self._now_s + _CHUNK_S, *(rig.due_s for rig in self._rigs))
        wait_s = max(self._start_s + due_s - time.monotonic(), 0.0)
        files = [file for rig in self._rigs for file in rig.files]
        readable, _, _ = select.select([other, *files], [], [], wait_s)
        behind_s = time.monotonic() - self._start_s - self._now_s
        if behind_s > _MOST_BEHIND_S:
            self._start_s += behind_s
            behind_s = 0.0
        # If the rigs are late, they advance by at most _CHUNK_S per call. In this way, bytes from
        # the drivers are also read while the rigs catch up.
        self._now_s += min(behind_s, _CHUNK_S)
        try:
            for rig in self._rigs:
                rig.exchange(self._now_s, readable)
        except Exception as error:
            raise RigError(f'the simulation stopped: {error}') from error
        return other in readable


class WeightStand:
    """Simulated load cell on a pty, on which weights are hung; a context manager.

    A driver with scale 1 and offset 0 reads ``(force - offset_n + hysteresis) / scale`` newtons.
    ``scale`` and ``offset_n`` are therefore the values that a calibration must find.
    ``hysteresis_n`` [N] is added after a heavier weight has been replaced by a lighter one.
    """

    def __init__(
        self,
        scale: float = 1.03,
        offset_n: float = -0.2,
        hysteresis_n: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._scale, self._offset_n, self._hysteresis_n = scale, offset_n, hysteresis_n
        self._folder = tempfile.TemporaryDirectory(prefix='tactile_stand_')
        self.port = str(Path(self._folder.name, 'sensor'))
        self._line = PtyPort(Path(self.port))
        cell = default_catalogue().rig().load_cell
        self._device = LoadCellDevice(cell, make_generator(seed, 'stand'))
        self._force_n = self._hung_n = self._extra_n = 0.0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='weight stand', daemon=True)

    def __enter__(self) -> WeightStand:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._line.close()
        self._folder.cleanup()

    def hang(self, force_n: float) -> None:
        """Replace the present weight by another one, which pulls with ``force_n`` [N]."""
        self._extra_n = self._hysteresis_n if force_n < self._hung_n else 0.0
        self._hung_n = force_n

    def _serve(self) -> None:
        started_s = time.monotonic()
        now_s = 0.0
        self._device.record(now_s, self._reading_n(), 0.0)
        while not self._ending.wait(0.005):
            due_s = time.monotonic() - started_s
            while now_s + _STAND_STEP_S <= due_s:
                now_s += _STAND_STEP_S
                self._force_n += (self._hung_n - self._force_n) * _STAND_STEP_S / _SETTLE_S
                self._device.record(now_s, self._reading_n(), 0.0)
            self._line.write(self._device.poll(now_s))

    def _reading_n(self) -> float:
        return (self._force_n - self._offset_n + self._extra_n) / self._scale
