# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The load cell on the tendon: what it measures, and the lines that it sends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_sim.description import LoadCell
from tendon_sensor_driver.line_protocol import encode_reading

GRAVITY_M_S2 = 9.80665
DECIMALS = 5

FloatArray = NDArray[np.float64]


def compute_reading_kg(cell: LoadCell, tension_n: FloatArray, noise: FloatArray) -> FloatArray:
    """What the cell's display would say [kg].

    Parameters
    ----------
    tension_n : ndarray of float
        True tension [N].
    noise : ndarray of float
        Standard normal numbers, same shape.
    """
    limited = np.clip(tension_n + cell.noise_n * noise, -cell.capacity_n, cell.capacity_n)
    return np.asarray(np.round(limited / GRAVITY_M_S2, DECIMALS))


def interpolate_tension(
    before_s: float, before_n: FloatArray, after_s: float, after_n: FloatArray, time_s: float
) -> FloatArray:
    """Tension at a time between two steps of the physics."""
    part = (time_s - before_s) / (after_s - before_s)
    return before_n + part * (after_n - before_n)


class LoadCellDevice:
    """Sends a line a sample: device clock in milliseconds, kilograms, unit.

    Parameters
    ----------
    cell
        The description.
    generator
        Source of the noise.
    """

    def __init__(self, cell: LoadCell, generator: np.random.Generator) -> None:
        self._cell = cell
        self._generator = generator
        self._samples = 0
        self._before: tuple[float, FloatArray] | None = None
        self._output = bytearray()

    def record(self, time_s: float, tension_n: FloatArray) -> None:
        """Take note of the tension at the end of a step; shape (1,)."""
        if self._before is not None:
            while (due_s := self._samples * self._cell.period_s) <= time_s:
                tension = interpolate_tension(*self._before, time_s, tension_n, due_s)
                self._send(tension)
        self._before = (time_s, tension_n)

    def _send(self, tension_n: FloatArray) -> None:
        noise = self._generator.standard_normal(1)
        kilograms = float(compute_reading_kg(self._cell, tension_n, noise)[0])
        milliseconds = int(self._samples * 1000 / self._cell.rate_hz)
        self._output += encode_reading(milliseconds, kilograms, 'kg', DECIMALS)
        self._samples += 1

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Ignore what is sent to it: it only talks."""
        return b''

    def poll(self, now_s: float) -> bytes:
        """Lines that are due since the last call."""
        sent, self._output = bytes(self._output), bytearray()
        return sent
