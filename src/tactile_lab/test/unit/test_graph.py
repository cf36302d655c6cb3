# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    ModelChoice,
    Ports,
    recorder_node,
    rig_graph,
    RIG_NODES,
    slip_node,
)
from tactile_ros.programs.node_program import find_node_class

PORTS = Ports('/dev/guide', '/dev/tendon', '/dev/sensor')


def by_name(nodes):
    return {node.name: node for node in nodes}


@pytest.fixture
def models(trained):
    return ModelChoice.read(trained)


def test_rig_has_every_node_with_its_port(models):
    nodes = by_name(rig_graph(PORTS, models, {}, simulated=True))
    assert sorted(nodes) == sorted([*RIG_NODES, CLASSIFIER_NODE])
    assert nodes['linear_guide'].parameters['port'] == '/dev/guide'
    assert nodes['tendon_actuator'].parameters['port'] == '/dev/tendon'
    assert nodes['tendon_sensor'].parameters['port'] == '/dev/sensor'
    # Nobody but the sensor needs to know: its samples say so.
    told = [name for name, node in nodes.items() if 'simulated' in node.parameters]
    assert told == ['tendon_sensor']
    assert nodes['tendon_sensor'].parameters['simulated'] is True


def test_features_and_classifier_get_the_models_and_nothing_out_of_them(trained):
    choice = ModelChoice.read(trained, 'stiffness', 'flexion', '5')
    nodes = by_name(rig_graph(PORTS, choice, {}, simulated=False))
    told = {'models': str(trained), 'contact': 'flexion'}
    assert nodes['tactile_features'].parameters == told
    assert nodes[CLASSIFIER_NODE].parameters == {**told, 'recalibration_trials': 5}


def test_every_described_node_can_be_created_here(models):
    nodes = rig_graph(PORTS, models, {}, simulated=True)
    nodes.append(recorder_node(Path('bag'), simulated=True))
    nodes.append(slip_node({}))
    for node in nodes:
        module = find_node_class(node.executable).__module__
        assert module.split('.')[0] == node.package
        assert module.split('.')[-1] == node.executable


def test_the_recorder_waits_for_a_classifier_where_one_runs():
    assert recorder_node(Path('bag')).parameters['classifier'] is False
    assert recorder_node(Path('bag'), classifier=True).parameters['classifier'] is True


def test_nodes_that_can_die_alone_watch_each_other():
    def parameters(given, watched=True):
        nodes = by_name(rig_graph(PORTS, None, given, simulated=True, watched=watched))
        return nodes['linear_guide'].parameters, nodes['tendon_actuator'].parameters

    assert 'heartbeat_topics' not in parameters({}, watched=False)[0]
    guide, tendon = parameters({})
    runner = 'trial_runner/heartbeat'
    assert set(guide['heartbeat_topics']) == {runner, 'tendon_actuator/heartbeat'}
    assert set(tendon['heartbeat_topics']) == {runner, 'linear_guide/heartbeat'}
    assert guide['strain_timeout_s'] > 0
    given = {'linear_guide': {'strain_timeout_s': 0.5, 'port': '/dev/other'}}
    guide, _ = parameters(given)
    assert (guide['strain_timeout_s'], guide['port']) == (0.5, '/dev/other')
