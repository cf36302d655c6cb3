# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A trial reports the start of its phases, its motion, and why it cannot begin."""

import itertools
import math
import re
import threading
from types import SimpleNamespace

import pytest
from trial_bench import Device, SILENCE_S, stamp_ns

from tactile_bringup.nodes import trial_devices
from tactile_msgs.msg import StrainBlock
from tactile_testing.waiting import wait_until

STAMP_BOUND_NS = 50_000_000


def phase(bench, name):
    (event,) = (event for event in bench.events if event.phase == name)
    return stamp_ns(event)


def test_phases_begin_with_the_motion_and_not_with_its_command(bench):
    bench.guide.delays = {2: 0.3}
    bench.tendon.delays = {1: 0.3}
    result = bench.end(bench.start('texture'))
    assert 'done' in result.message
    assert result.glide_speed_m_s == pytest.approx(0.015, rel=1e-6)
    assert result.glide_lag_s < 1e-6
    bench.wait_for_phase('done')
    assert bench.phases == ['approach', 'contact', 'glide', 'release', 'return', 'done']
    for name, device, goal in (
        ('contact', bench.tendon, 1),
        ('glide', bench.guide, 2),
        ('return', bench.guide, 3),
    ):
        assert abs(phase(bench, name) - device.moved_at_ns[goal]) < STAMP_BOUND_NS, name
    arrived_ns = bench.guide.moved_at_ns[2] + 7 * 10**8  # 10.5 mm at 15 mm/s take 0.7 s
    assert abs(phase(bench, 'release') - arrived_ns) < STAMP_BOUND_NS
    stamps = [stamp_ns(event) for event in bench.events]
    assert all(a <= b for a, b in itertools.pairwise(stamps))


def test_a_hold_lasts_from_rest_to_the_release_that_was_seen(bench):
    bench.tendon.delays = {2: 0.3}
    result = bench.end(bench.start('stiffness', hold_s=0.5))
    bench.wait_for_phase('done')
    assert bench.phases == ['approach', 'contact', 'hold', 'release', 'done']
    assert phase(bench, 'hold') == bench.tendon.rested_at_ns[0]
    assert abs(phase(bench, 'release') - bench.tendon.moved_at_ns[2]) < STAMP_BOUND_NS
    assert result.displacement_error_m < 1e-6


@pytest.mark.parametrize('status', [0, StrainBlock.STATUS_SIMULATED])
def test_events_are_simulated_where_the_samples_are(bench, status):
    bench.sensor.status = status
    wait_until(lambda: bench.runner._strain.is_simulated == bool(status))
    assert 'done' in bench.end(bench.start('stiffness', hold_s=0.3)).message
    bench.wait_for_phase('done')
    assert {event.simulated for event in bench.events} == {bool(status)}


def test_a_glide_that_was_not_the_commanded_one_fails_with_the_numbers(bench):
    bench.guide.slowness = {2: 1.1}
    result = bench.end(bench.start('texture'))
    assert re.search(r'glide.* 0\.013\d+ m/s.* 0\.015 m/s', result.message)
    assert 0.013 < result.glide_speed_m_s < 0.0149
    assert result.glide_lag_s > 0.033
    bench.wait_for_phase('aborted')
    bench.wait_until_released()


def test_a_tendon_that_reports_slowly_until_it_moves_does_for_a_trial(bench, monkeypatch):
    monkeypatch.setattr(trial_devices, 'REST_REPORT_S', 10.0)
    wait_until(lambda: not bench.runner._tendon.find_missing())
    bench.tendon.rest_period_s = 1e3
    bench.tendon.delays = {1: 1.5 * SILENCE_S}
    assert 'done' in bench.end(bench.start('stiffness', hold_s=0.5)).message


def test_a_trial_waits_for_the_first_position(request, monkeypatch):
    speaks, publish = threading.Event(), Device.publish

    def publish_later(device, now):
        if speaks.is_set() or device.get_name() != 'tendon_actuator':
            publish(device, now)

    monkeypatch.setattr(Device, 'publish', publish_later)
    bench = request.getfixturevalue('bench')
    handle = bench.start('stiffness', hold_s=0.5)
    wait_until(lambda: 'approach' in bench.phases)
    topic = 'tendon_actuator/joint_states'
    wait_until(lambda: any(topic in each for each in bench.runner._tendon.find_missing()))
    assert not bench.guide.goals
    speaks.set()
    assert 'done' in bench.end(handle).message


def test_a_motion_that_nobody_reports_fails(bench):
    bench.guide.publish = lambda now: None
    bench.end(bench.start('texture'))
    wait_until(lambda: bench.phases[-1] == 'aborted')
    assert 'linear_guide/joint_states' in bench.events[-1].message


# -- ready means ready ------------------------------------------------------------------------


def test_the_log_says_once_what_is_missing_and_once_that_all_is_ready(bench):
    runner, said = bench.runner, []
    # The logger is replaced, because pytest may lose a line of the standard error.
    logger = SimpleNamespace(info=said.append, warning=said.append, set_level=lambda _: None)
    runner.get_logger = lambda: logger
    runner._readiness_log.cancel()  # it may already have logged
    bench.guide.say_ready('The guide has not been homed; home the guide.')
    wait_until(lambda: 'home the guide' in ' '.join(runner._ready.missing or ()))
    runner._began_s = -math.inf
    said.clear()
    runner._readiness_log = runner.call_every(0.02, runner._log_readiness)
    wait_until(lambda: said)
    bench.guide.say_ready()
    wait_until(lambda: 'ready for trials' in said, lambda: f'{said}, {runner._find_missing()}')
    missing, ready = said
    assert 'home the guide' in missing
    assert 'ros2 action send_goal /linear_guide/home' in missing
    assert ready == 'ready for trials'
    bench.touch('stiffness')  # a running trial is not logged as a missing condition
    wait_until(lambda: runner._ready.missing)
    runner._began_s = -math.inf
    runner._log_readiness()
    assert len(said) == 2


def test_a_goal_waits_for_a_driver_and_one_that_stays_unready_ends_it_with_its_sentence(bench):
    sentence = 'The position is unknown; home the guide.'
    bench.guide.say_ready(sentence)
    assert bench.end(bench.start('stiffness')).message.endswith(sentence)
    bench.wait_for_phase('aborted')
    bench.events.clear()
    # The trial waits until the driver is ready, because the result of a homing may arrive before
    # the message on ~/ready.
    handle = bench.start('stiffness', hold_s=0.5)
    bench.wait_for_phase('approach')
    assert (bench.guide.goals, bench.tendon.goals) == ([], [])
    bench.guide.say_ready()
    assert 'done' in bench.end(handle).message


def test_the_trial_runner_says_whether_it_is_ready_and_what_is_missing(bench):
    wait_until(lambda: bench.readiness and bench.readiness[-1].ready)
    bench.sensor.is_alive = False
    wait_until(lambda: 'tendon_sensor/strain' in ' '.join(bench.readiness[-1].missing))
    assert 'tendon_sensor/strain' in bench.end(bench.start('stiffness')).message
    assert (bench.guide.goals, bench.tendon.goals) == ([], [])
    bench.sensor.is_alive = True
    bench.tendon.say_ready('The servo is hot; let it cool.')
    wait_until(lambda: bench.readiness[-1].missing == ['The servo is hot; let it cool.'])
    bench.tendon.say_ready()
    wait_until(lambda: bench.readiness[-1].ready)
    bench.start('stiffness')
    wait_until(lambda: 'A trial is running' in ' '.join(bench.readiness[-1].missing))
    bench.wait_for_phase('hold')
    bench.guide.beats = False
    wait_until(lambda: 'linear_guide/heartbeat' in ' '.join(bench.readiness[-1].missing))
