# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials that end early, with devices that the test can remove."""

from contextlib import contextmanager
import re
import signal
import threading
import time

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trial_bench import DEADLINE_S

from tactile_bringup.nodes import trial_runner_node
from tactile_msgs.action import MoveGuide
from tactile_ros.goal_client import call_until_answered
from tactile_ros.health import Heartbeat, HeartbeatWatch, PRESENCE_LEASE_S
from tactile_ros.qos import STREAM
from tactile_ros.rclpy_internals import GoalIdClient
from tactile_testing.waiting import wait_until


def test_an_unknown_protocol_is_refused_before_anything_moves(bench):
    assert '"smell"' in bench.end(bench.start('smell')).message
    assert (bench.guide.goals, bench.tendon.goals, bench.phases) == ([], [], [])


def test_a_device_whose_action_server_goes_away_ends_the_trial(bench):
    bench.guide.waits_in = (2,)
    goal = bench.start('texture')
    wait_until(lambda: len(bench.guide.goals) == 2)
    # The server disappears without a result, as if its process had been killed.
    bench.guide._runner._server.destroy()
    assert 'linear guide' in bench.end(goal).message
    bench.wait_until_released()


def test_no_lost_answer_ends_a_trial(bench, monkeypatch):
    take_data, lost = GoalIdClient.take_data, set()

    def take_data_in_part(client):
        """Lose the first answer of each kind to each client, as Fast DDS does."""
        data = take_data(client)
        for kind in {'goal', 'result'} & {*data}:
            if (client, kind) not in lost:
                lost.add((client, kind))
                del data[kind]
        return data

    monkeypatch.setattr(GoalIdClient, 'take_data', take_data_in_part)
    goal = bench.start('stiffness', hold_s=0.1)
    assert 'done' in bench.end(goal).message
    # There are three clients: two of the runner (guide, tendon), and one of the test. Each has
    # lost two answers.
    assert len(lost) == 6
    assert [len(device.goals) for device in (bench.guide, bench.tendon)] == [1, 2]


def test_a_driver_that_never_ends_its_goal_does_not_keep_the_trial(bench, monkeypatch):
    monkeypatch.setattr(trial_runner_node, 'longest_trial_s', lambda *_: 1.0)
    bench.guide.waits_in = (1,)
    assert '1 s' in bench.end(bench.start('stiffness')).message


@pytest.mark.parametrize(('protocol', 'dead'), [('texture', 'guide'), ('stiffness', 'tendon')])
def test_a_driver_that_falls_silent_ends_the_trial_with_its_reason(bench, protocol, dead):
    goal = bench.touch(protocol)
    device = getattr(bench, dead)
    device.say_ready('It does not answer; check its cable.')
    device.beats = False  # as if it was killed; its action server remains visible for some time
    bench.wait_for_phase('aborted')
    message = bench.end(goal).message
    assert f'{device.get_name()}/heartbeat' in message
    assert message.endswith('It does not answer; check its cable.')
    # The runner also asks a driver without heartbeat to slacken the tendon.
    bench.wait_until_released()


@contextmanager
def second_node(bench, context, name):
    """Start a second node with the name of another node, which publishes only its presence."""
    node = Node(name, context=context)
    heart = Heartbeat(node, lambda: True, '~/presence', PRESENCE_LEASE_S)
    timer = bench.client.create_timer(0.02, heart.beat)
    yield
    bench.client.destroy_timer(timer)
    heart.close()
    node.destroy_node()


def test_a_second_tendon_driver_ends_the_trial_and_refuses_the_next(bench, context):
    goal = bench.touch('stiffness')
    goals = len(bench.tendon.goals)
    named = 'tendon_actuator/presence (/tendon_actuator, /tendon_actuator)'
    with second_node(bench, context, 'tendon_actuator'):
        assert named in bench.end(goal).message
        bench.wait_until_released()
        assert goals + 1 == len(bench.tendon.goals)
        assert named in bench.end(bench.start('stiffness')).message
        assert all(goal.displacement_m == 0.0 for goal in bench.tendon.goals[goals:])
    wait_until(lambda: bench.readiness[-1].ready)


def test_of_two_trial_runners_none_runs_a_trial(bench, context):
    with second_node(bench, context, 'trial_runner'):
        named = 'trial_runner/presence (/trial_runner, /trial_runner)'
        wait_until(lambda: bench.readiness and named in ' '.join(bench.readiness[-1].missing))
        assert named in bench.end(bench.start('stiffness')).message
    assert (bench.guide.goals, bench.tendon.goals) == ([], [])


def test_a_runner_whose_executor_or_trial_hangs_gives_no_sign_of_life(bench):
    watch = HeartbeatWatch(bench.client, 'trial_runner/heartbeat')
    wait_until(lambda: not watch.find_loss(), watch.find_loss)
    end = threading.Event()
    bench.runner.executor.create_task(end.wait)
    wait_until(watch.find_loss)
    end.set()
    wait_until(lambda: not watch.find_loss())

    find_loss, looks, end = bench.runner._contact.find_loss, [], threading.Event()

    def hang():
        looks.append(True)
        if len(looks) > 1:  # the second check blocks the trial's thread
            end.wait()
        return find_loss()

    bench.runner._contact.find_loss = hang
    is_lost = False
    while not is_lost:  # on a busy computer a trial may end for another reason
        looks.clear()
        ended = bench.start('stiffness').end
        wait_until(lambda ended=ended: watch.find_loss() or ended.done())
        is_lost = bool(watch.find_loss())
    end.set()
    wait_until(lambda: not watch.find_loss())
    watch.close()


def test_a_trial_waits_for_a_tendon_that_is_still_being_slackened_after_the_last_one(bench):
    bench.tendon.slowness = {2: 3.0}  # slackening takes three times as long
    goal = bench.touch('stiffness')
    bench.tendon.beats = False
    assert 'tendon_actuator/heartbeat' in bench.end(goal).message
    bench.tendon.beats = True
    assert 'done' in bench.end(bench.start('stiffness', hold_s=0.5)).message
    assert [goal.displacement_m > 0 for goal in bench.tendon.goals] == [True, False, True, False]


def test_strain_that_ends_in_contact_ends_the_trial(bench):
    goal = bench.touch('stiffness')
    bench.sensor.is_alive = False
    assert 'tendon_sensor/strain for 0.5 s' in bench.end(goal).message
    bench.wait_for_phase('aborted')
    assert 'tendon_sensor/strain' in bench.events[-1].message
    bench.wait_until_released()


def test_a_device_that_ignores_a_cancel_does_not_keep_the_trial(bench):
    stuck = threading.Event()
    bench.guide._runner._work = lambda goal: stuck.wait(DEADLINE_S) and MoveGuide.Result()
    goal = bench.start('stiffness')
    wait_until(lambda: bench.guide._runner.is_busy)
    goal.cancel()
    assert bench.end(goal).message.endswith('cancelled')
    bench.wait_for_phase('aborted')
    stuck.set()


@pytest.mark.parametrize('protocol', ['texture', 'stiffness'])
def test_a_tendon_that_is_let_go_in_contact_ends_the_trial_with_its_reason(bench, protocol):
    goal = bench.touch(protocol)
    bench.tendon.position_m = 0.0020
    wait_until(lambda: not bench.runner._trial.is_watched)
    bench.tendon.say_ready('The tension exceeded 15 N.')
    result = bench.end(goal)
    assert '0.0049 m' in result.message
    assert result.message.endswith('The tension exceeded 15 N.')
    assert result.displacement_error_m == pytest.approx(0.0029)
    bench.wait_until_released()


def test_a_clock_that_is_set_back_in_the_hold_hides_nothing(bench):
    goal = bench.touch('stiffness')

    def publish(_):
        state = JointState(position=[bench.tendon.position_m], velocity=[0.0])
        state.header.stamp = Time(nanoseconds=time.time_ns() - 10**10).to_msg()
        bench.tendon.states.publish(state)

    bench.tendon.publish = publish
    assert 'tendon actuator' in bench.end(goal).message
    bench.wait_for_phase('aborted')


def test_a_runner_that_stood_still_while_it_looked_blames_nobody_else(bench):
    goal = bench.touch('stiffness')

    def stand_still():
        threading.Event().wait(2.0 * bench.runner.config.heartbeat_timeout_s)
        return 'The tendon is lost.'

    bench.runner._contact.find_loss = stand_still
    message = bench.end(goal).message
    assert 'trial runner' in message
    assert 'The tendon is lost.' not in message


@pytest.mark.parametrize('phase', ['glide', 'hold'])
def test_a_phase_in_which_the_runner_was_frozen_does_not_succeed(bench_apart, phase):
    bench = bench_apart
    goal = bench.start('texture' if phase == 'glide' else 'stiffness', hold_s=1.0)
    bench.wait_for_phase(phase)
    bench.process.send_signal(signal.SIGSTOP)
    frozen_s = time.monotonic()
    # The runner is stopped for longer than the phase, while the simulated devices continue.
    wait_until(lambda: time.monotonic() > frozen_s + 2.0)
    bench.process.send_signal(signal.SIGCONT)
    message = bench.end(goal).message
    # The pause is detected by the check of the trial or by the check of its goal.
    assert re.search(rf'\d\.\d+ s .*{phase}|{phase}.* \d\.\d s', message), message
    bench.wait_for_phase('aborted')
    bench.wait_until_released()


def test_a_hold_whose_tendon_is_reported_no_more_does_not_succeed(bench):
    goal = bench.touch('stiffness')
    bench.tendon.publish = lambda now: None  # the heartbeat continues
    assert 'tendon_actuator/joint_states' in bench.end(goal).message
    bench.wait_for_phase('aborted')


def assert_is_tracked_no_more(bench, device):
    """Assert that joint states that arrive after the end of the tracking are not stored."""
    states = []
    topic = f'{device.name}/joint_states'
    wait_until(lambda: time.monotonic() > device._track_end_s)
    bench.client.create_subscription(JointState, topic, states.append, STREAM)
    wait_until(lambda: states)
    count, heard = len(device._track._moving), len(states)
    wait_until(lambda: len(states) > heard + 30)
    assert len(device._track._moving) == count


def test_a_guide_that_stands_in_an_aborted_path_is_not_tracked_for_ever(bench):
    bench.guide.pauses = {2: DEADLINE_S}
    goal = bench.start('texture')
    bench.wait_for_phase('glide')
    wait_until(lambda: bench.guide.position_m > 0.015)
    goal.cancel()
    bench.end(goal)
    assert bench.runner._guide._track._moving
    assert_is_tracked_no_more(bench, bench.runner._guide)


def test_a_tendon_that_holds_inside_its_path_is_not_tracked_for_ever(bench):
    goal = bench.touch('stiffness')
    bench.tendon.position_m = 0.0045  # within the tolerance of the driver
    track = bench.runner._tendon._track
    track._is_over = False  # as if the servo had stopped there
    assert_is_tracked_no_more(bench, bench.runner._tendon)
    goal.cancel()
    bench.end(goal)


def call(bench, name):
    client = bench.client.create_client(Trigger, name)
    assert client.wait_for_service(timeout_sec=DEADLINE_S)
    answer = call_until_answered(bench.client, client, Trigger.Request(), DEADLINE_S)
    return answer.result()


@pytest.mark.parametrize('protocol', ['texture', 'stiffness'])
def test_a_stop_ends_the_trial_and_refuses_the_next_until_it_is_reset(bench, protocol):
    goal = bench.touch(protocol)
    assert call(bench, 'trial_runner/stop').success
    stopped = 'Stop was pressed on /trial_runner'
    assert stopped in bench.end(goal).message
    assert not bench.guide._runner.is_busy
    bench.wait_until_released()
    wait_until(lambda: stopped in ' '.join(bench.readiness[-1].missing))
    count = len(bench.guide.goals)
    assert stopped in bench.end(bench.start('stiffness')).message
    assert len(bench.guide.goals) == count
    assert call(bench, 'trial_runner/reset').success
    bench.guide.waits_in = ()
    assert 'done' in bench.end(bench.start('stiffness', hold_s=0.5)).message


def test_a_cancelled_trial_latches_nothing(bench):
    goal = bench.touch('stiffness')
    goal.cancel()
    assert bench.end(goal).message.endswith('cancelled')
    bench.wait_until_released()
    assert 'done' in bench.end(bench.start('stiffness', hold_s=0.5)).message


def test_a_release_that_fails_is_tried_again(bench):
    bench.tendon.fails_in = (1, 2, 3)  # the pull and two releases
    assert 'the servo was silent' in bench.end(bench.start('stiffness')).message
    assert [goal.displacement_m > 0 for goal in bench.tendon.goals] == [True] + 3 * [False]


def test_shutdown_in_a_glide_stops_the_devices_and_releases_the_tendon(bench):
    bench.guide.waits_in = (2,)
    bench.start('texture')
    wait_until(lambda: len(bench.guide.goals) == 2)
    done = threading.Event()

    def shut_down():  # runs on the node's executor, like the lifecycle service
        bench.runner.trigger_shutdown()
        done.set()

    bench.runner.executor.create_task(shut_down)
    wait_until(lambda: not bench.guide._runner.is_busy)
    assert done.wait(DEADLINE_S)
    wait_until(lambda: bench.tendon.goals[-1].displacement_m == 0.0)


def test_a_second_life_of_the_trial_runner_works_like_the_first(bench):
    bench.guide.waits_in = (1, 2)
    for life in range(2):
        goal = bench.start('stiffness')
        wait_until(lambda life=life: len(bench.guide.goals) == life + 1)
        bench.runner.trigger_deactivate()
        assert bench.end(goal).message.endswith('cancelled')
        wait_until(lambda: not bench.runner.goal_runners[0].is_busy)
        for transition in ('cleanup', 'configure', 'activate'):
            result = getattr(bench.runner, f'trigger_{transition}')()
            assert result == TransitionCallbackReturn.SUCCESS
            if transition == 'cleanup':  # wait until the old server has disappeared
                wait_until(lambda: not bench.action.server_is_ready())
        assert len(bench.runner.goal_runners) == 1
        assert len(bench.runner._managed_entities) == 1
        assert bench.action.wait_for_server(DEADLINE_S)


def test_a_guide_that_moves_or_says_no_position_in_a_hold_ends_the_trial(bench):
    goal = bench.touch('stiffness')
    bench.wait_for_phase('hold')
    bench.guide.position_m += 0.001
    assert re.search('hold.* 0.0100 m .*0.0110 m', bench.end(goal).message)
    bench.wait_until_released()
    bench.guide.position_m = 0.0
    bench.events.clear()
    goal = bench.start('stiffness')
    bench.wait_for_phase('hold')
    bench.guide.publish = lambda _: None
    assert 'linear_guide/joint_states for 1.5 s' in bench.end(goal).message
    bench.wait_until_released()
