# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Actions of the buttons on the live page of `tactile watch`, also if services respond late."""

import asyncio
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_bringup.nodes.operator_node import OperatorNode, StoppedError
from tactile_lab.watch import controls
from tactile_lab.watch.controls import WatchControls
from tactile_lab.watch.node import WatchNode
from tactile_lab.watch.state import WatchState
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_testing.waiting import wait_until

STOP = '/late/linear_guide/stop'


def test_stop_is_repeated_after_a_late_response(context, monkeypatch):
    monkeypatch.setattr(controls, 'ANSWER_TIMEOUT_S', 0.2)
    calls, may_answer = [], threading.Event()

    def stop(_, response):
        calls.append('stop')
        may_answer.wait(10.0)
        response.success = True
        return response

    guide = Node('guide', context=context)
    guide.create_service(Trigger, STOP, stop)
    state = WatchState()
    state.finger('late')
    watch = WatchNode(state, context)
    with NodeGroup([guide], context), NodeGroup([watch], context) as group:
        wait_until(lambda: STOP in watch.stop_clients())
        client = watch.stop_clients()[STOP]
        buttons = WatchControls(watch, context)
        with pytest.raises(TactileError, match='not confirmed by late/linear_guide;'):
            asyncio.run(buttons.stop())
        may_answer.set()
        wait_until(lambda: not client._pending_requests, 'the late answer never came')
        monkeypatch.setattr(controls, 'ANSWER_TIMEOUT_S', 10.0)
        assert asyncio.run(buttons.stop()) == 'stop: confirmed by late/linear_guide'
        assert calls == ['stop', 'stop']
        assert not group.ended.is_set()


@pytest.fixture
def buttons(context):
    """Return the controls of a live page. The rig runs in another ROS context."""
    other = Context()
    rclpy.init(context=other, domain_id=context.get_domain_id())
    watch = WatchNode(WatchState(), other)
    with NodeGroup([watch], other):
        yield WatchControls(watch, other)
    rclpy.try_shutdown(context=other)


def wait_for_stops(buttons, *paths):
    wait_until(lambda: buttons._node._look_for_services() and set(paths) <= buttons._node._heard)


def offer_stop(node, path, calls, *, success=True, message=''):
    def stop(_, response):
        calls.append(path)
        response.success, response.message = success, message
        return response

    node.create_service(Trigger, path, stop)


def test_stop_reaches_drivers_without_samples(context, buttons):
    calls, driver = [], Node('driver', context=context)
    paths = ['/linear_guide/stop', '/left/thumb/tendon_actuator/stop']
    for path in paths:
        offer_stop(driver, path, calls)
    offer_stop(driver, '/something_else/stop', calls)
    with NodeGroup([driver], context):
        wait_for_stops(buttons, *paths)
        said = asyncio.run(buttons.stop())
    assert not buttons._node.state.fingers
    names = said.removeprefix('stop: confirmed by ').split(', ')
    assert sorted(names) == ['left/thumb/tendon_actuator', 'linear_guide']
    assert sorted(calls) == sorted(paths)


def test_stop_names_the_driver_that_has_failed_to_stop(context, buttons):
    calls, driver = [], Node('driver', context=context)
    offer_stop(driver, '/linear_guide/stop', calls)
    offer_stop(driver, '/tendon_actuator/stop', calls, success=False)
    with NodeGroup([driver], context):
        wait_for_stops(buttons, '/linear_guide/stop', '/tendon_actuator/stop')
        with pytest.raises(TactileError, match='not confirmed by tendon_actuator; bring the rig'):
            asyncio.run(buttons.stop())


def test_stop_ends_a_session_of_another_process_between_two_trials(context, buttons):
    operator = OperatorNode(context)
    with NodeGroup([operator], context):
        wait_for_stops(buttons, '/operator/stop')
        assert asyncio.run(buttons.stop()) == 'stop: confirmed by operator'
        with pytest.raises(StoppedError):
            operator.home_guide()
    # The session has ended, so there is nothing left to stop.
    with pytest.raises(TactileError, match='no node was found'):
        asyncio.run(buttons.stop())


def test_stop_fails_if_a_known_driver_has_ended(context, buttons, monkeypatch):
    monkeypatch.setattr(controls, 'ANSWER_TIMEOUT_S', 0.5)
    driver = Node('driver', context=context)
    offer_stop(driver, '/linear_guide/stop', [])
    with NodeGroup([driver], context):
        wait_for_stops(buttons, '/linear_guide/stop')
    with pytest.raises(TactileError, match='not confirmed by linear_guide; bring'):
        asyncio.run(buttons.stop())
    # The client of the first page keeps the service in the ROS graph, so a second page lists it.
    late = WatchNode(WatchState(), context)
    with NodeGroup([late], context):
        wait_until(late.stop_clients)
        with pytest.raises(TactileError, match='no node was found'):
            asyncio.run(WatchControls(late, context).stop())


def test_release_and_reset_reach_all_fingers_and_report_refusals(context, buttons):
    calls, driver = [], Node('driver', context=context)
    paths = ['/linear_guide/reset', '/left/tendon_actuator/reset', '/left/tendon_actuator/release']
    for path in paths:
        offer_stop(driver, path, calls)
    with NodeGroup([driver], context):
        wait_for_stops(buttons, *paths)
        assert asyncio.run(buttons.release()) == 'release: done by left/tendon_actuator'
        assert calls == paths[2:]
        said = asyncio.run(buttons.reset()).removeprefix('reset: done by ').split(', ')
        assert sorted(said) == ['left/tendon_actuator', 'linear_guide']
        assert sorted(calls) == sorted(paths)
        refusal = 'The emergency stop is pressed; release it.'
        offer_stop(driver, '/trial_runner/reset', calls, success=False, message=refusal)
        wait_for_stops(buttons, '/trial_runner/reset')
        with pytest.raises(TactileError, match=f'reset: trial_runner: {refusal}'):
            asyncio.run(buttons.reset())


def test_release_fails_if_there_is_no_tendon_actuator(buttons):
    with pytest.raises(TactileError, match='release: no node'):
        asyncio.run(buttons.release())
