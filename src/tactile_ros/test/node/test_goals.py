# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import concurrent.futures
from dataclasses import make_dataclass
import threading

from action_msgs.msg import GoalStatus
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node

from tactile_msgs.action import MoveGuide
from tactile_ros.clock_watch import boot_time_s, ClockWatch
from tactile_ros.goals import GoalAborted, GoalRunner
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_ros.rclpy_internals import ActionClient
from tactile_ros.refusal import Refusal
from tactile_testing.requests import send
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0
NoConfig = make_dataclass('NoConfig', [], frozen=True)


class Server(TactileNode):
    def __init__(self, work, **options):
        super().__init__('server', NoConfig, **options)
        self.refusal = None
        self.slept_s = 0.0
        watch = ClockWatch(read_s=lambda: boot_time_s() + self.slept_s)
        self.runner = GoalRunner(
            self,
            MoveGuide,
            '~/move',
            work,
            find_refusal=lambda: self.refusal,
            preempts=lambda request: request.position_m == 0.0,
            watch=watch,
        )

    def tear_down(self):
        self.runner.close()


class Client:
    """An action client whose methods wait for the answer of the server."""

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
        """Return the status and the result of a goal.

        The result is requested again each second, as `GoalClient` does, because the middleware can
        lose an answer.
        """
        for _ in range(round(DEADLINE_S)):
            answer = send(self.node, handle.get_result_async)
            if concurrent.futures.wait([answer], 1.0).done:
                return answer.result().status, answer.result().result
        raise AssertionError('no answer to any request for the result')


@pytest.fixture
def rig(context, spun):
    """Return a function that starts an action server and a client and returns both.

    Its argument is the function that the server executes for each goal.
    """

    def make(work):
        server, client = Server(work, context=context), Client(Node('client', context=context))
        spun(client.node, server)
        return server, client

    return make


@pytest.fixture
def held_rig(rig):
    """Return a function that starts a server and a goal, which runs until ``release`` is set.

    After that, the server executes ``work`` for the goal.
    """

    def make(work=lambda goal: MoveGuide.Result(message='first')):
        release = threading.Event()

        def wait_and_work(goal):
            if goal.request.position_m == 0.1:
                assert release.wait(DEADLINE_S)
            return work(goal)

        server, client = rig(wait_and_work)
        handle = client.send()
        wait_until(lambda: server.runner.is_busy)
        return server, client, handle, release

    return make


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


def test_executor_is_free_while_a_goal_works(held_rig):
    server, client, handle, release = held_rig()
    ticks = []
    server.create_timer(0.01, lambda: ticks.append(1))
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


@pytest.mark.parametrize('message', ['cancelled', 'the motor has stopped'])
def test_cancel_reaches_the_worker_at_once_whatever_it_notices_first(rig, message):
    def work(goal):
        assert goal.wait(DEADLINE_S)
        if message != 'cancelled':
            raise GoalAborted(message)
        goal.check()

    _, client = rig(work)
    handle = client.send()
    client.ask(handle.cancel_goal_async)
    status, result = client.result(handle)
    assert (status, result.message) == (GoalStatus.STATUS_CANCELED, message)


def test_a_goal_that_is_cancelled_while_it_waits_for_its_turn_ends_at_once(held_rig):
    def work(goal):
        if goal.request.position_m == 0.0:
            goal.check()
        return MoveGuide.Result()

    _, client, first, release = held_rig(work)
    handle = client.send(0.0)
    client.ask(handle.cancel_goal_async)
    release.set()
    status, result = client.result(handle)
    assert (status, result.message) == (GoalStatus.STATUS_CANCELED, 'cancelled')
    assert client.result(first)[0] == GoalStatus.STATUS_SUCCEEDED


def test_second_goal_is_aborted_and_the_first_goes_on(held_rig):
    _, client, first, release = held_rig()
    status, result = client.result(client.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message
    release.set()
    assert client.result(first)[1].message == 'first'
    assert client.result(client.send())[1].message == 'first'


def test_goal_that_is_not_accepted_says_why(rig):
    server, client = rig(lambda goal: MoveGuide.Result())
    server.refusal = Refusal('The guide is not homed', 'home it first')
    status, result = client.result(client.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message == str(server.refusal)


def test_closing_the_group_still_tells_the_client_how_its_goal_ended(rig, context):
    """The executor of the client keeps running, as if the client were in another process."""

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
                # The server handles requests in order. After the answer to this goal, it has
                # also received the request for the result of the first goal.
                assert client.result(client.send())[1].message.startswith(
                    'Another goal is running;'
                )
            assert answer.result(DEADLINE_S).result.message == 'came to rest'


def test_clean_up_waits_for_the_goal_to_end(held_rig):
    def work(goal):
        raise GoalAborted('came to rest')

    server, client, handle, release = held_rig(work)
    assert server.bring_up()
    server.trigger_deactivate()
    assert server.trigger_cleanup() == TransitionCallbackReturn.FAILURE
    release.set()
    assert client.result(handle)[1].message == 'came to rest'
    wait_until(lambda: not server.runner.is_busy)
    assert server.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    assert server.goal_runners == []


def test_a_goal_ends_when_the_computer_was_suspended(rig):
    def work(goal):
        assert goal.wait(DEADLINE_S)
        goal.check()

    server, client = rig(work)
    handle = client.send()
    wait_until(lambda: server.runner.is_busy)
    server.slept_s = 30.0
    status, result = client.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert '30.' in result.message


def test_a_goal_that_may_have_waited_for_long_is_not_begun(rig):
    begun = []

    def work(goal):
        begun.append(goal.request.position_m)
        return MoveGuide.Result(message='there')

    server, client = rig(work)
    server.slept_s = 30.0
    status, _ = client.result(client.send())
    assert (status, begun) == (GoalStatus.STATUS_ABORTED, [])
    # A goal with position 0 preempts other goals, so it is accepted even after a standstill.
    assert client.result(client.send(0.0))[1].message == 'there'
    wait_until(lambda: client.result(client.send())[1].message == 'there')
    assert client.result(client.send())[1].message == 'there'


def test_a_goal_that_preempts_goes_on_after_a_suspend(rig):
    release = threading.Event()

    def work(goal):
        assert release.wait(DEADLINE_S)
        goal.check()
        return MoveGuide.Result(message='slack')

    server, client = rig(work)
    handle = client.send(0.0)
    wait_until(lambda: server.runner.is_busy)
    server.slept_s = 30.0
    release.set()
    assert client.result(handle)[1].message == 'slack'
