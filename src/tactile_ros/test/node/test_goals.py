# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import dataclass
import threading

from action_msgs.msg import GoalStatus
import pytest
from rclpy.action import ActionClient
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node

from tactile_msgs.action import MoveGuide
from tactile_ros.goals import GoalAborted, GoalRunner, send
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


@dataclass(frozen=True)
class NoConfig:
    pass


class Server(TactileNode):
    def __init__(self, work, **options):
        super().__init__('server', NoConfig, **options)
        self.refusal = ''
        self.runner = GoalRunner(
            self,
            MoveGuide,
            '~/move',
            work,
            accepting=lambda: self.refusal,
            preempts=lambda request: request.position_m == 0.0,
        )

    def tear_down(self):
        self.runner.close()


class Client:
    """Blocking calls from the test's thread."""

    def __init__(self, node):
        self.node = node
        self.client = ActionClient(node, MoveGuide, 'server/move')
        self.feedback = []

    def ask(self, request):
        return send(self.node, request).result(DEADLINE_S)

    def send(self, position_m=0.1):
        assert self.client.wait_for_server(timeout_sec=DEADLINE_S)
        goal = MoveGuide.Goal(position_m=position_m)
        handle = self.ask(
            lambda: self.client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        )
        assert handle.accepted
        return handle

    def result(self, handle):
        reply = self.ask(handle.get_result_async)
        return reply.status, reply.result


@pytest.fixture
def rig(context):
    """Return a function that runs a server with this work and gives it with a client."""
    groups = []

    def make(work):
        server = Server(work, context=context)
        node = Node('client', context=context)
        client = Client(node)
        group = NodeGroup([node, server], context=context)
        group.__enter__()
        groups.append(group)
        return server, client

    yield make
    for group in groups:
        group.close()


def test_goal_succeeds_with_feedback(rig):
    def work(goal):
        goal.feedback(position_m=goal.request.position_m / 2)
        return MoveGuide.Result(message='there', position_m=goal.request.position_m)

    _, client = rig(work)
    status, result = client.result(client.send(0.2))
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (result.message, result.position_m) == ('there', 0.2)
    wait_until(lambda: client.feedback)
    assert client.feedback[0].position_m == 0.1


def test_executor_is_free_while_a_goal_works(rig):
    release = threading.Event()

    def work(goal):
        assert release.wait(DEADLINE_S)
        return MoveGuide.Result()

    server, client = rig(work)
    ticks = []
    server.create_timer(0.01, lambda: ticks.append(1))
    handle = client.send()
    wait_until(lambda: len(ticks) > 5)
    release.set()
    assert client.result(handle)[0] == GoalStatus.STATUS_SUCCEEDED


def test_abort_and_error_carry_their_message(rig):
    def work(goal):
        if goal.request.position_m > 0.5:
            raise GoalAborted('too far', position_m=0.25)
        raise RuntimeError('cable cut')

    _, client = rig(work)
    for position_m, message, reached_m in ((0.9, 'too far', 0.25), (0.1, 'cable cut', 0.0)):
        status, result = client.result(client.send(position_m))
        assert status == GoalStatus.STATUS_ABORTED
        assert (result.message, result.position_m) == (message, reached_m)


def test_cancel_reaches_the_worker_at_once(rig):
    def work(goal):
        assert goal.wait(DEADLINE_S)
        goal.check()
        return MoveGuide.Result()

    _, client = rig(work)
    handle = client.send()
    client.ask(handle.cancel_goal_async)
    status, result = client.result(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.message == 'cancelled'


def test_a_goal_that_fails_while_it_is_cancelled_counts_as_cancelled(rig):
    def work(goal):
        assert goal.wait(DEADLINE_S)
        raise GoalAborted('the motor has stopped')

    _, client = rig(work)
    handle = client.send()
    client.ask(handle.cancel_goal_async)
    status, result = client.result(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.message == 'the motor has stopped'


def test_a_goal_that_is_cancelled_while_it_waits_for_its_turn_ends_at_once(rig):
    release = threading.Event()

    def work(goal):
        if goal.request.position_m == 0.0:
            goal.check()
            return MoveGuide.Result(message='it worked all the same')
        release.wait(DEADLINE_S)
        return MoveGuide.Result()

    server, client = rig(work)
    first = client.send()
    wait_until(lambda: server.runner.is_busy)
    handle = client.send(0.0)
    client.ask(handle.cancel_goal_async)
    release.set()
    status, result = client.result(handle)
    assert (status, result.message) == (GoalStatus.STATUS_CANCELED, 'cancelled')
    assert client.result(first)[0] == GoalStatus.STATUS_SUCCEEDED


def test_second_goal_is_aborted_and_the_first_goes_on(rig):
    release = threading.Event()

    def work(goal):
        release.wait(DEADLINE_S)
        return MoveGuide.Result(message='first')

    server, client = rig(work)
    first = client.send()
    wait_until(lambda: server.runner.is_busy)
    status, result = client.result(client.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert 'another goal' in result.message
    release.set()
    assert client.result(first)[1].message == 'first'
    assert client.result(client.send())[1].message == 'first'


def test_goal_that_is_not_accepted_says_why(rig):
    server, client = rig(lambda goal: MoveGuide.Result())
    server.refusal = 'home the guide first'
    status, result = client.result(client.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message == 'home the guide first'


def test_closing_the_group_still_tells_the_client_how_its_goal_ended(rig, context):
    """The client lives elsewhere, so its executor goes on."""

    def work(goal):
        goal.wait(DEADLINE_S)
        raise GoalAborted('came to rest')

    for _ in range(5):
        server = Server(work, context=context)
        node = Node('far_client', context=context)
        client = Client(node)
        with NodeGroup([node], context=context):
            with NodeGroup([server], context=context):
                handle = client.send()
                wait_until(lambda server=server: server.runner.is_busy)
                answer = send(node, handle.get_result_async)
                # Answered after it was asked: by then the server has the request above.
                assert client.result(client.send())[1].message == 'another goal is running'
            assert answer.result(DEADLINE_S).result.message == 'came to rest'


def test_a_node_forgets_a_closed_runner(context):
    server = Server(lambda goal: MoveGuide.Result(), context=context)
    assert server.goal_runners == [server.runner]
    server.take_down()
    assert server.goal_runners == []


def test_clean_up_waits_for_the_goal_to_end(rig):
    release = threading.Event()

    def work(goal):
        release.wait(DEADLINE_S)
        raise GoalAborted('came to rest')

    server, client = rig(work)
    assert server.bring_up()
    handle = client.send()
    wait_until(lambda: server.runner.is_busy)
    server.trigger_deactivate()
    assert server.trigger_cleanup() == TransitionCallbackReturn.FAILURE
    release.set()
    assert client.result(handle)[1].message == 'came to rest'
    wait_until(lambda: not server.runner.is_busy)
    assert server.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
