# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
from decimal import Decimal, localcontext

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.sensing import convert_to_reading, low_pass_coefficients, read_tension

CELL = default_catalogue().rig().load_cell
QUIET = dataclasses.replace(CELL, noise_n=0.0, drift_n_rt_s=0.0)
PI = Decimal('3.14159265358979323846264338327950288419716939937510582097494459')


def make_generators(count, seed=0):
    return [np.random.default_rng([seed, i]) for i in range(count)]


def compute_exactly(step_s, low_pass_hz):
    with localcontext() as context:
        context.prec = 400  # the quotients cancel down to steps of 1e-300 s
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
