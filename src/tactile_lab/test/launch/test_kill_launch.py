# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Kill or freeze each node of a rig during contact: all motion ends, and the tendon becomes slack.

If the environment variable TACTILE_KILLS is set to a file name, the measured times of each case
are appended to this file, as one line of JSON. docs/motion.md has them as a table."""

import contextlib
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import threading
import time

from domain_coordinator import domain_id
import pytest

from tactile_testing.simulated_rigs import advance_rig
from tactile_testing.waiting import wait_until

pytest.importorskip('launch', reason='launch comes with an ordinary ROS 2, not from PyPI')

from tactile_bringup.nodes.graph_runner import ros_context
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.msg import TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS
from tactile_sim.rig_process import SimulatedRig

DEADLINE_S = 90.0
WATCHED_S = 6.0
SLACK_M = 0.0006
STEP_M = 1e-6

FROZEN_S = 5.0
VICTIMS = {
    'sensor driver': ('tendon_sensor_node',),
    'guide driver': ('linear_guide_node',),
    'tendon driver': ('tendon_actuator_node',),
    'trial runner': ('trial_runner_node',),
    'tendon and sensor': ('tendon_actuator_node', 'tendon_sensor_node'),
}
FAULTS = {'killed': signal.SIGKILL, 'frozen': signal.SIGSTOP}
SCENES = {
    'texture': ('R1', TrialEvent.PHASE_GLIDE),
    'stiffness': ('rubber_shell', TrialEvent.PHASE_HOLD),
}


def children_of(pid):
    found = []
    for listing in Path(f'/proc/{pid}/task').glob('*/children'):
        for child in listing.read_text().split():
            found += [int(child), *children_of(int(child))]
    return found


def find_process(pid, executable):
    for child in children_of(pid):
        try:
            words = Path(f'/proc/{child}/cmdline').read_bytes().split(b'\0')
        except OSError:
            continue
        if any(word.endswith(executable.encode()) for word in words[:2]):
            return child
    return None


class LaunchedRig:
    """Run the launch file of a protocol in a separate process, with a simulated rig."""

    def __init__(self, protocol, log):
        if shutil.which('ros2') is None:
            pytest.skip('the command ros2 is not installed')
        self.rig = SimulatedRig(seed=3)
        self.rig.mount(protocol, SCENES[protocol][0], 'flexion')
        ports = self.rig.ports._asdict()
        self._domain = domain_id()
        domain = str(self._domain.__enter__())
        self._log = log.open('wb')
        self.process = subprocess.Popen(
            ['ros2', 'launch', 'tactile_bringup', f'{protocol}.launch.py', 'rig:=simulated']
            + [f'{name}_port:={port}' for name, port in ports.items()],
            env={**os.environ, 'ROS_DOMAIN_ID': domain},
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        self._context = ros_context(int(domain))
        self.operator = OperatorNode(self._context.__enter__())
        self.phases = []
        self.operator.create_subscription(
            TrialEvent, 'trial_runner/events', lambda m: self.phases.append(m.phase), EVENTS
        )
        self._group = NodeGroup([self.operator], context=self.operator.context)
        self._group.__enter__()

    def insist(self, ask):
        """Call ``ask`` until it succeeds, because a restarted node is not ready immediately."""
        problem = ''

        def is_granted():
            nonlocal problem
            try:
                ask()
            except TactileError as error:
                problem = str(error)
                return False
            return True

        wait_until(is_granted, lambda: problem)

    def close(self):
        self._group.close()
        self._context.__exit__(None, None, None)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise
        finally:
            self._log.close()
            self._domain.__exit__(None, None, None)


def watch(rig, resume):
    """Observe the rig, and return times since the call of this function [s].

    They are the end of the motion of guide and tendon, and the time at which the tendon was slack.
    ``resume`` is called after `FROZEN_S`; the rig is then observed for another `WATCHED_S`.
    """
    began_s, before = time.monotonic(), rig.truth()
    rest = {'guide_rest_s': 0.0, 'tighten_s': 0.0, 'slack_s': None}
    resumed = False
    while (passed_s := time.monotonic() - began_s) < FROZEN_S + WATCHED_S or not rest['slack_s']:
        assert passed_s < DEADLINE_S, f'the tendon is still taut: {before}'
        if passed_s >= FROZEN_S and not resumed:
            resume()
            resumed = True
        now = advance_rig(rig, 0.004)
        if abs(now['guide_position_m'] - before['guide_position_m']) > STEP_M:
            rest['guide_rest_s'] = passed_s
        if now['tendon_displacement_m'] - before['tendon_displacement_m'] > STEP_M:
            rest['tighten_s'] = passed_s
        if rest['slack_s'] is None and now['tendon_displacement_m'] < SLACK_M:
            rest['slack_s'] = passed_s
        before = now
    return rest


def send(processes, number):
    """Send a signal to the processes that are still running."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, number)


def run_until_killed(operator, request, problems):
    # Without the trial runner there is no result. The test may end before the operator times out.
    try:
        operator.run_trial(request)
    except (TactileError, RuntimeError) as error:
        problems.append(str(error))


@pytest.mark.parametrize('protocol', SCENES)
@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize('victim', VICTIMS)
def test_after_the_death_of_a_node_the_tendon_becomes_slack_and_the_next_trial_runs(
    tmp_path, protocol, fault, victim
):
    label, phase = SCENES[protocol]
    log = tmp_path / 'launch.log'
    launched = LaunchedRig(protocol, log)
    rig, operator = launched.rig, launched.operator
    request = TrialRequest(protocol, 'flexion', label)
    try:
        launched.insist(operator.home_guide)
        problems = []
        threading.Thread(
            target=run_until_killed, args=(operator, request, problems), daemon=True
        ).start()
        wait_until(
            lambda: phase in launched.phases,
            lambda: f'phases {launched.phases}, not {phase}: {problems}',
        )
        assert advance_rig(rig, 0.5)['tendon_displacement_m'] > 0.002
        victims = [find_process(launched.process.pid, node) for node in VICTIMS[victim]]
        send(victims, FAULTS[fault])
        rest = watch(rig, resume=lambda: send(victims, signal.SIGCONT))
        completed = TrialEvent.PHASE_DONE in launched.phases
        launched.phases.clear()
        again_s = time.monotonic()
        launched.insist(operator.home_guide)
        launched.insist(lambda: operator.run_trial(TrialRequest(protocol, 'flexion', label)))
        assert TrialEvent.PHASE_DONE in launched.phases
        rest['again_s'] = time.monotonic() - again_s
        code = launched.close()
        rest['slack_at_the_end'] = rig.truth()['tendon_displacement_m'] < SLACK_M
    except BaseException:
        launched.close()
        sys.stdout.write(log.read_text()[-6000:])
        raise
    finally:
        rig.close()
    if path := os.environ.get('TACTILE_KILLS'):
        row = {'victim': victim, 'fault': fault, 'phase': phase, 'completed': completed}
        with open(path, 'a') as file:
            file.write(json.dumps({**row, **rest, 'exit': code}) + '\n')
    assert (code, rest['slack_at_the_end'], completed) == (0, True, False)
