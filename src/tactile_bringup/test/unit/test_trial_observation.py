# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import math
import re

import numpy as np
import pytest

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.grbl.guide_client import MotionSummary
from tactile_bringup.nodes.trial_devices import REPORT_S
from tactile_bringup.trial_observation import find_glide_fault, GuideRest, TendonContact
from tactile_bringup.trial_protocols import TrialConfig
from tactile_features.config import FeatureConfig

CONFIG = TrialConfig()
S = 1_000_000_000


def contact(*states):
    watched = TendonContact()
    watched.begin(0.0049, CONFIG.displacement_tolerance_m)
    for stamp_ns, displacement_m, velocity_m_s in states:
        watched.take(stamp_ns, displacement_m, velocity_m_s)
    return watched


PULL = (1, 0.001, 0.01), (2, 0.0046, 0.01)


def test_a_contact_begins_with_the_first_state_at_rest():
    watched = contact(*PULL, (3, 0.0048, 0.0002), (4, 0.0049, 0.0))
    assert watched.rest_ns == 3
    assert watched.error_m == pytest.approx(0.0001)
    assert watched.find_loss() is None
    assert contact(*PULL).rest_ns is None


@pytest.mark.parametrize('speed_m_s', [0.0001, 0.0004, 0.0005, 0.001, 0.1])
def test_a_tendon_that_still_moves_is_not_at_rest(speed_m_s):
    watched, end_s = contact(), 0.0049 / speed_m_s
    for poll in range(round((end_s + 0.5) * 60)):
        displacement_m = min(0.0049, speed_m_s * poll / 60)
        velocity_m_s = speed_m_s if displacement_m < 0.0049 else 0.0
        watched.take(poll * S // 60, displacement_m, velocity_m_s)
    assert watched.rest_ns is not None
    assert 0.0 <= watched.rest_ns / S - end_s <= 1.01 / 60


@pytest.mark.parametrize('poll_rate_hz', [5, 25, 60])
@pytest.mark.parametrize('radius_m', [0.001, 0.01, 0.1])
@pytest.mark.parametrize('speed_m_s', [0.0001, 0.0005, 0.001, 0.01])
def test_the_rest_is_right_with_the_resolution_of_the_servo(speed_m_s, radius_m, poll_rate_hz):
    """Reported speeds have steps of 0.229 rpm and errors of up to one step.

    Reported positions are rounded to counts of the servo.
    """
    random = np.random.default_rng(0)
    unit_m_s = registers.velocity_to_m_s(1, radius_m)
    units = registers.m_s_to_velocity(speed_m_s, radius_m)
    goal = registers.m_to_counts(0.0049, radius_m)
    end_s = registers.counts_to_m(goal, radius_m) / (units * unit_m_s)
    tolerance_m = max(CONFIG.displacement_tolerance_m, 2 * registers.counts_to_m(1, radius_m))
    watched = TendonContact()
    watched.begin(0.0049, tolerance_m)
    seen_s = math.inf
    for poll in range(round((end_s + 2.0) * poll_rate_hz)):
        time_s = poll / poll_rate_hz
        count = min(goal, int(goal * time_s / end_s))
        is_at_goal = time_s >= end_s
        jitter = int(random.integers(0, 2)) if is_at_goal else 0
        velocity = 0 if is_at_goal else units + int(random.integers(-1, 2))
        watched.take(
            round(time_s * S), registers.counts_to_m(count - jitter, radius_m), velocity * unit_m_s
        )
        if watched.rest_ns is not None:
            seen_s = min(seen_s, time_s)
    assert watched.rest_ns is not None
    assert seen_s <= end_s + REPORT_S or poll_rate_hz < 25
    one_count_s = 1 / (goal / end_s)
    assert watched.rest_ns / S >= end_s - one_count_s - 1e-6
    assert watched.rest_ns / S <= end_s + 5 / poll_rate_hz + 1e-6
    assert watched.find_loss() is None


def test_a_slow_pull_that_leaves_the_tolerance_begins_anew():
    there = [(poll * S // 60, 0.0048, 0.0) for poll in range(6)]
    watched = contact(*there, (S // 10, 0.0043, 0.0), (S // 2, 0.0048, 0.0))
    assert watched.rest_ns is None
    watched.take(S, 0.0048, 0.0)
    assert watched.rest_ns == S // 2


def test_a_tendon_that_leaves_its_displacement_is_told_with_the_numbers():
    watched = contact(*PULL, (3, 0.0049, 0.0), (4, 0.0043, -0.01))
    assert re.search('0.0043 m .*0.0049 m', watched.find_loss().reason)
    watched.end()
    watched.take(5, 0.0, 0.0)
    assert (watched.find_loss(), watched.error_m) == (None, 0.0)


@pytest.mark.parametrize('back_s', [0.3, 0.99, 1.01, 3600.0])
def test_a_loss_is_told_after_the_clock_was_set_back(back_s):
    watched = contact(*PULL, (10**13, 0.0049, 0.0), (10**13 - round(back_s * S), 0.0043, -0.01))
    assert re.search('0.0043 m .*0.0049 m', watched.find_loss().reason)


@pytest.mark.parametrize(('back_s', 'is_step'), [(0.99, False), (1.01, True), (3600.0, True)])
def test_a_clock_that_is_set_back_ends_the_trial(back_s, is_step):
    watched = contact(*PULL, (10**13, 0.0049, 0.0))
    for poll in range(3):
        watched.take(10**13 - round(back_s * S) + poll, 0.0049, 0.0)
    assert watched.error_m == 0.0
    assert (f'{back_s:.2f} s' in str(watched.find_loss())) == is_step
    assert (watched.find_loss() is None) != is_step
    watched.begin(0.0049, CONFIG.displacement_tolerance_m)
    watched.take(0, 0.0, 0.0)
    assert watched.find_loss() is None


@pytest.mark.parametrize(
    ('summary', 'named'),
    [
        (MotionSummary(0.01501, 0.005), ''),
        (MotionSummary(0.0152, 0.0), '0.01520 m/s'),
        (MotionSummary(0.0148, 0.04), '0.01480 m/s'),
        (MotionSummary(0.0149, 0.04), '0.040 s'),
        (None, 'positions'),
    ],
)
def test_a_glide_is_judged_by_speed_and_lag(summary, named):
    fault = find_glide_fault(summary, 0.015, CONFIG)
    assert (named in str(fault)) if named else fault is None


def test_the_tolerances_are_those_that_move_a_spectral_line_by_a_bin():
    features = FeatureConfig()
    bin_hz = features.rate_hz / features.texture_samples
    highest_hz = features.rate_hz / 2
    assert CONFIG.speed_tolerance == pytest.approx(bin_hz / highest_hz, rel=0.02)
    assert CONFIG.lag_tolerance_s == pytest.approx(1 / highest_hz, rel=0.02)


def test_a_guide_that_moves_while_it_should_rest_is_seen_and_late_reports_are_not():
    rest = GuideRest()
    rest.take(0, 0.01, 0.0)
    assert rest.find_motion() is None
    rest.begin(0.06)
    for position_m in (0.055, 0.0599, 0.0601):  # late states, then at rest
        rest.take(0, position_m, 0.04)
        assert rest.find_motion() is None
    rest.take(0, 0.0605, 0.0)
    rest.take(0, 0.06, 0.0)
    assert re.search('0.0600 m .*0.0605 m', str(rest.find_motion()))
    rest.end()
    assert rest.find_motion() is None
