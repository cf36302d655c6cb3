# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A surface slid over at several speeds: what of it the features keep, and what they refuse."""

import numpy as np
import pytest

from tactile_features import (
    compute_spatial,
    FeatureConfig,
    FeatureError,
    features_from_trials,
    Outcome,
    SpatialWindow,
    TrialEvent,
    TrialFeatureExtractor,
)
from tactile_ros.strain import StrainBlock

RATE_HZ = 62.5
PERIOD_NS = 16_000_000
WINDOW = SpatialWindow(0.048, 0.001)
NAMES = WINDOW.names()
SPECTRUM = np.array(['spectrum' in name for name in NAMES])


def grating(at_m):
    """A groove every 6 mm and its octave, 0.3 N and 0.1 N."""
    return 0.3 * np.sin(2 * np.pi * at_m / 0.006) + 0.1 * np.cos(4 * np.pi * at_m / 0.006)


def bump(at_m):
    """One lopsided ridge, 3 mm wide, 0.4 N."""
    x = (at_m - 0.024) / 0.003
    return 0.4 * np.exp(-(x**2)) * (1.0 + 0.5 * np.tanh(x))


def slide(surface, speed_m_s, from_m=0.0, window=WINDOW):
    """The features of a stretch of a surface; the sensor follows it at once."""
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
    # Quantiles of a few grooves depend a little on where the ends of the window cut them.
    np.testing.assert_allclose(there, here, atol=0.12)


@pytest.mark.parametrize('shift_m', [-0.004, 0.002, 0.004])
def test_a_ridge_counts_the_same_wherever_in_the_window_it_is(shift_m):
    there, here = slide(bump, 0.01, from_m=shift_m), slide(bump, 0.01)
    np.testing.assert_allclose(there[~SPECTRUM], here[~SPECTRUM], atol=0.05)


def test_a_sine_gives_its_amplitude_at_its_spatial_frequency():
    values = slide(lambda at_m: 7.0 + 0.25 * np.sin(2 * np.pi * at_m / 0.006), 0.01)
    component = NAMES.index('tension__spatial_spectrum__per_m_166.667')
    assert values[component] == pytest.approx(0.25, rel=1e-3)
    assert abs(values[SPECTRUM][[0, 1, 2, 3, 12, 20]]).max() < 1e-3


def test_a_step_gives_its_height_as_the_largest_change():
    values = slide(lambda at_m: 0.4 * (at_m > 0.024), 0.005)
    change = [NAMES.index(f'tension__spatial_change__mm_8__q_{q}') for q in ('0.000', '1.000')]
    np.testing.assert_allclose(values[change], [0.0, 0.4], atol=1e-3)


def test_an_offset_changes_nothing():
    count = WINDOW.sample_count(0.01, RATE_HZ)
    tension = grating(np.arange(count) * 0.01 / RATE_HZ)
    tension = np.round(tension * 2**20) / 2**20  # so that adding the offset is exact
    a, b = (compute_spatial(tension + offset, 0.01, RATE_HZ, WINDOW) for offset in (0.0, 1e6))
    np.testing.assert_allclose(a, b, atol=1e-14)
    assert not compute_spatial(np.full(count, 5.0), 0.01, RATE_HZ, WINDOW).any()


def test_a_batch_gives_the_bits_of_single_windows():
    count = WINDOW.sample_count(0.013, RATE_HZ)
    tension = np.random.default_rng(0).normal(5.0, 1.0, (2, 3, count))
    batch = compute_spatial(tension, 0.013, RATE_HZ, WINDOW)
    single = [[compute_spatial(row, 0.013, RATE_HZ, WINDOW) for row in rows] for rows in tension]
    assert batch.tobytes() == np.array(single).tobytes()
    assert batch.shape == (2, 3, len(NAMES))


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
    with pytest.raises(FeatureError, match='trial 1: it has 400 samples, and its window 601'):
        over_distance(x, [0.01, 0.005, 0.01])
    with pytest.raises(FeatureError, match='shape'):
        over_distance(x, [0.01])
    with pytest.raises(FeatureError, match='needs the sliding speed'):
        over_distance(x, None)


@pytest.mark.parametrize(
    ('speed_m_s', 'message'),
    [
        (0.0, 'not stated'),
        (-0.01, 'not stated'),
        (float('nan'), 'not stated'),
        (float('inf'), 'not stated'),
        (0.0626, 'glide slower'),
        (1e-300, 'glide faster'),
    ],
)
def test_a_speed_that_does_not_fit_is_refused(speed_m_s, message):
    with pytest.raises(FeatureError, match=message):
        WINDOW.sample_count(speed_m_s, RATE_HZ)
    assert WINDOW.sample_count(0.0625, RATE_HZ) == 49  # a sample each finest scale


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
    with pytest.raises(FeatureError, match='has 301 samples'):
        compute_spatial(tension[1:], 0.01, RATE_HZ, WINDOW)


# In the stream: a glide from 1 s on at 62.5 Hz, 9 mm left out, then 45 mm.
CONFIG = FeatureConfig(rate_hz=RATE_HZ, texture_features='texture_spatial')
STRETCH = SpatialWindow(CONFIG.spatial_length_m, CONFIG.spatial_finest_m)
TENSION_N = np.random.default_rng(1).normal(5.0, 1.0, 1200)


def event(stamp_ns, phase, speed_m_s):
    return TrialEvent(
        stamp_ns, 't', 's', 'texture', 'flexion', 'R1', phase, glide_speed_m_s=speed_m_s
    )


def run(speed_m_s, end_ns):
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_event(event(1_000_000_000, 'glide', speed_m_s))
    windows = extractor.add_event(event(end_ns, 'release', speed_m_s))
    windows += extractor.add_block(StrainBlock(0, 0, PERIOD_NS, TENSION_N))
    (window,) = windows
    return window


def ends(speed_m_s):
    """First sample of the window and the one beyond, by hand, and the earliest end [ns]."""
    first = int(np.ceil(round(1e9 + 0.009 / speed_m_s * 1e9) / PERIOD_NS))
    count = int(np.ceil(round(0.045 / speed_m_s * RATE_HZ, 6))) + 1
    return first, first + count, (first + count - 1) * PERIOD_NS + 100_000_000


@pytest.mark.parametrize('speed_m_s', [0.005, 0.015, 0.03])
def test_a_glide_gives_one_window_of_its_own_duration(speed_m_s):
    first, end, end_ns = ends(speed_m_s)
    window = run(speed_m_s, end_ns)
    assert (window.outcome, window.reason) == (Outcome.OK, '')
    assert (window.first_sequence, window.sample_count) == (first, end - first)
    assert (window.feature_set, window.feature_set_version) == ('texture_spatial', 1)
    assert window.speed_m_s == speed_m_s
    want = compute_spatial(TENSION_N[first:end], speed_m_s, RATE_HZ, STRETCH)
    assert window.values.tobytes() == want.tobytes()


def test_one_sample_short_is_too_short():
    _, _, end_ns = ends(0.015)
    assert run(0.015, end_ns).outcome == Outcome.OK
    window = run(0.015, end_ns - 1)
    assert window.outcome == Outcome.TOO_SHORT
    assert '188 of 189 samples' in window.reason


def test_a_slow_glide_needs_more_time_and_is_told_so():
    window = run(0.005, ends(0.015)[2])
    assert window.outcome == Outcome.TOO_SHORT
    assert 'the window needs 8.8' in window.reason


@pytest.mark.parametrize('speed_m_s', [0.0, float('nan'), 0.04])
def test_without_a_fitting_speed_there_are_no_features_but_a_reason(speed_m_s):
    window = run(speed_m_s, 8_000_000_000)
    assert window.outcome == Outcome.UNDEFINED
    assert 'glide' in window.reason
    assert (len(window.values), window.speed_m_s) == (0, 0.0)
