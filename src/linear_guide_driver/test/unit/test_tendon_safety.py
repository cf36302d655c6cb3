# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest
from samples import feed

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.errors import MotionRefusedError
from linear_guide_driver.safety import (
    Ending,
    Order,
    Pull,
    State,
    TendonSafety,
    TopicWatchdog,
    Zero,
)
from linear_guide_driver.stop_latch import StopLatch

MS = 1_000_000
CONFIG = TendonActuatorConfig(guard_timeout_s=0.25, slack_after_s=2.0)
TAUT_M = 0.005


def sense(safety, tension_n, displacement_m=TAUT_M, now_ns=0):
    """Add a sample and return the order that follows."""
    feed(safety, [tension_n], now_ns)
    return safety.decide(displacement_m, now_ns)


def make_unconfirmed(watchdogs=(), **changes):
    safety = TendonSafety(dataclasses.replace(CONFIG, **changes), watchdogs)
    safety.set_zero(Zero.UNCONFIRMED)
    return safety


def make(watchdogs=(), **changes):
    """Return a `TendonSafety` with a confirmed zero. The sensor reads a slack tendon."""
    safety = make_unconfirmed(watchdogs, **changes)
    sense(safety, 0.0, 0.0)
    return safety


@pytest.fixture
def safety():
    return make()


def hold_taut(safety, contact='flexion', now_ns=0, tension_n=1.0):
    """Pull the tendon to ``TAUT_M``."""
    safety.admit(Pull(TAUT_M, contact), 0.0, now_ns)
    safety.finish()
    assert sense(safety, tension_n, TAUT_M, now_ns) is Order.FOLLOW


# -- the limit ----------------------------------------------------------------------------------


def test_the_contact_chooses_the_limit(safety):
    hold_taut(safety, 'flexion')
    assert sense(safety, 14.9) is Order.FOLLOW
    feed(safety, [2.0], 0)
    safety.admit(Pull(0.006, 'abduction'), TAUT_M, 0)
    assert feed(safety, [3.1], 0)
    assert safety.decide(TAUT_M, 0) is Order.RELEASE
    assert safety.ending is Ending.OVER_LIMIT
    assert '3.10 N, is above the limit, 3.0 N' in safety.reason


@pytest.mark.parametrize('command', ['stop', 'lose', 'silence', 'partial'])
def test_above_the_limit_nothing_turns_slackening_into_holding(safety, command):
    hold_taut(safety)
    assert sense(safety, 20.0) is Order.RELEASE
    now_ns = 100 * MS
    feed(safety, [20.0], now_ns)
    if command == 'stop':
        safety.hold(0)
    elif command == 'lose':
        safety.lose('The servo is silent.', now_ns)
    elif command == 'partial':
        safety.admit(Pull(0.004), TAUT_M, now_ns)
    else:
        now_ns = 1000 * MS
    assert safety.decide(0.004, now_ns) is Order.RELEASE
    safety.finish()
    assert safety.decide(0.004, now_ns) is Order.RELEASE


def test_slackening_ends_at_slack_and_a_stop_below_the_limit_holds(safety):
    hold_taut(safety)
    assert sense(safety, 20.0) is Order.RELEASE
    assert sense(safety, 5.0, 0.003) is Order.RELEASE
    safety.hold(0)
    assert safety.decide(0.003, 0) is Order.HOLD
    safety.release('The tendon was released.')
    assert safety.decide(0.00051, 0) is Order.RELEASE
    assert safety.decide(0.0005, 0) is Order.FOLLOW
    assert safety.state is State.FREE


def test_the_limit_is_the_strictest_before_the_first_pull(safety):
    assert sense(safety, 3.1) is Order.RELEASE


def test_saturation_and_either_sign_count_as_above_the_limit(safety):
    hold_taut(safety)
    for samples, is_saturated in (([0.1], True), ([0.1, 15.1, 0.1], False), ([-15.1, 0.1], False)):
        assert feed(safety, samples, 0, is_saturated=is_saturated)
        feed(safety, [0.1], 0)


@pytest.mark.parametrize(
    ('contact', 'tension_n', 'pull', 'limit_n'),
    [
        ('abduction', 1.0, Pull(0.001, 'flexion'), 3.0),
        ('abduction', 1.0, Pull(0.0, '', stop_tension_n=99.0), 3.0),
        ('flexion', 10.0, Pull(0.0, 'abduction'), 15.0),
    ],
)
def test_slackening_never_raises_the_limit(safety, contact, tension_n, pull, limit_n):
    hold_taut(safety, contact, tension_n=tension_n)
    safety.admit(pull, TAUT_M, 0)
    assert safety.limit_n == limit_n
    assert safety.decide(TAUT_M, 0) is Order.FOLLOW


@pytest.mark.parametrize(
    ('pull', 'text'),
    [
        (Pull(0.006, 'sideways'), 'flexion, abduction'),
        (Pull(0.006, 'abduction', stop_tension_n=3.5), 'abduction.* 3.0 N'),
        (Pull(0.006, stop_tension_n=-1.0), ' N '),
        (Pull(0.006, stop_tension_n=float('nan')), ' N '),
        (Pull(0.006, stop_tension_n=15.1), 'flexion.* 15.0 N'),
        (Pull(0.006, 'abduction'), 'slacken'),
    ],
)
def test_a_refused_pull_changes_nothing(safety, pull, text):
    hold_taut(safety, 'abduction')
    feed(safety, [4.0], 0)
    with pytest.raises(MotionRefusedError, match=text):
        safety.admit(pull, TAUT_M, 0)
    assert safety.limit_n == 3.0
    assert safety.decide(TAUT_M, 0) is Order.RELEASE


# -- what is needed -----------------------------------------------------------------------------


def test_samples_are_needed_while_taut_and_silence_ends_in_slack(safety):
    assert safety.decide(0.0, 60_000 * MS) is Order.FOLLOW  # slack: needs no other nodes
    assert safety.alarm is None
    hold_taut(safety)
    assert safety.decide(TAUT_M, 250 * MS) is Order.FOLLOW
    assert safety.decide(TAUT_M, 251 * MS) is Order.HOLD
    assert 'sample' in safety.reason
    feed(safety, [1.0], 300 * MS)  # too late: only a new command ends the loss
    assert safety.decide(TAUT_M, 2250 * MS) is Order.HOLD
    assert safety.decide(TAUT_M, 2251 * MS) is Order.RELEASE


def test_a_cancelled_goal_does_not_end_slackening_while_the_sensor_is_lost(safety):
    hold_taut(safety)
    safety.decide(TAUT_M, 251 * MS)
    assert safety.decide(TAUT_M, 2251 * MS) is Order.RELEASE
    safety.hold(2252 * MS)
    assert safety.decide(TAUT_M, 2252 * MS) is Order.RELEASE


def test_late_samples_are_silence_but_guard_the_limit(safety):
    hold_taut(safety)
    feed(safety, [1.0], 100 * MS, age_ns=200 * MS)
    assert safety.decide(TAUT_M, 150 * MS) is Order.FOLLOW
    assert safety.decide(TAUT_M, 151 * MS) is Order.HOLD
    assert '0.20 s' in safety.reason
    with pytest.raises(MotionRefusedError, match=r'0\.20 s'):
        safety.admit(Pull(0.006), TAUT_M, 151 * MS)
    assert safety.tension.live_n(151 * MS) is None
    assert feed(safety, [20.0], 200 * MS, age_ns=900 * MS)
    assert safety.decide(TAUT_M, 200 * MS) is Order.RELEASE
    assert '20.00 N' in safety.reason


def test_the_first_loss_is_told_and_no_later_one_postpones_the_release(safety):
    hold_taut(safety)
    for reason, now_ms in (('The servo is silent.', 0), ('The line is lost.', 1900)):
        safety.lose(reason, now_ms * MS)
        safety.hold(now_ms * MS)
        assert safety.reason.startswith('The servo is silent.')
    assert sense(safety, 1.0, TAUT_M, 2000 * MS) is Order.RELEASE
    assert safety.reason.startswith('The servo is silent.')


def test_slackening_that_was_stopped_needs_samples_as_any_taut_tendon_does(safety):
    hold_taut(safety)
    safety.admit(Pull(0.0), TAUT_M, 0)
    assert safety.decide(TAUT_M, 1000 * MS) is Order.FOLLOW
    safety.hold(0)
    assert safety.decide(TAUT_M, 1001 * MS) is Order.HOLD  # the pull has not been finished yet
    assert 'sample' in safety.reason
    assert safety.decide(TAUT_M, 3001 * MS) is Order.RELEASE


def test_a_fresh_pull_within_the_holding_time_keeps_the_tendon(safety):
    hold_taut(safety)
    assert safety.decide(TAUT_M, 300 * MS) is Order.HOLD
    feed(safety, [1.0], 400 * MS)
    safety.admit(Pull(0.006), TAUT_M, 400 * MS)
    safety.finish()
    for now_ms in range(500, 5000, 100):
        assert sense(safety, 1.0, TAUT_M, now_ms * MS) is Order.FOLLOW


def test_unguarded_pulls_need_no_samples_unless_they_ask_for_a_tension():
    safety = make(unguarded=True)
    safety.admit(Pull(TAUT_M), 0.0, 1000 * MS)
    assert safety.decide(0.001, 10_000 * MS) is Order.FOLLOW
    with pytest.raises(MotionRefusedError, match='sensor'):
        safety.admit(Pull(TAUT_M, stop_tension_n=5.0), 0.0, 10_000 * MS)
    feed(safety, [0.1], 10_000 * MS)
    safety.admit(Pull(TAUT_M, stop_tension_n=5.0), 0.0, 10_000 * MS)
    assert safety.decide(0.001, 10_251 * MS) is Order.HOLD
    assert safety.ending is Ending.LOST


def test_a_lost_topic_holds_then_slackens_and_slackening_is_always_admitted():
    peer = TopicWatchdog('trial_runner/heartbeat', 0.2)
    safety = make([peer])
    with pytest.raises(MotionRefusedError, match='trial_runner/heartbeat'):
        safety.admit(Pull(TAUT_M), 0.0, 0)
    peer.beat(0)
    hold_taut(safety)
    for now_ms in (100, 200):
        assert sense(safety, 1.0, TAUT_M, now_ms * MS) is Order.FOLLOW
    assert sense(safety, 1.0, TAUT_M, 300 * MS) is Order.HOLD
    with pytest.raises(MotionRefusedError, match=r'heartbeat for 0\.2 s'):
        safety.admit(Pull(0.006), TAUT_M, 300 * MS)
    safety.admit(Pull(0.0), TAUT_M, 300 * MS)
    assert safety.decide(TAUT_M, 300 * MS) is Order.FOLLOW
    assert safety.decide(0.002, 5000 * MS) is Order.FOLLOW  # slackening needs no other nodes


def test_a_stop_that_ends_a_slackening_holds_for_good(safety):
    hold_taut(safety)
    safety.lose('The servo was silent.', 0)
    safety.release('The tendon was released.')
    safety.hold(0)
    for now_ms in range(0, 5000, 100):
        assert sense(safety, 1.0, TAUT_M, now_ms * MS) is Order.HOLD


def test_a_servo_that_stops_by_itself_ends_the_pull_but_no_slackening(safety):
    safety.admit(Pull(TAUT_M), 0.0, 0)
    safety.lose("The servo's watchdog has stopped it.", 0)
    assert safety.decide(0.002, 0) is Order.HOLD
    assert (safety.ending, safety.alarm) == (Ending.LOST, safety.reason)
    safety.admit(Pull(0.0), TAUT_M, 0)
    safety.lose('The servo was silent.', 0)
    assert safety.decide(TAUT_M, 0) is Order.RELEASE


# -- Stop -----------------------------------------------------------------------------------------


def make_with_latch(**changes):
    latch = StopLatch()
    safety = TendonSafety(dataclasses.replace(CONFIG, **changes), latch=latch)
    safety.set_zero(Zero.UNCONFIRMED)
    sense(safety, 0.0, 0.0)
    return safety, latch


def test_stop_ends_a_pull_and_lets_a_taut_tendon_out_however_often_it_is_pressed():
    safety, latch = make_with_latch()
    safety.admit(Pull(TAUT_M), 0.0, 0)
    latch.stop('pressed')
    assert sense(safety, 1.0) is Order.HOLD
    assert safety.ending is Ending.LOST
    assert 'The rig is stopped: pressed; remove the cause' in safety.reason
    safety.finish()
    for now_ms in range(100, 2000, 100):
        latch.stop('pressed again')
        safety.hold(now_ms * MS)
        assert sense(safety, 1.0, now_ns=now_ms * MS) is Order.HOLD
    for now_ms in range(2000, 4000, 100):
        latch.stop('pressed again')
        safety.hold(now_ms * MS)
        assert sense(safety, 1.0, now_ns=now_ms * MS) is Order.RELEASE
    assert safety.decide(0.0, 4000 * MS) is Order.FOLLOW
    assert safety.state is State.FREE


def test_stop_ends_a_pull_that_has_not_left_slack_yet():
    safety, latch = make_with_latch()
    safety.admit(Pull(TAUT_M), 0.0, 0)
    latch.stop('pressed')
    assert safety.decide(0.0, 0) is Order.HOLD


@pytest.mark.parametrize('pull', [Pull(0.006), Pull(0.003), Pull(0.02, 'abduction', 0.0, True)])
def test_while_stopped_every_pull_but_one_to_slack_is_refused(pull):
    safety, latch = make_with_latch()
    hold_taut(safety)
    latch.stop('pressed')
    with pytest.raises(MotionRefusedError, match='pressed'):
        safety.admit(pull, TAUT_M, 0)
    assert 'pressed' in str(safety.find_obstacle(0.0, 0))
    safety.admit(Pull(0.0), TAUT_M, 0)
    for now_ms in range(0, 10_000, 100):
        assert sense(safety, 1.0, now_ns=now_ms * MS) is Order.FOLLOW
    safety.finish()
    latch.reset(0)
    safety.admit(pull, TAUT_M, 10_000 * MS)


def test_stop_turns_a_pull_that_slackens_a_part_into_holding_then_slack():
    safety, latch = make_with_latch()
    hold_taut(safety)
    safety.admit(Pull(0.003), TAUT_M, 0)
    latch.stop('pressed')
    assert sense(safety, 1.0, 0.004) is Order.HOLD
    assert sense(safety, 1.0, 0.004, 2000 * MS) is Order.RELEASE


@pytest.mark.parametrize('begin', ['release', 'pull'])
def test_while_stopped_no_cancel_turns_slackening_into_holding(begin):
    safety, latch = make_with_latch()
    hold_taut(safety)
    if begin == 'release':
        safety.release('The tendon was released.')
    else:
        safety.admit(Pull(0.0), TAUT_M, 0)
    latch.stop('pressed')
    safety.hold(0)
    assert sense(safety, 1.0) is Order.RELEASE


def test_a_reset_keeps_slackening_and_tightens_nothing():
    safety, latch = make_with_latch()
    hold_taut(safety)
    latch.stop('pressed')
    assert sense(safety, 1.0) is Order.HOLD
    latch.reset(0)
    assert sense(safety, 1.0, now_ns=1000 * MS) is Order.HOLD
    assert sense(safety, 1.0, now_ns=2000 * MS) is Order.RELEASE


def test_a_tendon_that_was_held_after_a_cancel_is_slackened_after_a_stop():
    safety, latch = make_with_latch()
    hold_taut(safety)
    safety.hold(0)
    for now_ms in range(0, 5000, 100):
        assert sense(safety, 1.0, now_ns=now_ms * MS) is Order.HOLD
    latch.stop('pressed')
    assert sense(safety, 1.0, now_ns=5000 * MS) is Order.HOLD
    assert sense(safety, 1.0, now_ns=7000 * MS) is Order.RELEASE


def test_above_the_limit_a_stop_slackens_at_once():
    safety, latch = make_with_latch()
    hold_taut(safety)
    latch.stop('pressed')
    assert sense(safety, 20.0) is Order.RELEASE


def test_without_a_zero_a_stop_slackens_by_a_stated_length():
    latch = StopLatch()
    safety = TendonSafety(CONFIG, latch=latch)
    safety.set_zero(Zero.UNKNOWN, 'the servo was held')
    latch.stop('pressed')
    assert safety.decide(TAUT_M, 0) is Order.HOLD
    assert safety.decide(TAUT_M, 2000 * MS) is Order.RELEASE
    assert safety.decide(safety.slack_m, 3000 * MS) is Order.FOLLOW
    assert safety.slack_m == -CONFIG.max_displacement_m


# -- stop tensions --------------------------------------------------------------------------------


def test_the_stop_tension_ends_the_pull_at_or_above(safety):
    safety.admit(Pull(TAUT_M, stop_tension_n=5.0), 0.0, 0)
    assert not feed(safety, [4.999], 0)
    assert safety.decide(0.002, 0) is Order.FOLLOW
    assert feed(safety, [5.0], 0)
    assert not feed(safety, [5.0], 0)  # the order does not change
    assert sense(safety, 4.0, 0.002) is Order.HOLD
    assert safety.ending is Ending.REACHED
    assert safety.reason == 'The tension reached 5.00 N.'


def test_a_stop_tension_that_is_passed_by_more_than_the_limit_is_no_success(safety):
    safety.admit(Pull(TAUT_M, stop_tension_n=15.0), 0.0, 0)
    assert feed(safety, [15.0], 0)
    assert safety.ending is Ending.REACHED
    assert feed(safety, [15.2], 0)
    assert safety.decide(0.002, 0) is Order.RELEASE
    assert safety.ending is Ending.OVER_LIMIT


def test_what_is_no_number_is_no_sample(safety):
    assert not feed(safety, [float('nan'), 1.0], 1000 * MS)
    assert not feed(safety, [], 1000 * MS)
    assert safety.tension.latest_n == 0.0
    assert safety.tension.live_n(1000 * MS) is None


# -- the zero -----------------------------------------------------------------------------------


def test_a_zero_is_confirmed_by_a_slack_reading_and_refuted_by_tension():
    safety = make_unconfirmed()
    sense(safety, 0.1, 0.0)
    assert safety.zero is Zero.KNOWN
    safety.set_zero(Zero.UNCONFIRMED)
    safety.decide(0.0, 0)
    assert safety.zero is Zero.UNCONFIRMED  # earlier samples are ignored
    sense(safety, 2.0, 0.0)
    with pytest.raises(MotionRefusedError, match='wait'):
        safety.admit(Pull(TAUT_M), 0.0, 0)
    sense(safety, 2.0, 0.0, 500 * MS)
    assert safety.zero is Zero.UNKNOWN
    with pytest.raises(MotionRefusedError, match=r'2\.00 N.* home the tendon'):
        safety.admit(Pull(TAUT_M), 0.0, 500 * MS)
    safety.admit(Pull(0.02, 'abduction', is_homing=True), 0.0, 500 * MS)


def test_a_tendon_that_was_left_taut_is_slackened_before_anything_tightens():
    safety = make_unconfirmed()
    safety.release('The driver was restarted.')
    assert sense(safety, 10.9) is Order.RELEASE
    with pytest.raises(MotionRefusedError, match='slacken it first'):
        safety.admit(Pull(0.006), TAUT_M, 0)
    for now_ms in (0, 100, 200):  # the tendon is slack already, but the samples are late
        safety.decide(0.0, now_ms * MS)
    assert sense(safety, 0.1, 0.0, 300 * MS) is Order.FOLLOW
    assert safety.zero is Zero.KNOWN


def test_without_a_zero_slackening_ends_where_the_sensor_reads_slack():
    safety = TendonSafety(CONFIG)
    safety.set_zero(Zero.UNKNOWN, 'the servo was held')
    assert safety.slack_m == -CONFIG.max_displacement_m
    safety.release('restarted')
    assert sense(safety, 2.0, -0.001) is Order.RELEASE
    assert sense(safety, 0.05, -0.003) is Order.FOLLOW


def test_a_zero_is_judged_at_the_zero_alone():
    safety = TendonSafety(CONFIG)
    assert (safety.zero, safety.reason) == (Zero.UNKNOWN, '')
    sense(safety, 0.0, 0.0)
    with pytest.raises(MotionRefusedError, match='home the tendon'):
        safety.admit(Pull(TAUT_M), 0.0, 0)  # a slack reading does not make an unknown zero known
    safety.set_zero(Zero.UNCONFIRMED)
    sense(safety, 0.0)
    assert safety.zero is Zero.UNCONFIRMED
    for displacement_m, now_ms in ((0.0, 0), (TAUT_M, 400), (0.0, 500)):
        sense(safety, 2.0, displacement_m, now_ms * MS)
    assert safety.zero is Zero.UNCONFIRMED  # 0.5 s at the zero without a break would refute it


# -- what others ask of it ------------------------------------------------------------------------


def test_it_says_whether_a_needed_topic_was_never_heard():
    peer = TopicWatchdog('trial_runner/heartbeat', 0.2)
    safety, unguarded = TendonSafety(CONFIG, [peer]), make(unguarded=True)
    assert safety.awaits_first
    feed(safety, [0.0], 0)
    assert safety.awaits_first
    peer.beat(0)
    assert not safety.awaits_first
    assert not unguarded.awaits_first
    assert TendonSafety(CONFIG).awaits_first


def test_an_alarm_is_what_nobody_has_commanded(safety):
    hold_taut(safety)
    safety.admit(Pull(0.006), TAUT_M, 0)
    assert safety.is_pulling
    safety.hold(0)
    assert safety.alarm is None
    safety.finish()
    assert not safety.is_pulling
    safety.lose('The servo is silent.', 0)
    assert safety.alarm


def test_a_new_zero_is_judged_anew():
    safety = make_unconfirmed()
    feed(safety, [2.0], 0)
    with pytest.raises(MotionRefusedError, match='wait'):
        safety.admit(Pull(TAUT_M), 0.0, 0)  # refused even without a poll in between
    safety.set_zero(Zero.UNCONFIRMED)
    assert safety.tension.live_n(0) is None
    sense(safety, 2.0, 0.0, 500 * MS)
    assert safety.zero is Zero.UNCONFIRMED
    safety.set_zero(Zero.KNOWN)
    assert safety.tension.live_n(500 * MS) == 2.0
    assert safety.strictest_contact == 'abduction'
