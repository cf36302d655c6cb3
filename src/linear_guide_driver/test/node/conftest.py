# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import concurrent.futures
import os
from pathlib import Path
import subprocess
import threading

from action_msgs.msg import GoalStatus
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from dynamixel_sdk import port_handler
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from topic_peers import Peers

from tactile_ros.rclpy_internals import ActionClient, Executor
from tactile_testing.requests import send
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


class Bench:
    """The node under test and a second node that communicates with it, spun on a thread."""

    def __init__(self, context):
        self.context = context
        self.executor = Executor(context=context)
        self.peer = Node('peer', context=context)
        self.executor.add_node(self.peer)
        self.node = None
        self.feedback = []
        self._clients = {}
        self._error = None
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def _spin(self):
        try:
            self.executor.spin()
        except Exception as error:
            self._error = error
            raise

    def start(self, node_class, **parameters):
        self.node = self.make(node_class, **parameters)
        assert self.node.bring_up()
        self.executor.add_node(self.node)
        self._thread.start()

    def make(self, node_class, **parameters):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return node_class(context=self.context, parameter_overrides=overrides)

    def ask(self, request):
        try:
            return send(self.peer, request).result(DEADLINE_S)
        except concurrent.futures.TimeoutError:
            state = 'spins' if self._thread.is_alive() else f'has ended: {self._error!r}'
            raise AssertionError(f'no answer in {DEADLINE_S} s; the executor {state}') from None

    def send(self, action_type, name, **fields):
        client = self._clients.get(name) or self.make_client(action_type, name)
        assert client.wait_for_server(timeout_sec=DEADLINE_S)
        goal = action_type.Goal(**fields)
        return self.ask(
            lambda: client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        )

    def make_client(self, action_type, name):
        """Create an action client on the executor's thread.

        On another thread, the executor could use the client before it is complete.
        """

        def make():
            self._clients[name] = ActionClient(self.peer, action_type, name)

        task = self.executor.create_task(make)
        wait_until(task.done)
        return self._clients[name]

    def result(self, handle):
        reply = self.ask(handle.get_result_async)
        names = {
            GoalStatus.STATUS_SUCCEEDED: 'succeeded',
            GoalStatus.STATUS_CANCELED: 'canceled',
            GoalStatus.STATUS_ABORTED: 'aborted',
        }
        return names[reply.status], reply.result

    def aborts(self, handle, words):
        """Check that a goal is aborted and its message contains ``words``; return it."""
        status, result = self.result(handle)
        assert (status, words in result.message) == ('aborted', True), result.message
        return result.message

    def call(self, name):
        """Return the response of a trigger service."""
        client = self.peer.create_client(Trigger, name)
        assert client.wait_for_service(timeout_sec=DEADLINE_S)
        return self.ask(lambda: client.call_async(Trigger.Request()))

    def stop_clock(self):
        """Let the node take its time from a clock that does not advance."""
        clock = self.peer.create_publisher(Clock, '/clock', 1)
        self.node.set_parameters([Parameter('use_sim_time', value=True)])
        wait_until(lambda: clock.get_subscription_count() == 1)
        clock.publish(Clock())

    def close(self):
        self.executor.shutdown()
        if self._thread.is_alive():
            self._thread.join(5.0)
        if self.node is not None:
            self.node.take_down()
        self.peer.destroy_node()


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Increase the timeout for the servo's answers, because its thread may wait for a core."""
    monkeypatch.setattr(port_handler, 'LATENCY_TIMER', 100)


@pytest.fixture
def bench(context):
    bench = Bench(context)
    yield bench
    bench.close()


@pytest.fixture
def peers(bench):
    with Peers(bench) as peers:
        yield peers


@pytest.fixture
def diagnostics(bench):
    """Return a list to which each diagnostic status of the running node is appended."""
    statuses = []
    bench.peer.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: statuses.append(message.status[0]), 10
    )
    wait_until(bench.node._diagnostics._publisher.get_subscription_count)
    return statuses


@pytest.fixture
def start_driver(bench, servo):
    """Return a function that starts the tendon driver. Its argument has options of Popen."""
    program = Path(
        get_package_prefix('linear_guide_driver'), 'lib/linear_guide_driver/tendon_actuator_node'
    )
    processes = []

    def start(popen=None, **parameters):
        values = {'port': servo.port, **parameters}
        words = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(bench.context.get_domain_id())}
        command = [program, '--ros-args', *words]
        processes.append(subprocess.Popen(command, env=environment, **(popen or {})))
        return processes[-1]

    bench._thread.start()
    yield start
    for process in processes:
        process.kill()
        process.wait()
