# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time until guide and tendon of the simulated rig stop after a fault, for each phase of a trial.

Each node and the commanding program run in separate processes. Positions are the true positions in
the simulated rig. Killed nodes are not restarted. The tendon counts as moving while it tightens;
the time until it is slack is reported separately.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import os
import subprocess
import sys
import time
from typing import Any, NamedTuple

from benchmarks.measuring import Report, Row
from tactile_sim.rig_process import SimulatedRig

WATCHED_S = 4.0
SAMPLE_S = 0.005
START_S = 40.0
GUIDE_STEP_M, TENDON_STEP_M = 4e-6, 16e-6
SLACK_M = 0.0006
HEARTBEAT_S = 0.04

NODES = {
    'guide': 'linear_guide_node',
    'tendon': 'tendon_actuator_node',
    'sensor': 'tendon_sensor_node',
}
PARAMETERS = {
    'guide': {
        'strain_timeout_s': 0.15,
        'heartbeat_topics': '[commander/heartbeat, tendon_actuator/heartbeat]',
    },
    'tendon': {'heartbeat_topics': '[commander/heartbeat, linear_guide/heartbeat]'},
    'sensor': {},
}
RUN_NODE = (
    'import sys; from tactile_ros.node_program import main; del sys.argv[0]; sys.exit(main())'
)

PULL = {'do': 'pull', 'displacement_m': 0.008, 'speed_m_s': 0.004}
SLACK = {'do': 'pull', 'displacement_m': 0.0, 'speed_m_s': 0.04}
CONTACT = {'do': 'pull', 'displacement_m': 0.004, 'speed_m_s': 0.02}
START = {'do': 'move', 'position_m': 0.06, 'speed_m_s': 0.1}


class Phase(NamedTuple):
    """Phase of a trial in which the fault occurs.

    ``before`` has the requests that are executed first. ``action`` is the request during which the
    fault occurs; without it, nothing moves at the time of the fault.
    """

    before: tuple[dict[str, Any], ...]
    action: dict[str, Any] | None


PHASES = {
    'approach': Phase((SLACK, START), {'do': 'move', 'position_m': 0.16, 'speed_m_s': 0.04}),
    'contact': Phase((SLACK, START), PULL),
    'glide': Phase(
        (SLACK, START, CONTACT),
        {'do': 'move', 'position_m': 0.1, 'speed_m_s': 0.015, 'allow_taut': True},
    ),
    'hold': Phase((SLACK, START, CONTACT), None),
}
FAULTS = (
    'kill guide driver',
    'kill tendon driver',
    'kill sensor driver',
    'kill commanding program',
    'cut guide cable',
    'cut tendon cable',
    'cut sensor cable',
)


class Program:
    """A child process that ends with its parent."""

    def __init__(self, arguments: list[str], domain: int, **options: Any) -> None:
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
        self.process = subprocess.Popen(
            [sys.executable, *arguments], env=environment, stderr=subprocess.DEVNULL, **options
        )

    def kill(self) -> None:
        """Kill the process like ``kill -9``; may be called twice."""
        self.process.kill()
        self.process.wait()


class Commander(Program):
    """The program that commands the rig, in a separate process; see `_command`."""

    def __init__(self, domain: int) -> None:
        super().__init__(
            ['-m', __name__],
            domain,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self.read()

    def start(self, request: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + '\n')

    def read(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def run(self, request: dict[str, Any]) -> None:
        for _ in range(3):  # a busy machine may miss a heartbeat
            self.start(request)
            answer = self.read()
            if answer == 'done':
                return
        raise RuntimeError(f'{request} ended with "{answer}"')


def run_rest(quick: bool) -> Report:
    """Cause each fault in each phase, and measure the time until the rig stops."""
    rows = []
    with SimulatedRig() as rig:
        for phase in ('glide', 'hold') if quick else PHASES:
            rows += [_measure(rig, phase, fault) for fault in FAULTS]
    return Report(
        'from a fault to rest [s]',
        '',
        'maximum of guide and tendon [s], from the true positions of the simulated rig; 0: the '
        'device did not move at the time of the fault',
        rows,
    )


def _measure(rig: SimulatedRig, phase: str, fault: str) -> Row:
    domain = 90 + os.getpid() % 10
    programs: dict[str, Program] = {}
    try:
        for name, executable in NODES.items():
            given = {'port': getattr(rig.ports, name), **PARAMETERS[name]}
            pairs = [f'{key}:={value}' for key, value in given.items()]
            arguments = [word for pair in pairs for word in ('-p', pair)]
            programs[name] = Program(
                ['-c', RUN_NODE, executable, '--ros-args', *arguments], domain
            )
        commander = Commander(domain)
        programs['commander'] = commander
        commander.run({'do': 'home'})
        for request in PHASES[phase].before:
            commander.run(request)
        if (action := PHASES[phase].action) is not None:
            commander.start(action)
            _wait_for_motion(rig)
        times = _watch(rig, _fault(rig, programs, fault))
    finally:
        for program in programs.values():
            program.kill()
        for device in rig.ports._fields:
            rig.fault(device, 'none')
    worst_s = max(times['guide'], times['tendon'])
    return Row(f'{phase}: {fault}', error=worst_s, more=times)


def _fault(rig: SimulatedRig, programs: dict[str, Program], fault: str) -> Callable[[], None]:
    verb, what, *_ = fault.split()
    if verb == 'cut':
        return lambda: rig.fault(what, 'unplug')
    return programs['commander' if what == 'commanding' else what].process.kill


def _positions(rig: SimulatedRig) -> tuple[float, float]:
    truth = rig.truth()
    return truth['guide_position_m'], truth['tendon_displacement_m']


def _wait_for_motion(rig: SimulatedRig) -> None:
    first, deadline_s = _positions(rig), time.monotonic() + 10.0
    while all(abs(a - b) < 5e-4 for a, b in zip(first, _positions(rig), strict=True)):
        if time.monotonic() > deadline_s:
            raise RuntimeError('no device started to move')
        time.sleep(SAMPLE_S)


def _watch(rig: SimulatedRig, cause: Callable[[], None]) -> dict[str, float]:
    """Cause a fault, and return how long after it the devices came to rest [s].

    ``guide`` is the time of the last motion of the guide, ``tendon`` the time at which the tendon
    was last tightened, and ``slack`` the time at which the tendon became slack. ``slack`` is -1 if
    the tendon stays taut.
    """
    guide_m, tendon_m = _positions(rig)
    cause()
    began_s = time.monotonic()
    times = {'guide': 0.0, 'tendon': 0.0, 'slack': -1.0}
    while (passed_s := time.monotonic() - began_s) < WATCHED_S:
        guide_now_m, tendon_now_m = _positions(rig)
        # Positions are compared with the position at the last detected motion and not with the
        # previous sample, so that slow motion is detected.
        if abs(guide_now_m - guide_m) >= GUIDE_STEP_M:
            times['guide'], guide_m = passed_s, guide_now_m
        if tendon_now_m - tendon_m >= TENDON_STEP_M:
            times['tendon'] = passed_s
        if abs(tendon_now_m - tendon_m) >= TENDON_STEP_M:
            tendon_m = tendon_now_m
        if tendon_now_m < SLACK_M:
            times['slack'] = passed_s if times['slack'] < 0.0 else times['slack']
        time.sleep(SAMPLE_S)
    return {name: round(value, 3) for name, value in times.items()}


def _command() -> None:
    """Execute requests from standard input (one line of JSON each), and print the results."""
    from action_msgs.msg import GoalStatus
    import rclpy

    from tactile_msgs.action import HomeGuide, MoveGuide, PullTendon
    from tactile_ros.goal_client import GoalClient
    from tactile_ros.health import Heartbeat
    from tactile_ros.node_group import NodeGroup

    rclpy.init()
    node = rclpy.create_node('commander')
    node.create_timer(HEARTBEAT_S, Heartbeat(node, lambda: True).beat)
    actions = {
        'home': (HomeGuide, GoalClient(node, HomeGuide, 'linear_guide/home')),
        'move': (MoveGuide, GoalClient(node, MoveGuide, 'linear_guide/move')),
        'pull': (PullTendon, GoalClient(node, PullTendon, 'tendon_actuator/pull')),
    }
    with NodeGroup([node]):
        for _, client in actions.values():
            client.wait_for_server(START_S)
        print('ready', flush=True)  # noqa: T201 - read by the parent process
        for line in sys.stdin:
            request = json.loads(line)
            action_type, client = actions[request.pop('do')]
            if action_type is PullTendon:
                request['contact'] = 'flexion'
            goal = action_type.Goal(**request)
            reply = client.send(goal).end.result(60.0)
            is_done = reply.status == GoalStatus.STATUS_SUCCEEDED
            print('done' if is_done else reply.result.message, flush=True)  # noqa: T201


if __name__ == '__main__':
    _command()
