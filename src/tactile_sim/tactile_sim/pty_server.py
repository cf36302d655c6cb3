# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serves the rig's devices on pseudo-terminals, in real time, from one thread."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import select
import tempfile
import threading
import time
from typing import Any, TypeVar

from tactile_sim.devices.faults import FaultRequest, FaultyLine, GuideLine, SensorLine, TendonLine
from tactile_sim.devices.pty_port import PtyPort
from tactile_sim.rig import PalpationRig, STEP_S

_CHUNK_S = 0.02
_MOST_BEHIND_S = 0.5
_T = TypeVar('_T')


class PtyServer:
    """Runs a rig by the host's clock and connects its devices to ptys.

    When the host is too slow, the rig's clock slips rather than run behind without end.

    Parameters
    ----------
    rig
        The rig; after `start` it belongs to the server's thread, see `call`.
    links
        Folder for the names of the ports; None: one of its own, gone after `close`.
    seed
        Of what is random in the faults.

    Attributes
    ----------
    ports : dict of str to str
        Names of the ports: guide, tendon, sensor. They stay when a port is unplugged.
    failure : Exception or None
        What ended the thread.

    Raises
    ------
    RigError
        Where a port's name should be is something else.
    """

    def __init__(self, rig: PalpationRig, links: Path | None = None, seed: int = 0) -> None:
        self._rig = rig
        self._lines: dict[str, FaultyLine[Any]] = {
            'guide': GuideLine(rig.guide, seed),
            'tendon': TendonLine(rig.tendon, seed + 1),
            'sensor': SensorLine(rig.sensor, seed + 2),
        }
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='pty_server', daemon=True)
        self.failure: Exception | None = None
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

    def start(self) -> None:
        """Start the rig's clock."""
        self._thread.start()

    def call(self, function: Callable[[PalpationRig], _T]) -> _T:
        """Do something with the rig between two steps."""
        with self._lock:
            return function(self._rig)

    def fault(self, request: FaultRequest) -> None:
        """Begin a fault, or end those of a device."""
        self.call(lambda rig: self._lines[request.device].begin(request, rig.now_s))

    def close(self) -> None:
        """Stop the thread and take the ports away; harmless when called twice."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        for port in self._ports.values():
            port.close()
        if self._own_folder is not None:
            self._own_folder.cleanup()

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
            wait_s = 0.0 if behind_s > STEP_S else STEP_S - behind_s
            plugged = [port for port in self._ports.values() if port.is_open]
            readable, _, _ = select.select(plugged, [], [], wait_s)
            with self._lock:
                due_s = time.monotonic() - start_s
                now_s = self._rig.advance(min(due_s, self._rig.now_s + _CHUNK_S))
                for name, port in self._ports.items():
                    self._exchange(self._lines[name], port, port in readable, now_s)

    def _exchange(
        self, line: FaultyLine[Any], port: PtyPort, has_input: bool, now_s: float
    ) -> None:
        output = line.receive(port.read(), now_s) if has_input else b''
        output += line.poll(now_s)
        if line.is_unplugged:
            port.close()
            return
        if not port.is_open:
            port.open()
        if output:
            port.write(output)
