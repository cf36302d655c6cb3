# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Trials that end early, on devices that a test can take away."""

from dataclasses import dataclass
import threading
import time

import pytest
from rclpy.action import ActionClient
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from tactile_bringup.nodes.trial_runner_node import TrialRunnerNode
from tactile_msgs.action import MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.goals import GoalAborted, GoalRunner
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, STREAM
from tactile_ros.requests import send

DEADLINE_S = 10.0


@dataclass(frozen=True)
class NoConfig:
    pass


class Device(TactileNode):
    """A device whose goals end at once, unless told to wait for a cancel or a stop."""

    def __init__(self, name, action_type, verb, **options):
        super().__init__(name, NoConfig, **options)
        self.goals = []
        self.waits_in = ()  # numbers of the goals that wait, from 1
        self.fails_in = ()
        self.stopped = threading.Event()
        self._type = action_type
        self._runner = GoalRunner(self, action_type, f'~/{verb}', self._work)
        self.create_service(Trigger, '~/stop', self._on_stop)
        self.states = self.create_publisher(JointState, '~/joint_states', STREAM)

    def _work(self, goal):
        self.goals.append(goal.request)
        if len(self.goals) in self.waits_in:
            while not goal.wait(0.01) and not self.stopped.is_set():
                pass
            goal.check()
        if len(self.goals) in self.fails_in:
            raise GoalAborted('the servo was silent')
        return self._type.Result(message='ended')

    def _on_stop(self, _, response):
        self.stopped.set()
        response.success = True
        return response

    def tear_down(self):
        self._runner.close()


class Bench:
    def __init__(self, context):
        self.guide = Device('linear_guide', MoveGuide, 'move', context=context)
        self.tendon = Device('tendon_actuator', PullTendon, 'pull', context=context)
        self.runner = TrialRunnerNode(
            context=context,
            parameter_overrides=[
                Parameter('server_timeout_s', value=1.0),
                Parameter('settle_s', value=0.0),
            ],
        )
        assert self.runner.bring_up()
        self.client = Node('client', context=context)
        self.phases = []
        self.client.create_subscription(
            TrialEvent, 'trial_runner/events', lambda e: self.phases.append(e.phase), EVENTS
        )
        self.action = ActionClient(self.client, RunTrial, 'trial_runner/run_trial')
        # Each on an executor of its own, as in processes of their own.
        self.groups = {
            node: NodeGroup([node], context=context)
            for node in (self.guide, self.tendon, self.runner, self.client)
        }
        for group in self.groups.values():
            group.__enter__()
        for client in (self.action, self.runner._guide, self.runner._tendon):
            assert client.wait_for_server(timeout_sec=DEADLINE_S)
        wait_until(lambda: self.tendon.states.get_subscription_count() == 1)

    def start(self, protocol):
        goal = RunTrial.Goal(protocol=protocol, contact='flexion', hold_s=100.0)
        return send(self.client, lambda: self.action.send_goal_async(goal)).result(DEADLINE_S)

    def end(self, handle):
        return send(self.client, handle.get_result_async).result(DEADLINE_S).result.message

    def publish_tendon(self, displacement_m):
        self.tendon.states.publish(JointState(position=[displacement_m]))

    def close(self):
        for group in reversed(self.groups.values()):
            group.close()


@pytest.fixture
def bench(context):
    bench = Bench(context)
    yield bench
    bench.close()


def wait_until(condition):
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, 'condition not met in time'
        time.sleep(0.005)


def test_slip_is_refused_before_anything_moves(bench):
    message = bench.end(bench.start('slip'))
    assert 'nothing on it pulls the object' in message
    assert 'tactile simulate slip' in message
    assert (bench.guide.goals, bench.tendon.goals, bench.phases) == ([], [], [])


def test_a_device_that_goes_away_ends_the_trial(bench):
    bench.guide.waits_in = (1,)
    handle = bench.start('stiffness')
    wait_until(lambda: bench.guide.goals)
    # The result of the goal is never told, as when the process is killed.
    bench.guide._runner._server.destroy()
    message = bench.end(handle)
    assert 'the linear guide went away' in message
    wait_until(lambda: bench.tendon.goals and bench.tendon.goals[-1].displacement_m == 0.0)


def test_a_device_that_ignores_a_cancel_does_not_keep_the_trial(bench):
    stuck = threading.Event()
    bench.guide._runner._work = lambda goal: stuck.wait(DEADLINE_S) and MoveGuide.Result()
    handle = bench.start('stiffness')
    wait_until(lambda: bench.guide._runner.is_busy)
    send(bench.client, handle.cancel_goal_async).result(DEADLINE_S)
    assert bench.end(handle).endswith('cancelled')
    assert bench.phases[-1] == 'aborted'
    stuck.set()


@pytest.mark.parametrize('protocol', ['texture', 'stiffness'])
def test_a_tendon_that_is_let_go_in_contact_ends_the_trial(bench, protocol):
    bench.guide.waits_in = (2,)  # the glide
    handle = bench.start(protocol)
    wait_until(lambda: bench.phases and bench.phases[-1] in ('glide', 'hold'))
    bench.publish_tendon(0.001)  # measured before the pull ended
    bench.publish_tendon(0.0058)
    bench.publish_tendon(0.0040)  # the load yields
    bench.publish_tendon(0.0020)
    assert 'has let the tendon go' in bench.end(handle)
    assert bench.tendon.goals[-1].displacement_m == 0.0


def test_a_release_that_fails_is_tried_again(bench):
    bench.tendon.fails_in = (1, 2, 3)  # the pull and two releases
    assert 'the servo was silent' in bench.end(bench.start('stiffness'))
    assert [goal.displacement_m > 0 for goal in bench.tendon.goals] == [True] + 3 * [False]


def test_shutdown_in_a_glide_stops_the_devices_and_releases_the_tendon(bench):
    bench.guide.waits_in = (2,)
    bench.start('texture')
    wait_until(lambda: bench.phases and bench.phases[-1] == 'glide')
    done = threading.Event()

    def shut_down():  # as the lifecycle service does: on the node's executor
        bench.runner.trigger_shutdown()
        done.set()

    bench.runner.executor.create_task(shut_down)
    assert bench.guide.stopped.wait(DEADLINE_S)
    assert done.wait(DEADLINE_S)
    wait_until(lambda: bench.tendon.goals[-1].displacement_m == 0.0)


def test_a_second_life_of_the_trial_runner_works_like_the_first(bench):
    bench.guide.waits_in = (1, 2)
    for _ in range(2):
        bench.guide.stopped.clear()
        handle = bench.start('stiffness')
        wait_until(lambda: bench.guide._runner.is_busy)
        bench.runner.trigger_deactivate()
        assert bench.end(handle).endswith('cancelled')
        wait_until(lambda: not bench.runner.goal_runners[0].is_busy)
        for transition in ('cleanup', 'configure', 'activate'):
            result = getattr(bench.runner, f'trigger_{transition}')()
            assert result == TransitionCallbackReturn.SUCCESS
        assert len(bench.runner.goal_runners) == 1
        assert len(bench.runner._managed_entities) == 1
        for client in (bench.action, bench.runner._guide, bench.runner._tendon):
            assert client.wait_for_server(timeout_sec=DEADLINE_S)
