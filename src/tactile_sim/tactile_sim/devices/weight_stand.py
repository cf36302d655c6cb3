# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated load cell from which weights hang: for calibrations with a known truth."""

from __future__ import annotations

from pathlib import Path
import tempfile
import threading
import time

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.load_cell_device import LoadCellDevice
from tactile_sim.devices.pty_port import PtyPort
from tactile_sim.physics.variation import make_generator

_STEP_S = 0.002
_SETTLE_S = 0.15
"""Time constant with which a hung weight comes to rest."""


class WeightStand:
    """Serves a load cell on a pty; a context manager.

    Its reading in newtons, with scale 1 and offset 0, is
    ``(force - offset_n + hysteresis) / scale``. The hysteresis is there on the way down.

    Parameters
    ----------
    scale, offset_n
        The truth that a calibration shall find.
    hysteresis_n
        [N]
    seed
        Of noise and drift.

    Attributes
    ----------
    port : str
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
        """Hang a weight of this force instead of the one before [N]."""
        self._extra_n = self._hysteresis_n if force_n < self._hung_n else 0.0
        self._hung_n = force_n

    def _serve(self) -> None:
        started_s = time.monotonic()
        now_s = 0.0
        self._device.record(now_s, self._reading_n(), 0.0)
        while not self._ending.wait(0.005):
            due_s = time.monotonic() - started_s
            while now_s + _STEP_S <= due_s:
                now_s += _STEP_S
                self._force_n += (self._hung_n - self._force_n) * _STEP_S / _SETTLE_S
                self._device.record(now_s, self._reading_n(), 0.0)
            self._line.write(self._device.poll(now_s))

    def _reading_n(self) -> float:
        return (self._force_n - self._offset_n + self._extra_n) / self._scale
