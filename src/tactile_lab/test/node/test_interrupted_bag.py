# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording that was interrupted during a trial replays equal, except its last results."""

import concurrent.futures
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from domain_coordinator import domain_id
import pytest

from tactile_bags import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import (
    compare_with_recorded,
    first_sample_ns,
    recorded_results,
    replay_through_core,
)
from tactile_bringup.launch_config.graph import Ports, recorder_node, rig_graph
from tactile_bringup.nodes import operator_node
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.msg import TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.qos import EVENTS
from tactile_ros.topics import EVENT
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import GUARD, home_fast, let_servos_pause, PATIENT
from tactile_testing.waiting import wait_until


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=3) as rig:
        home_fast(rig)
        rig.mount('stiffness', 'pla', 'flexion')
        yield rig


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Accept pauses of servos, and shorten the wait of the operator for the end of the trial."""
    let_servos_pause(monkeypatch)
    monkeypatch.setattr(operator_node, 'longest_trial_s', lambda *_: 20.0)
    monkeypatch.setattr(operator_node, 'END_TIMEOUT_S', 0.5)


def record_until_interrupted(rig, bag, phase):
    """Run and record a trial, and interrupt the recording in this phase."""
    phases, pool = [], ThreadPoolExecutor()
    with domain_id() as domain, ros_context(int(domain)) as context:
        runner = {'approach_speed_m_s': 0.1, 'hold_s': 2.8, **PATIENT}
        quick = {'trial_runner': runner, 'tendon_actuator': GUARD}
        graph = rig_graph(Ports(*rig.ports), None, quick, simulated=True)
        graph.append(recorder_node(bag, simulated=True))
        operator = OperatorNode(context)
        operator.create_subscription(
            TrialEvent, 'trial_runner/events', lambda m: phases.append(m.phase), EVENTS
        )
        with running_graph(graph, context, others=[operator], quiet=True) as nodes:
            wait_until(lambda: not nodes['bag_recorder'].unmatched_topics())
            operator.home_guide()
            request = TrialRequest('stiffness', 'flexion', 'pla', 'cut')
            trial = pool.submit(operator.run_trial, request)
            wait_until(lambda: phase in phases)
        with suppress(TactileError, concurrent.futures.TimeoutError):
            trial.result(1.0)  # returns also if the nodes have ended
        pool.shutdown(wait=False)  # do not wait for the operator, which has a time-out of 20 s


@pytest.mark.parametrize('phase', ['hold', 'release'])
def test_recording_interrupted_during_a_trial_replays_equal(rig, tmp_path, phase):
    record_until_interrupted(rig, tmp_path / 'bag', phase)
    with TactileBag(tmp_path / 'bag') as bag:
        events = [event for _, event in read_records(bag.messages(EVENT))]
        core = replay_through_core(bag, None, recorded_features(bag))
        begin_ns = first_sample_ns(bag)
        found = compare_with_recorded(recorded_results(bag), core, bag.end_ns, begin_ns)
    assert events[-1].phase == 'aborted'
    assert found.is_equal, found
    # The last window may or may not have been recorded, which depends on milliseconds.
    assert found.window_count + ('trial cut became' in (found.left_out or '')) == 1
