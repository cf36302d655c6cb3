# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The operator: time limits for trials, and clean-up after a time-out."""

import threading

import pytest
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_bringup.nodes import operator_node
from tactile_bringup.nodes.operator_node import OperatorNode, StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_ros.errors import TactileError
from tactile_ros.health import Heartbeat, PRESENCE_LEASE_S
from tactile_ros.node_group import NodeGroup
from tactile_testing.requests import send
from tactile_testing.waiting import DEADLINE_S, wait_until


@pytest.fixture
def operated(bench, context):
    operator = OperatorNode(context)
    with NodeGroup([operator], context=context):
        yield bench, operator


def test_a_trial_that_is_given_up_is_cancelled_and_the_next_one_runs(operated, monkeypatch):
    bench, operator = operated
    bench.guide.delays = {1: 5.0}
    monkeypatch.setattr(operator_node, 'longest_trial_s', lambda *_: -29.5)  # timeout of 0.5 s
    with pytest.raises(TactileError, match=r'cancelled.* approach'):
        operator.run_trial(TrialRequest('stiffness', 'flexion', hold_s=0.5))
    assert not bench.runner.goal_runners[0].is_busy
    monkeypatch.undo()
    second = TrialRequest('stiffness', 'flexion', trial_id='second', hold_s=0.5)
    assert operator.run_trial(second) == 'second'


def test_an_operator_sends_no_goal_to_two_trial_runners(operated, context):
    bench, operator = operated
    twin = Node('trial_runner', context=context)
    heart = Heartbeat(twin, lambda: True, '~/presence', PRESENCE_LEASE_S)

    def is_seen():
        heart.beat()
        return operator._rivals[operator._run].find_loss()

    wait_until(is_seen)
    with pytest.raises(TactileError, match='trial_runner/presence'):
        operator.run_trial(TrialRequest('stiffness', 'flexion', hold_s=0.5))
    heart.close()
    twin.destroy_node()
    wait_until(lambda: not operator._rivals[operator._run].find_loss())
    request = TrialRequest('stiffness', 'flexion', trial_id='first', hold_s=0.5)
    assert operator.run_trial(request) == 'first'
    assert [event.phase for event in bench.events].count('approach') == 1


def test_a_rig_that_does_not_come_to_rest_is_said(operated, monkeypatch):
    bench, operator = operated
    stuck = threading.Event()
    work = bench.runner.goal_runners[0]._work
    bench.runner.goal_runners[0]._work = lambda goal: stuck.wait(10.0) and work(goal)
    monkeypatch.setattr(operator_node, 'END_TIMEOUT_S', 0.3)
    monkeypatch.setattr(operator_node, 'longest_trial_s', lambda *_: 0.2)
    with pytest.raises(TactileError, match='by hand'):
        operator.run_trial(TrialRequest('stiffness', 'flexion'))
    stuck.set()


def ask_to_stop(operator, name='operator/stop'):
    client = operator.create_client(Trigger, name)
    wait_until(client.service_is_ready)
    request = Trigger.Request()
    return send(operator, lambda: client.call_async(request)).result(DEADLINE_S)


def test_a_session_that_was_stopped_between_two_trials_moves_nothing(operated):
    bench, operator = operated
    assert ask_to_stop(operator).success
    with pytest.raises(StoppedError):
        operator.run_trial(TrialRequest('stiffness', 'flexion', hold_s=0.5))
    assert not bench.tendon.goals
    operator.resume()
    request = TrialRequest('stiffness', 'flexion', trial_id='second', hold_s=0.5)
    assert operator.run_trial(request) == 'second'


def test_a_stop_while_the_goal_is_on_its_way_cancels_the_trial(operated, monkeypatch):
    bench, operator = operated
    bench.guide.waits_in = (1,)
    send = operator._run.send

    def send_before_stop(goal):
        sent = send(goal)
        operator.stop()
        return sent

    monkeypatch.setattr(operator._run, 'send', send_before_stop)
    with pytest.raises(StoppedError, match='cancelled'):
        operator.run_trial(TrialRequest('texture', 'flexion'))


def test_a_stop_cancels_the_trial_that_runs(operated):
    bench, operator = operated
    bench.guide.waits_in = (1,)
    ends = []

    def run():
        with pytest.raises(StoppedError, match='cancelled') as end:
            operator.run_trial(TrialRequest('texture', 'flexion'))
        ends.append(end)

    thread = threading.Thread(target=run)
    thread.start()
    wait_until(lambda: bench.guide.goals)
    assert ask_to_stop(operator).success
    thread.join(DEADLINE_S)
    (end,) = ends
    assert 'live page' in str(end.value)


def test_a_session_ends_when_the_rig_is_stopped_and_moves_nothing_until_it_is_reset(operated):
    bench, operator = operated
    bench.guide.waits_in = (1,)
    ends = []

    def run():
        with pytest.raises(StoppedError, match='/trial_runner') as end:
            operator.run_trial(TrialRequest('texture', 'flexion'))
        ends.append(end)

    thread = threading.Thread(target=run)
    thread.start()
    wait_until(lambda: bench.guide.goals)
    assert ask_to_stop(operator, 'trial_runner/stop').success
    thread.join(DEADLINE_S)
    (end,) = ends
    assert 'rig was stopped' in str(end.value)
    request = TrialRequest('stiffness', 'flexion', trial_id='second', hold_s=0.5)
    with pytest.raises(StoppedError, match='/trial_runner'):
        operator.run_trial(request)
    assert len(bench.guide.goals) == 1
    assert ask_to_stop(operator, 'trial_runner/reset').success
    wait_until(lambda: not operator._stop_state.is_stopped)
    assert operator.run_trial(request) == 'second'


def test_diagnostics_of_the_progress_end_with_the_operator(context):
    operator = OperatorNode(context)
    operator.publish_progress(1, 2, TrialRequest('stiffness', 'flexion'))
    diagnostics = operator._diagnostics
    operator.destroy_node()
    diagnostics.publish()  # a late periodic call, after the publisher was destroyed
