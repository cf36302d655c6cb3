# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bends and jumps of made-up signals, against what they were made of and against numpy."""

import numpy as np
import pytest

from tactile_features.phases import estimate_noise_n, locate_bend, locate_step, measure_step

RNG = np.random.default_rng(0)
TIME_S = np.arange(20) / 60


def test_noise_is_told_from_level_slope_and_what_happens_once():
    noise = RNG.normal(0.0, 0.1, 20_000)
    signal = 7.0 + 1e-4 * np.arange(20_000) + noise
    signal[10_000:] += 50.0
    assert estimate_noise_n(signal) == pytest.approx(0.1, rel=0.05)
    assert estimate_noise_n(signal[:1]) == 0.0


@pytest.mark.parametrize('at', [3, 9, 15])
def test_a_bend_is_where_two_lines_meet(at):
    bent = np.minimum(20.0 * (TIME_S - TIME_S[at]), -1.0 * (TIME_S - TIME_S[at]))
    assert locate_bend(TIME_S, 5.0 + bent) == at


def test_a_jump_and_its_uncertainty_are_those_of_least_squares():
    signal = RNG.normal(0.0, 1.0, 20)
    step = measure_step(TIME_S, signal, 8)
    design = np.stack([np.ones(20), TIME_S, np.arange(20) >= 8], axis=1)
    _, slope, height = np.linalg.lstsq(design, signal, rcond=None)[0]
    assert step.height_n == pytest.approx(height, rel=1e-9)
    assert step.slope_n_s == pytest.approx(slope, rel=1e-9)
    covariance = np.linalg.inv(design.T @ design)
    assert step.spread == pytest.approx(np.sqrt(covariance[2, 2]), rel=1e-9)
    line = np.polynomial.Polynomial.fit(TIME_S[:8], signal[:8], 1)
    left = np.sum((signal[:8] - line(TIME_S[:8])) ** 2) / 6
    assert step.before_n == pytest.approx(np.sqrt(left), rel=1e-9)


@pytest.mark.parametrize('height_n', [0.4, -0.4])
@pytest.mark.parametrize('first_after', [8, 12])
def test_a_jump_is_found_where_it_is(height_n, first_after):
    signal = 3.0 - 2.0 * TIME_S + height_n * (np.arange(20) >= first_after)
    assert locate_step(TIME_S, signal, 6) == first_after - 1


def test_a_jump_that_takes_some_samples_begins_with_the_first():
    share = np.clip((np.arange(20) - 8) / 4, 0.0, 1.0)
    signal = 3.0 - 2.0 * TIME_S - 0.5 * share + RNG.normal(0.0, 0.004, 20)
    assert locate_step(TIME_S, signal, 6) in (8, 9)
