# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A client of an action to which answers are lost, because the server has not discovered it."""

from dataclasses import make_dataclass
import threading

from action_msgs.msg import GoalStatus
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_msgs.action import MoveGuide
from tactile_ros import goal_client
from tactile_ros.goal_client import call_until_answered, GoalClient, GoalLostError
from tactile_ros.goals import GoalAborted, GoalRunner
from tactile_ros.lifecycle import TactileNode
from tactile_ros.rclpy_internals import ActionClient, GoalIdClient
from tactile_testing.waiting import wait_until

DEADLINE_S = 20.0
NoConfig = make_dataclass('NoConfig', [], frozen=True)


class Server(TactileNode):
    def __init__(self, work, **options):
        super().__init__('server', NoConfig, **options)
        self.count = 0
        self.requests = 0
        self.lost_requests = 0

        def count_and_work(goal):
            self.count += 1
            return work(goal)

        self.runner = GoalRunner(self, MoveGuide, '~/move', count_and_work)
        self.create_service(Trigger, '~/stop', self._on_stop)

    def _on_stop(self, _, response):
        self.requests += 1
        response.success = True
        return response

    def tear_down(self):
        self.runner.close()


@pytest.fixture
def losses(monkeypatch):
    """Return a dict in which a test sets the number of answers of each kind that get lost."""
    losses = {'goal': 0, 'result': 0, 'cancel': 0}
    take_data = GoalIdClient.take_data

    def take_data_in_part(client):
        data = take_data(client)
        for kind in losses:
            if kind in data and losses[kind]:
                losses[kind] -= 1
                del data[kind]
        return data

    monkeypatch.setattr(GoalIdClient, 'take_data', take_data_in_part)
    monkeypatch.setattr(goal_client, 'LOOK_S', 0.1)
    return losses


@pytest.fixture
def rig(context, spun):
    """Return a function that starts an action server and a client and returns both.

    Its argument is the function that the server executes for each goal.
    """
    clients = []

    def make(work=lambda goal: MoveGuide.Result(message='there')):
        server, node = Server(work, context=context), Node('client', context=context)
        client = GoalClient(node, MoveGuide, 'server/move')
        clients.append(client)
        spun(node)
        spun(server)
        assert client.wait_for_server(DEADLINE_S)
        return server, client

    yield make
    for client in clients:
        client.close()


def end_of(goal):
    reply = goal.end.result(DEADLINE_S)
    return reply.status, reply.result.message


def until_ended(goal):
    """Execute a goal that lasts until its cancellation."""
    assert goal.wait(DEADLINE_S)
    goal.check()


@pytest.mark.parametrize(
    'lost', [{}, {'goal': 1}, {'result': 1}, {'result': 5}, {'goal': 1, 'result': 3}]
)
def test_a_goal_ends_once_whatever_answers_get_lost(rig, losses, lost):
    server, client = rig()
    losses.update(lost)
    goal = client.send(MoveGuide.Goal(position_m=0.1))
    assert goal.taken.result(DEADLINE_S)
    assert end_of(goal) == (GoalStatus.STATUS_SUCCEEDED, 'there')
    assert server.count == 1
    assert not any(losses.values())


def test_a_lasting_goal_is_known_to_be_taken_though_the_answer_was_lost(rig, losses):
    release = threading.Event()

    def work(goal):
        assert release.wait(DEADLINE_S)
        raise GoalAborted('too far')

    _, client = rig(work)
    losses['goal'] = 1
    goal = client.send(MoveGuide.Goal())
    assert goal.taken.result(DEADLINE_S)
    assert not goal.end.done()
    release.set()
    assert end_of(goal) == (GoalStatus.STATUS_ABORTED, 'too far')


def test_a_cancellation_reaches_a_goal_whose_answers_were_lost(rig, losses):
    _, client = rig(until_ended)
    losses.update(goal=1, cancel=2, result=1)
    goal = client.send(MoveGuide.Goal())
    goal.cancel()  # perhaps before the goal is sent
    assert end_of(goal) == (GoalStatus.STATUS_CANCELED, 'cancelled')


def test_a_server_that_goes_away_ends_the_wait(rig, monkeypatch):
    monkeypatch.setattr(goal_client, 'GONE_S', 0.3)
    server, client = rig(until_ended)
    goal = client.send(MoveGuide.Goal())
    wait_until(lambda: server.count)
    server.executor.create_task(server.runner.close)
    with pytest.raises(GoalLostError):
        goal.end.result(DEADLINE_S)


def test_a_server_that_was_started_again_does_not_know_the_goal(rig, monkeypatch, context, spun):
    monkeypatch.setattr(goal_client, 'ASK_S', 0.3)
    server, client = rig(until_ended)
    goal = client.send(MoveGuide.Goal())
    wait_until(lambda: server.count)
    server.executor.create_task(server.runner.close)
    spun(Server(until_ended, context=context))
    with pytest.raises(GoalLostError):
        goal.end.result(DEADLINE_S)


def test_a_goal_that_nobody_takes_is_given_up(rig, losses, monkeypatch):
    monkeypatch.setattr(goal_client, 'TAKE_S', 0.5)
    monkeypatch.setattr(GoalIdClient, 'take_data', lambda client: {})
    _, client = rig()
    goal = client.send(MoveGuide.Goal())
    assert goal.taken.result(DEADLINE_S) is False
    with pytest.raises(GoalLostError, match=r'0\.5 s'):
        goal.end.result(0)


def test_closing_a_client_ends_its_waits(rig):
    _, client = rig(until_ended)
    goal = client.send(MoveGuide.Goal())
    assert goal.taken.result(DEADLINE_S)
    client._node.executor.create_task(client.close)
    with pytest.raises(GoalLostError):
        goal.end.result(DEADLINE_S)


def test_a_client_whose_executor_has_ended_looks_no_more_and_raises_nothing(context):
    """An exception would end the periodic calls of all nodes in the process."""
    node = Node('client', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    client = GoalClient(node, MoveGuide, 'server/move')
    client.send(MoveGuide.Goal())
    executor.spin_once(timeout_sec=DEADLINE_S)
    executor.shutdown()
    client.look_soon()
    with pytest.raises(RuntimeError, match='shut down'):
        client.send(MoveGuide.Goal())
    client.close()
    node.destroy_node()


@pytest.fixture
def stop(rig, monkeypatch):
    """Return the server, and a function that calls its service ``stop`` and loses some answers."""
    server, client = rig()
    node = client._node
    service = node.create_client(Trigger, 'server/stop')
    assert service.wait_for_service(DEADLINE_S)
    monkeypatch.setattr(goal_client, 'REPEAT_S', 0.1)

    def call(lost, timeout_s):
        call_async = service.call_async

        def call_in_vain(request):
            nonlocal lost
            future = call_async(request)
            if lost:
                lost -= 1
                service.remove_pending_request(future)
            return future

        monkeypatch.setattr(service, 'call_async', call_in_vain)
        return call_until_answered(node, service, Trigger.Request(), timeout_s).result(DEADLINE_S)

    return server, call


@pytest.mark.parametrize('lost', [0, 2])
def test_a_call_is_repeated_until_it_is_answered(stop, lost):
    server, call = stop
    assert call(lost, DEADLINE_S).success
    assert server.requests == lost + 1


def test_a_call_without_answer_ends(stop):
    _, call = stop
    with pytest.raises(TimeoutError, match='server/stop'):
        call(1000, 0.5)


def test_an_executor_can_use_an_action_client_as_soon_as_it_is_added_to_the_node(context):
    """An executor on another thread can do this before the constructor returns."""

    class SpunNode(Node):
        def add_waitable(self, waitable):
            super().add_waitable(waitable)
            entities.append(waitable.get_num_entities())

    entities = []
    node = SpunNode('spun', context=context)
    ActionClient(node, MoveGuide, 'server/move')
    assert entities[-1].num_clients == 3
    node.destroy_node()
