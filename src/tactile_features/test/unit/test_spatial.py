# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Features over distance: equal at several speeds, and refused for unsuitable windows."""

import dataclasses

import numpy as np
import pytest
from trials import event, extract, make_block

from tactile_features import (
    compute_spatial,
    FeatureConfig,
    FeatureError,
    features_from_trials,
    SpatialWindow,
    WindowOutcome,
)

RATE_HZ = 62.5
PERIOD_NS = 16_000_000
WINDOW = SpatialWindow(0.048, 0.001)
SPECTRUM = np.array(['spectrum' in name for name in WINDOW.names()])


def grating(at_m):
    """Return the tension on grooves with a period of 6 mm: 0.3 N, and 0.1 N at half the period."""
    return 0.3 * np.sin(2 * np.pi * at_m / 0.006) + 0.1 * np.cos(4 * np.pi * at_m / 0.006)


def bump(at_m):
    """Return the tension on a single asymmetric ridge, about 3 mm wide and 0.4 N high."""
    x = (at_m - 0.024) / 0.003
    return 0.4 * np.exp(-(x**2)) * (1.0 + 0.5 * np.tanh(x))


def slide(surface, speed_m_s, from_m=0.0, window=WINDOW):
    """Return the features of a surface from ``from_m`` on, as sensed without noise."""
    count = window.sample_count(speed_m_s, RATE_HZ)
    at_m = from_m + speed_m_s / RATE_HZ * np.arange(count)
    at_m -= (at_m[-1] - from_m - window.length_m) / 2
    return compute_spatial(surface(at_m), speed_m_s, RATE_HZ, window)


@pytest.mark.parametrize(('surface', 'tolerance_n'), [(grating, 0.03), (bump, 1e-3)])
@pytest.mark.parametrize('speed_m_s', [0.005, 0.010, 0.0137, 0.030])
def test_one_surface_gives_the_same_features_at_any_speed(surface, tolerance_n, speed_m_s):
    np.testing.assert_allclose(slide(surface, speed_m_s), slide(surface, 0.02), atol=tolerance_n)


@pytest.mark.parametrize('shift_m', [0.0004, 0.0021, 0.0057, 0.02])
def test_a_periodic_surface_does_not_tell_where_it_was_touched(shift_m):
    there, here = slide(grating, 0.01, from_m=shift_m), slide(grating, 0.01)
    np.testing.assert_allclose(there[SPECTRUM], here[SPECTRUM], atol=1e-3)
    # There are few grooves, so the quantiles depend a little on where the window begins and ends.
    np.testing.assert_allclose(there, here, atol=0.12)


@pytest.mark.parametrize('shift_m', [-0.004, 0.002, 0.004])
def test_a_ridge_counts_the_same_wherever_in_the_window_it_is(shift_m):
    there, here = slide(bump, 0.01, from_m=shift_m), slide(bump, 0.01)
    np.testing.assert_allclose(there[~SPECTRUM], here[~SPECTRUM], atol=0.05)


def test_a_constant_has_no_features_but_zeros():
    count = WINDOW.sample_count(0.01, RATE_HZ)
    assert not compute_spatial(np.full(count, 5.0), 0.01, RATE_HZ, WINDOW).any()


def over_distance(x, speeds_m_s):
    config = FeatureConfig(
        texture_features='texture_spatial',
        spatial_length_m=WINDOW.length_m,
        spatial_finest_m=WINDOW.finest_m,
    )
    return features_from_trials('texture', x, RATE_HZ, config=config, speeds_m_s=speeds_m_s)


def test_ready_cut_glides_give_their_middle_each_at_its_own_speed():
    x = np.random.default_rng(0).normal(5.0, 1.0, (3, 400))
    speeds = [0.01, 0.02, 0.0080]
    values, _ = over_distance(x, speeds)
    for row, speed, got in zip(x, speeds, values, strict=True):
        count = WINDOW.sample_count(speed, RATE_HZ)
        first = (400 - count) // 2
        want = compute_spatial(row[first : first + count], speed, RATE_HZ, WINDOW)
        assert got.tobytes() == want.tobytes()
    with pytest.raises(FeatureError, match=r'trial 1: .*400 .*601'):
        over_distance(x, [0.01, 0.005, 0.01])
    with pytest.raises(FeatureError, match='shape'):
        over_distance(x, [0.01])
    with pytest.raises(FeatureError, match='speed'):
        over_distance(x, None)


@pytest.mark.parametrize(
    ('speed_m_s', 'message'),
    [
        (0.0, 'speed'),
        (-0.01, 'speed'),
        (float('nan'), 'speed'),
        (float('inf'), 'speed'),
        (0.0626, 'glide slower'),
        (1e-300, 'glide faster'),
    ],
)
def test_a_speed_that_does_not_fit_is_refused(speed_m_s, message):
    with pytest.raises(FeatureError, match=message):
        WINDOW.sample_count(speed_m_s, RATE_HZ)
    assert WINDOW.sample_count(0.0625, RATE_HZ) == 49  # one sample per finest scale


@pytest.mark.parametrize(('length_m', 'finest_m'), [(0.01, 0.004), (0.01, 0.0), (np.inf, 0.001)])
def test_a_window_too_short_for_its_finest_scale_is_refused(length_m, finest_m):
    with pytest.raises(FeatureError, match='finest scale'):
        SpatialWindow(length_m, finest_m)


@pytest.mark.parametrize('bad', [np.nan, np.inf, 1e308])
def test_what_is_no_number_is_refused(bad):
    tension = np.zeros(WINDOW.sample_count(0.01, RATE_HZ))
    tension[0], tension[5:] = bad, -bad
    with pytest.raises(FeatureError):
        compute_spatial(tension, 0.01, RATE_HZ, WINDOW)
    with pytest.raises(FeatureError, match='301'):
        compute_spatial(tension[1:], 0.01, RATE_HZ, WINDOW)


# A glide in a stream of samples at 62.5 Hz begins at 1 s. By default, its first 9 mm are left out,
# and the window has 45 mm.
CONFIG = FeatureConfig(rate_hz=RATE_HZ, texture_features='texture_spatial')
STRETCH = SpatialWindow(CONFIG.spatial_length_m, CONFIG.spatial_finest_m)
TENSION_N = np.random.default_rng(1).normal(5.0, 1.0, 1200)


def run(speed_m_s, end_ns):
    begin = event(1.0, 'glide', glide_speed_m_s=speed_m_s)
    end = dataclasses.replace(begin, phase='release', stamp_ns=end_ns)
    (window,) = extract(CONFIG, begin, end, make_block(TENSION_N, 0, PERIOD_NS))
    return window


EARLIEST_END_NS = 288 * PERIOD_NS + 100_000_000
"""Earliest end of a glide at 15 mm/s that has a window [ns]; the window is samples 100 to 288."""


def test_a_glide_gives_one_window_of_its_own_duration():
    window = run(0.015, EARLIEST_END_NS)
    assert (window.outcome, window.reason, window.speed_m_s) == (WindowOutcome.OK, '', 0.015)
    assert (window.first_sequence, window.sample_count) == (100, 189)
    want = compute_spatial(TENSION_N[100:289], 0.015, RATE_HZ, STRETCH)
    assert window.values.tobytes() == want.tobytes()


@pytest.mark.parametrize(
    ('speed_m_s', 'end_ns', 'outcome', 'reason'),
    [
        (0.015, EARLIEST_END_NS - 1, WindowOutcome.TOO_SHORT, '188 of 189 samples'),
        (0.005, EARLIEST_END_NS, WindowOutcome.TOO_SHORT, '8.8'),
        (0.0, 8_000_000_000, WindowOutcome.UNDEFINED, 'glide'),
        (float('nan'), 8_000_000_000, WindowOutcome.UNDEFINED, 'glide'),
        (0.04, 8_000_000_000, WindowOutcome.UNDEFINED, 'glide'),
    ],
)
def test_a_glide_without_a_whole_window_says_why(speed_m_s, end_ns, outcome, reason):
    window = run(speed_m_s, end_ns)
    assert (window.outcome, len(window.values)) == (outcome, 0)
    assert reason in window.reason
    assert window.speed_m_s == (speed_m_s if outcome == WindowOutcome.TOO_SHORT else 0.0)
