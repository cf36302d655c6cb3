# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated load cell on the tendon, with its own clock and its lines of text."""

from __future__ import annotations

import math

import numpy as np

from tactile_sim.descriptions.description import LoadCell
from tactile_sim.physics.sensing import (
    compute_drift_step_n,
    convert_one,
    low_pass_coefficients,
)
from tendon_sensor_driver.line_sensor import encode_reading

GRAVITY_M_S2 = 9.80665
DECIMALS = 5
BOOT_S = 0.5
"""Time from power-up to the first line [s]; assumed."""

_HEADER = b'\r\nSerial Load Cell Converter version 1.2\r\nBy SparkFun Electronics\r\n'
_BANNER = _HEADER + (
    b'No remote sensor found\r\nMinimum time between reports: 16\r\n'
    b'Press x to bring up settings\r\nReadings:\r\n'
)
_MENU = _HEADER + b'System Configuration\r\n1) Tare scale to zero [0]\r\nx) Exit\r\n>'


class LoadCellDevice:
    """Load cell that sends one line per sample: time [ms], kilograms, unit, ``SIMULATED``.

    An ``x`` opens its menu, as in an OpenScale. In the menu it sends no lines until the next
    ``x``, the only menu command that is simulated. With the same generator, its readings equal the
    results of ``sensing.read_tension``, apart from the rounding in the lines. Faults can overload
    the cell or freeze its reading.
    """

    def __init__(self, cell: LoadCell, generator: np.random.Generator) -> None:
        self._cell = cell
        self._generator = generator
        self._bias_n = self._drift_n = 0.0
        self._samples = 0
        self._first_sample = 0  # since power-up
        self._in_menu = False
        self._last_n = 0.0
        self.is_saturated = self.is_stuck = False
        self._time_s: float | None = None
        self._force_n = self._filtered_n = 0.0
        self._output = bytearray()

    def set_bias(self, bias_n: float) -> None:
        """Set the reading without load [N]; the drift continues."""
        self._bias_n = bias_n

    def draw_from(self, generator: np.random.Generator) -> None:
        """Take noise and drift from another random stream."""
        self._generator = generator

    def record(self, time_s: float, tension_n: float, contact_force_n: float) -> None:
        """Record the forces at the end of a simulation step.

        Between two calls the forces are interpolated linearly, for the filter and for the samples.
        The first call initialises the filter at rest.
        """
        force_n = tension_n + self._cell.crosstalk * contact_force_n
        if self._time_s is None:
            self._filtered_n = force_n
        else:
            step_s = time_s - self._time_s
            while (due_s := self._samples * self._cell.period_s) <= time_s:
                part_s = due_s - self._time_s
                between_n = self._force_n + (force_n - self._force_n) * (part_s / step_s)
                self._send(self._filter(part_s, between_n))
            self._filtered_n = self._filter(step_s, force_n)
        self._time_s, self._force_n = time_s, force_n

    def _filter(self, step_s: float, force_n: float) -> float:
        alpha, beta, gamma = low_pass_coefficients(step_s, self._cell.low_pass_hz)
        return alpha * self._filtered_n + beta * self._force_n + gamma * force_n

    def _send(self, filtered_n: float) -> None:
        noise, step = self._generator.standard_normal(2).tolist()
        if self._samples:
            self._drift_n += compute_drift_step_n(self._cell) * step
        signal_n = filtered_n + (self._bias_n + self._drift_n)
        if self.is_saturated:
            signal_n = math.inf
        if not self.is_stuck:
            self._last_n = convert_one(self._cell, signal_n, noise)
        sample = self._samples - self._first_sample
        if sample == 0 and self._first_sample:
            self._output += _BANNER
        if sample >= 0 and not self._in_menu:
            milliseconds = int(sample * 1000 / self._cell.rate_hz)
            kilograms = self._last_n / GRAVITY_M_S2
            self._output += encode_reading(
                milliseconds, kilograms, 'kg', DECIMALS, is_simulated=True
            )
        self._samples += 1

    def restart(self) -> None:
        """Lose power for a moment: banner, then lines with a clock that restarts at 0."""
        self._first_sample = self._samples + round(BOOT_S * self._cell.rate_hz)
        self._in_menu = False
        self._output.clear()

    def enter_menu(self) -> None:
        """Open the menu and send no lines, as if ``x`` had been typed."""
        self._in_menu = True
        self._output += _MENU

    def leave_menu(self) -> None:
        """Send lines again; has no effect outside the menu."""
        if self._in_menu:
            self._in_menu = False
            self._output += b'Exiting\r\n'

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Receive bytes from the line; only ``x`` has an effect."""
        for byte in data:
            if self._in_menu and byte == ord('x'):
                self.leave_menu()
            elif self._in_menu or byte == ord('x'):
                self.enter_menu()
        return self.poll(now_s)

    @property
    def due_s(self) -> float:
        """Time from which `poll` may return bytes although nothing was received."""
        return -math.inf if self._output else self._samples * self._cell.period_s

    def poll(self, now_s: float) -> bytes:
        """Return the lines that are due since the last call."""
        sent, self._output = bytes(self._output), bytearray()
        return sent
