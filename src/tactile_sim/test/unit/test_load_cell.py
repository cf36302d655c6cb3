# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated load cell: readings for given forces, and the lines that it sends."""

import dataclasses
from decimal import Decimal, localcontext

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.physics.sensing import (
    convert_one,
    convert_to_reading,
    low_pass_coefficients,
    read_tension,
)

CELL = default_catalogue().rig().load_cell
QUIET = dataclasses.replace(CELL, noise_n=0.0, drift_n_rt_s=0.0)
PI = Decimal('3.14159265358979323846264338327950288419716939937510582097494459')


def make_generators(count, seed=0):
    return [np.random.default_rng([seed, i]) for i in range(count)]


def compute_exactly(step_s, low_pass_hz):
    with localcontext() as context:
        context.prec = 400  # digits; the differences below cancel most of them for short steps
        a = 2 * PI * Decimal(low_pass_hz) * Decimal(step_s)
        alpha = (-a).exp()
        mean = (1 - alpha) / a
        return alpha, mean - alpha, 1 - mean


@pytest.mark.parametrize(
    'step_s', [1e-150, 1e-6, 1e-3, 4.5e-3, 1 / (2 * np.pi * 35), 4.6e-3, 0.1, 1e4]
)
def test_low_pass_coefficients_against_exact_decimals(step_s):
    pairs = zip(low_pass_coefficients(step_s, 35.0), compute_exactly(step_s, 35.0), strict=True)
    for value, exact in pairs:
        assert value == pytest.approx(float(exact), rel=5e-15, abs=1e-300)


def test_low_pass_without_and_with_endless_step():
    assert low_pass_coefficients(0.0, 35.0) == (1.0, 0.0, 0.0)
    assert low_pass_coefficients(np.inf, 35.0) == (0.0, 0.0, 1.0)


@given(st.floats(-1e4, 1e4) | st.sampled_from([-np.inf, np.inf]), st.floats(-5.0, 5.0))
def test_one_reading_has_the_bits_of_many(signal_n, noise):
    one = convert_one(CELL, signal_n, noise)
    many = convert_to_reading(CELL, np.array([signal_n]), np.array([noise]))
    assert one.hex() == float(many[0]).hex()


@pytest.mark.parametrize(('capacity_n', 'most_n'), [(19.6133, 19.613), (20.0, 20.0), (0.3, 0.3)])
def test_readings_saturate_at_the_last_step_within_the_capacity(capacity_n, most_n):
    cell = dataclasses.replace(QUIET, capacity_n=capacity_n)
    readings = convert_to_reading(cell, np.array([-1e9, 1e9, capacity_n]), np.zeros(3))
    assert readings == pytest.approx([-most_n, most_n, most_n], abs=1e-12)


def test_what_is_no_number_stays_so_and_the_first_sample_has_no_drift():
    drifting = dataclasses.replace(QUIET, drift_n_rt_s=1.0)
    tension = np.array([[1.0, np.nan, 2.0]])
    readings = read_tension(drifting, tension, np.zeros(1), make_generators(1))
    assert readings[0, 0] == 1.0
    assert np.isnan(readings).tolist() == [[False, True, False]]


def test_noise_and_drift_have_the_stated_size():
    readings = read_tension(CELL, np.full((400, 601), 5.0), np.zeros(400), make_generators(400))
    spread = np.hypot(CELL.noise_n, CELL.resolution_n / np.sqrt(12))
    assert readings[:, 0].std() == pytest.approx(spread, rel=0.1)
    loud = dataclasses.replace(QUIET, drift_n_rt_s=0.1)
    drift = read_tension(loud, np.zeros((400, 601)), np.zeros(400), make_generators(400))
    seconds = 600 * CELL.period_s
    assert drift[:, -1].std() == pytest.approx(0.1 * np.sqrt(seconds), rel=0.1)
    assert drift[:, 150].std() == pytest.approx(0.1 * np.sqrt(seconds / 4), rel=0.1)


def test_the_first_readings_do_not_depend_on_how_many_follow():
    long = read_tension(CELL, np.full((2, 90), 5.0), np.zeros(2), make_generators(2))
    short = read_tension(CELL, np.full((2, 30), 5.0), np.zeros(2), make_generators(2))
    assert np.array_equal(long[:, :30], short)


@given(st.floats(-50.0, 50.0), st.floats(1e-6, 1.0))
def test_readings_are_whole_steps_near_the_signal(signal_n, resolution_n):
    cell = dataclasses.replace(QUIET, resolution_n=resolution_n)
    reading = float(convert_to_reading(cell, np.array([signal_n]), np.zeros(1))[0])
    if abs(signal_n) < cell.capacity_n - resolution_n:
        assert abs(reading - signal_n) <= resolution_n * (0.5 + 1e-9)
    assert abs(reading) <= cell.capacity_n * (1 + 1e-12)
    assert round(reading / resolution_n) * resolution_n == pytest.approx(reading, rel=1e-12)


# -- the device ------------------------------------------------------------------------------

FINE = dataclasses.replace(QUIET, resolution_n=1e-6)
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
    lines = record(FINE, lambda t: 2.0 * t, seconds, step_s=step_s)
    # After one second, the 61st line is only 30 microseconds away.
    assert len(lines) in (60, 61)
    assert [int(line[0]) for line in lines[:4]] == [0, 16, 33, 50]
    true_s = np.arange(len(lines)) / 60 * (1 + 30e-6)
    lag_s = 1 / (2 * np.pi * FINE.low_pass_hz)
    # The response of a first-order low pass to a ramp lags by its time constant in the end.
    wanted = 2.0 * (true_s - lag_s * (1 - np.exp(-true_s / lag_s)))
    assert read_newtons(lines) == pytest.approx(wanted, abs=ROUNDING_N + 1e-6)
    assert {tuple(line[2:]) for line in lines} == {(b'kg', b'SIMULATED', b'')}


def test_contact_and_bias_reach_the_reading():
    lines = record(FINE, lambda t: 5.0, 0.2, contact_n=2.0, bias_n=-0.1)
    wanted = 5.0 + FINE.crosstalk * 2.0 - 0.1
    assert read_newtons(lines) == pytest.approx(wanted, abs=ROUNDING_N)


def test_readings_are_those_of_the_fast_path():
    lines = record(CELL, lambda t: 4.0, 2.0, bias_n=0.03)
    fast = read_tension(
        CELL, np.full((1, len(lines)), 4.0), np.array([0.03]), [np.random.default_rng(1)]
    )
    assert read_newtons(lines) == pytest.approx(fast[0], abs=ROUNDING_N)
    assert np.ptp(fast) > 3 * CELL.noise_n


class Bench:
    """A simulated load cell with a constant tension of 3 N, in virtual time."""

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
