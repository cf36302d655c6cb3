# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.physics.sensing import read_tension

CELL = default_catalogue().rig().load_cell
QUIET = dataclasses.replace(CELL, noise_n=0.0, drift_n_rt_s=0.0, resolution_n=1e-6)
ROUNDING_N = 0.51e-5 * 9.80665


def record(cell, tension_at, seconds, contact_n=0.0, bias_n=0.0, step_s=1e-3):
    device = LoadCellDevice(cell, np.random.default_rng(1))
    device.set_bias(bias_n)
    lines = b''
    for step in range(round(seconds / step_s) + 1):
        device.record(step * step_s, tension_at(step * step_s), contact_n)
        lines += device.poll(step * step_s)
    return split(lines)


def split(lines):
    return [line.split(b',') for line in lines.split(b'\r\n')[:-1]]


def read_newtons(lines):
    return np.array([float(line[1]) for line in lines]) * 9.80665


@pytest.mark.parametrize('step_s', [1e-3, 2.7e-3, 5e-2])
def test_lines_carry_time_and_filtered_tension_between_steps(step_s):
    seconds = 20 * step_s if step_s > 1e-2 else 1.0
    lines = record(QUIET, lambda t: 2.0 * t, seconds, step_s=step_s)
    assert len(lines) in (60, 61)  # the sixty-first comes 30 microseconds after the second
    assert [int(line[0]) for line in lines[:4]] == [0, 16, 33, 50]
    true_s = np.arange(len(lines)) / 60 * (1 + 30e-6)
    lag_s = 1 / (2 * np.pi * QUIET.low_pass_hz)
    # A ramp through one pole, from rest: it lags by its time constant.
    wanted = 2.0 * (true_s - lag_s * (1 - np.exp(-true_s / lag_s)))
    assert read_newtons(lines) == pytest.approx(wanted, abs=ROUNDING_N + 1e-6)
    assert {tuple(line[2:]) for line in lines} == {(b'kg', b'SIMULATED', b'')}


def test_contact_and_bias_reach_the_reading():
    lines = record(QUIET, lambda t: 5.0, 0.2, contact_n=2.0, bias_n=-0.1)
    wanted = 5.0 + QUIET.crosstalk * 2.0 - 0.1
    assert read_newtons(lines) == pytest.approx(wanted, abs=ROUNDING_N)


def test_readings_are_those_of_the_fast_path():
    lines = record(CELL, lambda t: 4.0, 2.0, bias_n=0.03)
    fast = read_tension(
        CELL, np.full((1, len(lines)), 4.0), np.array([0.03]), [np.random.default_rng(1)]
    )
    assert read_newtons(lines) == pytest.approx(fast[0], abs=ROUNDING_N)
    assert np.ptp(fast) > 3 * CELL.noise_n


class Bench:
    """A load cell under 3 N, and its clock."""

    def __init__(self):
        self.device = LoadCellDevice(CELL, np.random.default_rng(1))
        self.steps = 0

    def wait(self, seconds):
        lines = b''
        for _ in range(round(seconds * 1000)):
            self.device.record(self.steps * 1e-3, 3.0, 0.0)
            lines += self.device.poll(self.steps * 1e-3)
            self.steps += 1
        return lines


def test_power_loss_restarts_its_clock_after_a_banner():
    bench = Bench()
    assert bench.wait(1.0)
    bench.device.enter_menu()
    bench.device.restart()
    assert bench.wait(0.45) == b''
    text, _, lines = bench.wait(0.5).partition(b'Readings:\r\n')
    assert text.startswith(b'\r\nSerial Load Cell Converter version 1.2\r\n')
    assert [row[0] for row in split(lines)[:3]] == [b'0', b'16', b'33']


def test_in_the_menu_it_sends_no_lines_and_its_clock_goes_on():
    bench = Bench()
    last = int(split(bench.wait(0.1))[-1][0])
    assert bench.device.receive(b'y', 0.0) == b''
    assert bench.device.receive(b'x', 0.0).endswith(b'x) Exit\r\n>')
    assert bench.wait(1.0) == b''
    assert bench.device.receive(b'?', 0.0).endswith(b'>')
    assert bench.device.receive(b'x', 0.0) == b'Exiting\r\n'
    assert int(split(bench.wait(0.1))[0][0]) - last in range(1000, 1034)
    bench.device.leave_menu()
    assert b'Exiting' not in bench.wait(0.1)


def test_faults_of_the_reading_do_not_change_what_comes_after():
    sound, faulty = Bench(), Bench()
    sound.wait(0.5), faulty.wait(0.5)
    faulty.device.is_stuck = True
    assert np.ptp(read_newtons(split(faulty.wait(0.5)))) == 0.0
    faulty.device.is_stuck = False
    faulty.device.is_saturated = True
    high = read_newtons(split(faulty.wait(0.5)))
    assert high == pytest.approx(CELL.capacity_n, abs=ROUNDING_N + CELL.resolution_n)
    faulty.device.is_saturated = False
    sound.wait(1.0)
    assert faulty.wait(0.5) == sound.wait(0.5)
