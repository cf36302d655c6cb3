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

"""Trials on the simulated rig through every real part: serial lines, drivers, DDS."""

from contextlib import contextmanager
import time

import pytest
from rclpy.action import ActionClient
from rclpy.node import Node

from tactile_bringup.errors import BringupError
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_bringup.wiring.graph import Ports, rig_graph
from tactile_bringup.wiring.model_folder import find_models
from tactile_msgs.action import RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.qos import EVENTS
from tactile_ros.requests import send
from tactile_sim.rig_process import SimulatedRig

DEADLINE_S = 20.0


class Watcher(Node):
    """Keeps the trial events, and can send a goal without waiting for its end."""

    def __init__(self, context):
        super().__init__('watcher', context=context)
        self.events = []
        self.create_subscription(TrialEvent, 'trial_runner/events', self.events.append, EVENTS)
        self.client = ActionClient(self, RunTrial, 'trial_runner/run_trial')

    def phases(self):
        return [event.phase for event in self.events]

    def wait_for_phase(self, phase):
        deadline = time.monotonic() + DEADLINE_S
        while phase not in self.phases():
            assert time.monotonic() < deadline, f'{phase} never began; seen: {self.phases()}'
            time.sleep(0.005)

    def start_trial(self, protocol):
        assert self.client.wait_for_server(timeout_sec=DEADLINE_S)
        goal = RunTrial.Goal(protocol=protocol, contact='flexion', trial_id='t')
        return send(self, lambda: self.client.send_goal_async(goal)).result(DEADLINE_S)


@contextmanager
def running_rig(context, models=None):
    with SimulatedRig(seed=3) as rig:
        ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
        operator = OperatorNode(tuple(models or ()), context)
        watcher = Watcher(context)
        graph = rig_graph(ports, models or {}, {}, simulated=True)
        with running_graph(graph, context, others=[operator, watcher]) as nodes:
            yield rig, operator, watcher, nodes


def truth_at_rest(rig):
    """Wait until neither guide nor tendon move any more; return the rig's truth."""
    deadline = time.monotonic() + DEADLINE_S
    before = rig.truth()
    while True:
        time.sleep(0.1)
        after = rig.truth()
        keys = ('guide_position_m', 'tendon_displacement_m')
        if all(before[key] == after[key] for key in keys):
            return after
        assert time.monotonic() < deadline, 'the rig does not come to rest'
        before = after


def test_stiffness_trial_is_felt_and_named(context, trained):
    with running_rig(context, find_models(trained)) as (rig, operator, watcher, _):
        operator.home_guide()
        rig.mount('stiffness', 'none', 'flexion')
        request = TrialRequest('stiffness', 'flexion', 'none', 'first')
        assert operator.run_trial(request) == 'first'
        answer = operator.wait_for_answer('first')
        assert answer.label == 'none'
        assert answer.simulated
        watcher.wait_for_phase('done')  # the result may come before the event
        assert watcher.phases() == ['approach', 'contact', 'hold', 'release', 'done']
        assert {event.trial_id for event in watcher.events} == {'first'}
        assert truth_at_rest(rig)['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)


def test_guide_that_was_not_homed_ends_the_trial_with_a_sentence(context):
    with running_rig(context) as (rig, operator, watcher, _):
        rig.mount('texture', 'F', 'flexion')
        with pytest.raises(BringupError, match=r'(?i)home'):
            operator.run_trial(TrialRequest('texture', 'flexion'))
        watcher.wait_for_phase('aborted')
        assert watcher.phases() == ['approach', 'aborted']


def test_cancelled_glide_stops_the_guide_and_releases_the_tendon(context):
    with running_rig(context) as (rig, operator, watcher, _):
        operator.home_guide()
        rig.mount('texture', 'R1', 'flexion')
        handle = watcher.start_trial('texture')
        watcher.wait_for_phase('glide')
        send(watcher, handle.cancel_goal_async).result(DEADLINE_S)
        reply = send(watcher, handle.get_result_async).result(DEADLINE_S)
        assert reply.result.message == 'trial t ended in glide: cancelled'
        assert reply.result.trial_id == 't'
        watcher.wait_for_phase('aborted')
        truth = truth_at_rest(rig)
        assert truth['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)
        assert 0.059 < truth['guide_position_m'] < 0.120


def test_rig_that_dies_in_a_trial_aborts_it(context):
    with running_rig(context) as (rig, operator, watcher, _):
        operator.home_guide()
        rig.mount('stiffness', 'pla', 'flexion')
        handle = watcher.start_trial('stiffness')
        watcher.wait_for_phase('contact')
        rig.close()
        reply = send(watcher, handle.get_result_async).result(DEADLINE_S)
        assert 'ended in' in reply.result.message
        watcher.wait_for_phase('aborted')


def test_closing_the_graph_in_a_glide_brings_the_rig_to_rest(context):
    with SimulatedRig(seed=3) as rig:
        ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
        operator, watcher = OperatorNode((), context), Watcher(context)
        graph = rig_graph(ports, {}, {}, simulated=True)
        with running_graph(graph, context, others=[operator, watcher]):
            operator.home_guide()
            rig.mount('texture', 'R1', 'flexion')
            watcher.start_trial('texture')
            watcher.wait_for_phase('glide')
        truth = truth_at_rest(rig)
        assert truth['guide_position_m'] < 0.120
        assert truth['tension_n'] < 1.0
