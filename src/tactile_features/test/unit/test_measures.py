# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measures of synthetic windows whose truth is known, and the reasons when there are none."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import betainc
from trials import event, extract, make_block

from tactile_features import FeatureConfig
from tactile_features.errors import UndefinedFeatureError
from tactile_features.measures import (
    find_ripple,
    incomplete_beta,
    measure_press,
    measure_relaxation,
)
from tactile_ros.strain import StrainStatus

RATE_HZ = 60.0
TIME_S = np.arange(180) / RATE_HZ
CREEP_N = 8.0 + 4.7 * np.exp(-TIME_S / 3.8)


def noise(seed=0, size=180, sigma_n=0.004):
    return np.random.default_rng(seed).normal(0.0, sigma_n, size)


def dips(frequency_hz, depth_n=0.3, width=0.2):
    """A groove each period: the tension falls and recovers."""
    phase = np.mod(TIME_S * frequency_hz + 0.3, 1.0)
    return -depth_n * np.exp(-((phase - 0.5) ** 2) / (2 * (width / 2) ** 2))


@pytest.mark.parametrize('a', [0.5, 1.0, 3.5, 75.5, 356.0])
@pytest.mark.parametrize('b', [0.5, 1.5, 12.5])
def test_the_incomplete_beta_function_agrees_with_that_of_scipy(a, b):
    for x in (0.0, 1e-6, 0.3, 0.8, 0.98, 1.0):
        assert incomplete_beta(a, b, x) == pytest.approx(betainc(a, b, x), rel=1e-12, abs=1e-290)


@pytest.mark.parametrize('frequency_hz', [1.7, 2.5, 3.75, 5.0, 8.0, 12.0])
def test_the_frequency_of_a_ripple_lies_within_its_uncertainty(frequency_hz):
    ripple = find_ripple(TIME_S, CREEP_N + dips(frequency_hz) + noise())
    error_hz = ripple.frequency_hz - frequency_hz
    assert abs(error_hz) < 3 * ripple.standard_uncertainty_hz
    assert ripple.standard_uncertainty_hz < 0.004 * frequency_hz


def test_a_sine_is_a_ripple_of_one_harmonic():
    ripple = find_ripple(TIME_S, CREEP_N + 0.05 * np.sin(2 * np.pi * 3.3 * TIME_S) + noise())
    assert ripple.harmonics == 1
    assert ripple.frequency_hz == pytest.approx(3.3, abs=0.01)


def test_edges_between_samples_do_not_double_the_pitch():
    # 13.5 samples a period: the samples repeat after two periods only.
    frequency_hz = RATE_HZ / 13.5
    square = 0.3 * (np.mod(TIME_S * frequency_hz + 0.01, 1.0) < 0.3)
    ripple = find_ripple(TIME_S, CREEP_N + square + noise())
    assert ripple.frequency_hz == pytest.approx(frequency_hz, rel=0.005)


@pytest.mark.parametrize('seed', range(8))
def test_noise_drift_and_creep_have_no_ripple(seed):
    walk = np.cumsum(noise(seed))
    for tension_n in (noise(seed), walk, walk + noise(seed + 1), CREEP_N + noise(seed), CREEP_N):
        with pytest.raises(UndefinedFeatureError, match='no periodic grooves'):
            find_ripple(TIME_S, tension_n)


def test_a_fast_sensor_measures_the_same_ripple():
    time_s = np.arange(21_000) / 7000.0
    tension_n = np.sin(2 * np.pi * 5.0 * time_s) + noise(size=len(time_s))
    assert find_ripple(time_s, tension_n).frequency_hz == pytest.approx(5.0, rel=1e-3)


def pull(free_n_m=2000.0, rise_n_m=3000.0, *, speed_m_s=0.003, touch_s=1.0, end_s=1.3, seed=0):
    """Slack for 0.1 s, free, and from the touch on stiffer."""
    time_s = np.arange(round(end_s * RATE_HZ) + 1) / RATE_HZ
    pulled_s = np.clip(time_s, 0.1, end_s) - 0.1
    pressed_s = np.clip(time_s, touch_s, end_s) - touch_s
    tension_n = speed_m_s * (free_n_m * pulled_s + rise_n_m * pressed_s)
    return time_s, tension_n + noise(seed, len(time_s)), speed_m_s


def test_both_stiffnesses_lie_within_their_uncertainty_as_often_as_they_say():
    presses = [measure_press(*pull(seed=seed)) for seed in range(60)]
    for name, truth in (('free', 2000.0), ('contact', 3000.0)):
        values = [getattr(press, name) for press in presses]
        errors = np.array([(v.value - truth) / v.standard_uncertainty for v in values])
        assert np.abs(errors).max() < 4.0
        assert 0.55 < np.mean(np.abs(errors) < 1.0) < 0.95
        assert max(v.standard_uncertainty for v in values) < 0.05 * truth


@pytest.mark.parametrize('time_s', [0.8, 2.0, 3.8])
def test_the_time_of_a_relaxation_lies_within_its_uncertainty(time_s):
    errors = []
    for seed in range(20):
        tension_n = 8.0 + 4.7 * np.exp(-TIME_S / time_s) + noise(seed)
        value = measure_relaxation(TIME_S, tension_n)
        errors.append((value.value - time_s) / value.standard_uncertainty)
    assert np.max(np.abs(errors)) < 4.0
    assert 0.4 < np.std(errors) < 1.6


TWO_TIMES_N = 8 + 2 * np.exp(-TIME_S / 0.1) + 3 * np.exp(-TIME_S / 2)


@pytest.mark.parametrize(
    ('measure', 'samples', 'why'),
    [
        (measure_relaxation, (TIME_S, 10.0 + noise()), 'does not relax'),
        (measure_relaxation, (TIME_S, 10.0 - 0.5 * TIME_S + noise()), 'straight line'),
        (measure_relaxation, (TIME_S, TWO_TIMES_N + noise()), 'more than one'),
        *(
            (measure_relaxation, (TIME_S[:count], CREEP_N[:count]), f'{count} samples are too few')
            for count in (1, 2, 3)
        ),
        (find_ripple, (TIME_S[:20], CREEP_N[:20]), 'too few'),
        (measure_press, pull(rise_n_m=0.0), 'nothing was touched'),
        (measure_press, pull(touch_s=1.25, rise_n_m=3e4), 'pull more slowly or sample faster'),
    ],
)
def test_what_cannot_be_measured_says_why(measure, samples, why):
    with pytest.raises(UndefinedFeatureError, match=why):
        measure(*samples)


# -- through the extractor --------------------------------------------------------

PERIOD_NS = 16_666_667


def press_trial():
    """Blocks of a pull of 1.3 s and a hold of 4 s; events beside them."""
    _, pulled, speed_m_s = pull()
    held_s = np.arange(270) / RATE_HZ
    held = pulled[77] * (0.6 + 0.4 * np.exp(-held_s / 3.0)) + noise(1, 270)
    tension_n = np.concatenate([pulled[:78], held])
    events = [
        event(0.0, 'contact', pull_speed_m_s=speed_m_s),
        event(1.3, 'hold', pull_speed_m_s=speed_m_s),
        event(5.3, 'release'),
    ]
    return tension_n, events


def run(tension_n, events, config, cuts=()):
    edges = [0, *cuts, len(tension_n)]
    blocks = [make_block(tension_n[a:b], a, PERIOD_NS) for a, b in pairwise(edges)]
    (window,), _ = extract(config, *events, *blocks)
    return window


def test_a_hold_measures_the_pull_before_it_however_samples_are_grouped():
    tension_n, events = press_trial()
    window = run(tension_n, events, FeatureConfig())
    free, contact, relaxation = window.measures
    assert [(m.name, m.unit) for m in window.measures] == [
        ('free_stiffness', 'N/m'),
        ('contact_stiffness', 'N/m'),
        ('relaxation_time', 's'),
    ]
    assert free.value == pytest.approx(2000.0, rel=0.02)
    assert contact.value == pytest.approx(3000.0, rel=0.05)
    assert relaxation.value == pytest.approx(3.0, rel=0.02)
    assert run(tension_n, events, FeatureConfig(), cuts=(1, 2, 50, 77, 78, 79, 200)) == window
    assert run(tension_n, events, FeatureConfig(measures=False)).measures == ()


def test_without_its_pull_or_the_speed_of_it_a_hold_says_why():
    tension_n, events = press_trial()
    free, contact, relaxation = run(tension_n, events[1:], FeatureConfig()).measures
    assert free.reason == contact.reason == 'no pull into contact was seen'
    assert (contact.value, contact.standard_uncertainty, relaxation.reason) == (0.0, 0.0, '')
    unknown = dataclasses.replace(events[0], pull_speed_m_s=0.0)
    assert 'how fast the tendon' in (
        run(tension_n, [unknown, *events[1:]], FeatureConfig()).measures[0].reason
    )


@pytest.mark.parametrize(
    ('spans', 'why'),
    [
        ([(0, 20, 0), (21, 348, 0)], 'samples of the pull into contact are missing'),
        ([(0, 20, 0), (20, 21, StrainStatus.STUCK), (21, 348, 0)], 'contact are stuck'),
        ([(78, 348, 0)], 'the pull into contact has no samples'),
    ],
)
def test_a_pull_that_is_not_whole_measures_nothing(spans, why):
    tension_n, events = press_trial()
    blocks = [make_block(tension_n[a:b], a, PERIOD_NS, status=s) for a, b, s in spans]
    (window,), _ = extract(FeatureConfig(), *events, *blocks)
    assert why in window.measures[0].reason
    assert window.measures[2].reason == ''


def test_a_glide_measures_the_pitch_with_the_uncertainty_of_its_speed():
    tension_n = np.concatenate([np.full(36, 12.0), CREEP_N + dips(3.75) + noise(), CREEP_N])
    start = event(0.0, 'glide', glide_speed_m_s=0.015)
    events = [start, event(5.0, 'release')]
    exact = FeatureConfig(glide_speed_uncertainty=0.0)
    (pitch,) = run(tension_n, events, exact).measures
    assert (pitch.name, pitch.unit) == ('groove_pitch', 'm')
    assert pitch.value == pytest.approx(0.004, rel=0.005)
    (loose,) = run(tension_n, events, FeatureConfig(glide_speed_uncertainty=0.01)).measures
    assert loose.standard_uncertainty == pytest.approx(
        np.hypot(pitch.standard_uncertainty, 0.01 * pitch.value)
    )
    events[0] = dataclasses.replace(start, glide_speed_m_s=0.0)
    assert 'how fast the finger' in run(tension_n, events, exact).measures[0].reason
