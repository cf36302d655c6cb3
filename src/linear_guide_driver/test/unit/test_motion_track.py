# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import random

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from linear_guide_driver.grbl.guide_client import MotionTrack

START_NS = 1_700_000_000_000_000_000
GLIDE = (0.060, 0.125, 0.015)  # start and end [m] and speed [m/s] of a texture trial


def reports(start_m, target_m, speed_m_s, *, rate_hz=10.0, phase=0.3, ramp_s=0.0, pause=None):
    """Yield exact reports of a motion; ``pause`` is the start and the duration of a pause [s]."""
    length_m, sign = abs(target_m - start_m), 1 if target_m > start_m else -1
    for number in range(-3, round(6 * rate_hz)):
        t = (number + phase) / rate_hz
        moved_s = t
        if pause and t > pause[0]:
            moved_s = max(pause[0], t - pause[1])
        if 0.0 < moved_s < ramp_s:
            path_m = speed_m_s * moved_s**2 / (2 * ramp_s)
        else:
            path_m = speed_m_s * (moved_s - ramp_s / 2)
        yield START_NS + round(t * 1e9), start_m + sign * min(length_m, max(0.0, path_m))


def track_of(motion, samples):
    track = MotionTrack(*motion)
    for stamp_ns, position_m in samples:
        track.add(stamp_ns, position_m)
    return track


@pytest.mark.parametrize('motion', [GLIDE, (0.125, 0.060, 0.015), (0.0, 0.0049, 0.010)])
@pytest.mark.parametrize('rate_hz', [10.0, 60.0])
def test_an_exact_motion_is_known_exactly(motion, rate_hz):
    track = track_of(motion, reports(*motion, rate_hz=rate_hz))
    assert abs(track.start_ns - START_NS) < 1000
    duration_ns = abs(motion[1] - motion[0]) / motion[2] * 1e9
    assert abs(track.end_ns - START_NS - duration_ns) < 1000
    summary = track.summarise()
    assert summary.mean_speed_m_s == pytest.approx(motion[2])
    assert summary.lag_s < 1e-6


def test_the_start_is_known_after_two_reports_in_motion():
    track = MotionTrack(*GLIDE)
    known = []
    for stamp_ns, position_m in reports(*GLIDE):
        track.add(stamp_ns, position_m)
        track.add(stamp_ns, position_m)  # a repeated report is ignored
        known.append((stamp_ns - START_NS, track.start_ns is not None))
    assert min(at_ns for at_ns, is_known in known if is_known) == 130_000_000
    assert track_of(GLIDE, []).start_ns is None
    assert track_of(GLIDE, []).end_ns is None


@settings(max_examples=30)
@given(
    delays=st.lists(st.floats(0.0, 0.02), min_size=63, max_size=63),
    phase=st.floats(0.0, 0.99),
    ramp_s=st.floats(0.001, 0.05),
)
def test_a_start_is_late_by_a_delay_and_half_a_ramp_at_most(delays, phase, ramp_s):
    exact = reports(*GLIDE, phase=phase, ramp_s=ramp_s)
    late = [(s + round(d * 1e9), p) for (s, p), d in zip(exact, delays, strict=True)]
    start_ns = track_of(GLIDE, late).start_ns
    assert -1000 <= start_ns - START_NS <= (0.02 + ramp_s / 2) * 1e9 + 1000


@settings(max_examples=30)
@given(pause_s=st.floats(0.04, 1.0), at_s=st.floats(0.5, 3.5), seed=st.integers(0, 1000))
def test_a_pause_is_seen_through_the_delays_of_the_reports(pause_s, at_s, seed):
    chance = random.Random(seed)
    samples = [
        (stamp_ns + round(chance.uniform(0, 0.005) * 1e9), position_m)
        for stamp_ns, position_m in reports(*GLIDE, pause=(at_s, pause_s))
    ]
    assert track_of(GLIDE, samples).summarise().lag_s == pytest.approx(pause_s, abs=0.006)


def test_one_late_report_is_no_pause():
    samples = list(reports(*GLIDE))
    samples[20] = (samples[20][0] + 80_000_000, samples[20][1])
    assert track_of(GLIDE, samples).summarise().lag_s < 1e-6


def test_a_slow_guide_falls_behind():
    slow = reports(GLIDE[0], GLIDE[1], 0.0147)
    summary = track_of(GLIDE, slow).summarise()
    assert summary.mean_speed_m_s == pytest.approx(0.0147)
    assert 0.06 < summary.lag_s < 0.09


def test_too_few_reports_say_nothing():
    assert track_of(GLIDE, list(reports(*GLIDE, rate_hz=0.6))[:5]).summarise() is None
    assert not MotionTrack(0.06, 0.0601, 0.04).is_motion
    stuck = [(START_NS, position_m) for _, position_m in reports(*GLIDE)]
    assert track_of(GLIDE, stuck).summarise() is None
