# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording that is interrupted within a trial replays equal, but for what came too late."""

import concurrent.futures
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from domain_coordinator import domain_id
import pytest

from tactile_bags import EVENT, TactileBag
from tactile_bringup.launch_config.graph import (
    Ports,
    recorder_node,
    rig_graph,
)
from tactile_bringup.nodes import operator_node
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_features.conversions import event_from_msg
from tactile_lab.commands.replay import replay_and_compare
from tactile_msgs.msg import TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.qos import EVENTS
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import home_fast, let_servos_pause, PATIENT
from tactile_testing.waiting import wait_until


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Servos may pause; the operator waits shortly for an end that nobody may be left to tell."""
    let_servos_pause(monkeypatch)
    monkeypatch.setattr(operator_node, 'longest_trial_s', lambda *_: 20.0)
    monkeypatch.setattr(operator_node, 'END_TIMEOUT_S', 0.5)


def record_until_interrupted(bag, phase):
    """Record one trial, and another one until it is in this phase."""
    phases, pool = [], ThreadPoolExecutor()
    with (
        domain_id() as domain,
        SimulatedRig(seed=3) as rig,
        ros_context(int(domain)) as context,
    ):
        home_fast(rig)
        quick = {'trial_runner': {'approach_speed_m_s': 0.1, 'hold_s': 2.8, **PATIENT}}
        graph = rig_graph(Ports(*rig.ports), None, quick, simulated=True)
        graph.append(recorder_node(bag, simulated=True))
        operator = OperatorNode(context)
        operator.create_subscription(
            TrialEvent,
            'trial_runner/events',
            lambda message: phases.append((message.trial_id, message.phase)),
            EVENTS,
        )
        with running_graph(graph, context, others=[operator], quiet=True) as nodes:
            wait_until(lambda: not nodes['bag_recorder'].unmatched_topics())
            operator.home_guide()
            rig.mount('stiffness', 'pla', 'flexion')
            operator.run_trial(TrialRequest('stiffness', 'flexion', 'pla', 'whole'))
            request = TrialRequest('stiffness', 'flexion', 'pla', 'cut')
            trial = pool.submit(operator.run_trial, request)
            wait_until(lambda: ('cut', phase) in phases)
        with suppress(TactileError, concurrent.futures.TimeoutError):
            trial.result(1.0)  # nobody may be left to answer
        pool.shutdown(wait=False)  # the operator waits for 20 s


@pytest.mark.parametrize('phase', ['hold', 'release'])
def test_a_recording_that_is_interrupted_in_a_trial_replays_equal(tmp_path, phase):
    bag = tmp_path / 'bag'
    record_until_interrupted(bag, phase)
    with TactileBag(bag) as recording:
        events = [event_from_msg(m.decode()) for m in recording.messages(EVENT)]
    assert [event.phase for event in events if event.trial_id == 'cut'][-1] == 'aborted'
    (report,) = replay_and_compare(bag, None, through_nodes=False)
    (comparison,) = report.comparisons.values()
    assert report.is_equal, comparison
    # Whether the window of the trial's end was still recorded, is a matter of milliseconds.
    assert comparison.window_count + ('trial cut became' in comparison.left_out) == 2
