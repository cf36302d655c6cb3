# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trial runner with devices that the test can remove, delay or degrade."""

from dataclasses import dataclass
import os
from pathlib import Path
import subprocess
import time

from ament_index_python.packages import get_package_prefix
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from sensor_msgs.msg import JointState

from tactile_bringup.nodes.trial_runner_node import TrialRunnerNode
from tactile_msgs.action import MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import Readiness, StrainBlock, TrialEvent
from tactile_ros.goal_client import GoalClient
from tactile_ros.goals import GoalAborted, GoalRunner
from tactile_ros.health import Heartbeat, Presence
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, LATEST, STREAM
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0
START_S = 60.0
"""Longest time to wait for the start of a process, for a busy computer [s]."""
PERIOD_S = 0.01
SERVER_TIMEOUT_S = 1.0
SILENCE_S = 0.8  # longer than the default, because a busy computer may delay a node that long


@dataclass(frozen=True)
class NoConfig:
    pass


@dataclass(frozen=True)
class Motion:
    """A motion as a function of time, so that a late report contains the position at its stamp."""

    start_m: float
    target_m: float
    speed_m_s: float
    began_ns: int
    pause_s: float  # pause half way [s]

    def at(self, now_ns):
        """Return the position [m] and the speed [m/s], which is 0 only at the target."""
        duration_s = abs(self.target_m - self.start_m) / self.speed_m_s
        elapsed_s = (now_ns - self.began_ns) / 1e9
        elapsed_s -= min(self.pause_s, max(0.0, elapsed_s - duration_s / 2))
        if elapsed_s >= duration_s:
            return self.target_m, 0.0
        share = elapsed_s / duration_s
        return self.start_m + share * (self.target_m - self.start_m), self.speed_m_s


class Device(TactileNode):
    """A device that executes its goals, unless the test changes its behaviour.

    The attributes refer to the numbers of goals, from 1. Goals in ``waits_in`` wait until they are
    cancelled, and goals in ``fails_in`` fail, both without a motion. The following are mappings
    from numbers: ``delays`` before a motion [s], ``pauses`` half way [s], and ``slowness``, the
    factor by which a motion takes longer. ``rest_period_s`` is the period of the joint states at
    rest.
    """

    def __init__(self, name, action_type, verb, **options):
        super().__init__(name, NoConfig, **options)
        self.goals = []
        self.waits_in = ()
        self.fails_in = ()
        self.delays = {}
        self.pauses = {}
        self.slowness = {}
        self.moved_at_ns = {}
        self.rested_at_ns = []  # stamps of joint states at rest, except at position 0
        self.rest_period_s = 0.0
        self._reported_s = time.monotonic()
        self.beats = True
        self.position_m = self.velocity_m_s = 0.0
        self._motion = None
        self._type = action_type
        self._runner = GoalRunner(self, action_type, f'~/{verb}', self._work)
        self.states = self.create_publisher(JointState, '~/joint_states', STREAM)
        self.heart = Heartbeat(self, lambda: self.beats)
        self._presence = Presence(self)
        self._timer = self.create_timer(PERIOD_S, self._report)
        self._ready = None

    def say_ready(self, *missing):
        if self._ready is None:
            self._ready = self.create_publisher(Readiness, '~/ready', LATEST)
        self._ready.publish(Readiness(ready=not missing, missing=list(missing)))

    def _report(self):
        now, motion = self.get_clock().now(), self._motion
        if motion is not None:
            self.position_m, self.velocity_m_s = motion.at(now.nanoseconds)
        is_due = time.monotonic() >= self._reported_s + self.rest_period_s
        if motion is not None or self.position_m != 0.0 or is_due:
            self._reported_s = time.monotonic()
            self.publish(now)
        self.heart.beat()
        if motion is not None and self.velocity_m_s == 0.0:
            self._motion = None

    def publish(self, now):
        state = JointState(position=[self.position_m], velocity=[self.velocity_m_s])
        state.header.stamp = now.to_msg()
        self.states.publish(state)
        if self.position_m > 0.0 and self.velocity_m_s == 0.0:
            self.rested_at_ns.append(now.nanoseconds)

    def _work(self, goal):
        self.goals.append(goal.request)
        number = len(self.goals)
        if number in self.waits_in:
            while not goal.wait(PERIOD_S):
                pass
            goal.check()
        if number in self.fails_in:
            raise GoalAborted('the servo was silent')
        goal.wait(self.delays.get(number, 0.0))
        goal.check()
        self._move(goal, number)
        rest = {'position_m': self.position_m} if self._type is MoveGuide else {}
        return self._type.Result(message='ended', **rest)

    def _move(self, goal, number):
        request = goal.request
        target_m = getattr(request, 'position_m', getattr(request, 'displacement_m', 0.0))
        speed_m_s = request.speed_m_s / self.slowness.get(number, 1.0)
        self.moved_at_ns[number] = began_ns = self.get_clock().now().nanoseconds
        pause_s = self.pauses.get(number, 0.0)
        self._motion = Motion(self.position_m, target_m, speed_m_s, began_ns, pause_s)
        try:
            while self._motion is not None:
                goal.wait(PERIOD_S)
                goal.check()
        finally:
            self._motion = None

    def tear_down(self):
        self._presence.close()
        self._runner.close()


class Sensor(Node):
    def __init__(self, context):
        super().__init__('tendon_sensor', context=context)
        self.is_alive = True
        self.status = 0
        self._publisher = self.create_publisher(StrainBlock, '~/strain', STREAM)
        self._timer = self.create_timer(PERIOD_S, self._publish)

    def _publish(self):
        if self.is_alive:
            self._publisher.publish(StrainBlock(tension_n=[1.0], status=self.status))


class Bench:
    """Simulated devices, a simulated sensor and the trial runner, each on a separate executor.

    If ``is_apart`` is True, the runner is a separate process, which the test can stop.
    """

    def __init__(self, context, *, is_apart=False):
        self.guide = Device('linear_guide', MoveGuide, 'move', context=context)
        self.tendon = Device('tendon_actuator', PullTendon, 'pull', context=context)
        self.sensor = Sensor(context)
        values = {
            'server_timeout_s': SERVER_TIMEOUT_S,
            'heartbeat_timeout_s': SILENCE_S,
            'settle_s': 0.0,
            'guide_start_m': 0.01,
            'glide_length_m': 0.0105,
            'approach_speed_m_s': 0.2,
            'pull_speed_m_s': 0.03,
        }
        self.runner = self.process = None
        if is_apart:
            self.process = start_runner(context.get_domain_id(), values)
        else:
            self.runner = TrialRunnerNode(
                context=context,
                parameter_overrides=[Parameter(name, value=v) for name, v in values.items()],
            )
            assert self.runner.bring_up()
        self.client = Node('client', context=context)
        self.events = []
        self.readiness = []
        self.client.create_subscription(
            TrialEvent, 'trial_runner/events', self.events.append, EVENTS
        )
        self.client.create_subscription(
            Readiness, 'trial_runner/ready', self.readiness.append, LATEST
        )
        self.action = GoalClient(self.client, RunTrial, 'trial_runner/run_trial')
        self.groups = {
            node: NodeGroup([node], context=context)
            for node in (self.guide, self.tendon, self.sensor, self.runner, self.client)
            if node is not None
        }
        for group in self.groups.values():
            group.__enter__()
        assert self.action.wait_for_server(START_S)
        if is_apart:  # wait until the runner has discovered the devices
            wait_until(lambda: self.readiness and self.readiness[-1].ready, timeout_s=START_S)

    @property
    def phases(self):
        return [event.phase for event in self.events]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
        for group in reversed(self.groups.values()):
            group.close()
        self.action.close()

    def touch(self, protocol):
        """Start a trial, and wait until it is in contact.

        The trial then stays in the phase ``hold`` (stiffness) or before its glide (texture).
        """
        self.guide.waits_in = (2,) if protocol == 'texture' else ()
        goal = self.start(protocol)
        wait_until(
            lambda: len(self.guide.goals) == 2 or {'hold', 'aborted'} & {*self.phases},
            lambda: self.events,
        )
        assert 'aborted' not in self.phases, self.events[-1].message
        return goal

    def start(self, protocol, hold_s=100.0):
        goal = RunTrial.Goal(protocol=protocol, contact='flexion', hold_s=hold_s)
        sent = self.action.send(goal)
        assert sent.taken.result(DEADLINE_S)
        return sent

    def end(self, goal):
        return goal.end.result(DEADLINE_S).result

    def wait_for_phase(self, phase):
        wait_until(lambda: phase in self.phases)

    def wait_until_released(self):
        wait_until(lambda: self.tendon.goals and self.tendon.goals[-1].displacement_m == 0.0)
        wait_until(lambda: self.tendon.position_m == 0.0)


def start_runner(domain_id, values):
    """Start the trial runner in a new process, with these parameters."""
    program = Path(get_package_prefix('tactile_bringup'), 'lib/tactile_bringup/trial_runner_node')
    parameters = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
    return subprocess.Popen(
        [program, '--ros-args', *parameters],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)},
    )


def stamp_ns(event):
    return Time.from_msg(event.header.stamp).nanoseconds
