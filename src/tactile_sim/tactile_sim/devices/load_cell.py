# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated load cell on the tendon, which sends its readings as lines of text."""

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
"""Assumed time from power-up until the load cell sends its first line [s]."""

_HEADER = b'\r\nSerial Load Cell Converter version 1.2\r\nBy SparkFun Electronics\r\n'
_BANNER = _HEADER + (
    b'No remote sensor found\r\nMinimum time between reports: 16\r\n'
    b'Press x to bring up settings\r\nReadings:\r\n'
)
_MENU = _HEADER + b'System Configuration\r\n1) Tare scale to zero [0]\r\nx) Exit\r\n>'


class LoadCellDevice:
    """Load cell that sends one line of text per sample, as a SparkFun OpenScale does.

    A line contains the time [ms], the reading in kilograms, the unit, and ``SIMULATED``. A
    received ``x`` opens a menu, during which no lines are sent. Another ``x`` closes it; no other
    command of the menu is simulated. With the same random generator, the readings are equal to the
    results of ``sensing.read_tension``, apart from the rounding to the decimals of a line.
    ``is_saturated`` and ``is_stuck`` simulate an overloaded cell and a constant reading.
    """

    def __init__(self, cell: LoadCell, generator: np.random.Generator) -> None:
        self._cell = cell
        self._generator = generator
        self._bias_n = self._drift_n = 0.0
        self._samples = 0
        self._first_sample = 0  # number of the first sample since power-up
        self._in_menu = False
        self._last_n = 0.0
        self.is_saturated = self.is_stuck = False
        self._time_s: float | None = None
        self._force_n = self._filtered_n = 0.0
        self._output = bytearray()

    def set_bias(self, bias_n: float) -> None:
        """Set the reading without load [N]. The drift is added to it."""
        self._bias_n = bias_n

    def draw_from(self, generator: np.random.Generator) -> None:
        """Use another random generator for noise and drift."""
        self._generator = generator

    def record(self, time_s: float, tension_n: float, contact_force_n: float) -> None:
        """Record the forces at the end of a simulation step.

        The force on the cell is interpolated linearly between two calls, both as the input of the
        low-pass filter and for samples within the step. The first call sets the state of the
        filter to the present force.
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
        """Simulate a short interruption of the power supply.

        The cell sends its banner, and then lines whose times start at 0.
        """
        self._first_sample = self._samples + round(BOOT_S * self._cell.rate_hz)
        self._in_menu = False
        self._output.clear()

    def enter_menu(self) -> None:
        """Open the menu, as a received ``x`` does. In the menu, no lines are sent."""
        self._in_menu = True
        self._output += _MENU

    def leave_menu(self) -> None:
        """Close the menu, if it is open, so that lines are sent again."""
        if self._in_menu:
            self._in_menu = False
            self._output += b'Exiting\r\n'

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Receive bytes from the serial line. An ``x`` opens or closes the menu."""
        for byte in data:
            if self._in_menu and byte == ord('x'):
                self.leave_menu()
            elif self._in_menu or byte == ord('x'):
                self.enter_menu()
        return self.poll(now_s)

    @property
    def due_s(self) -> float:
        """Time from which `poll` can return bytes even if nothing is received before [s]."""
        return -math.inf if self._output else self._samples * self._cell.period_s

    def poll(self, now_s: float) -> bytes:
        """Return the bytes that the load cell has sent since the last call."""
        sent, self._output = bytes(self._output), bytearray()
        return sent
