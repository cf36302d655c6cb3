# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import json
from pathlib import Path

import pytest

from tactile_bringup.launch_config.graph import (
    Ports,
    recorder_node,
    rig_graph,
    RIG_NODES,
    slip_node,
)
from tactile_bringup.launch_config.model_folder import find_models
from tactile_classifier.names import all_classifier_names, classifier_name, parse_classifier_name
from tactile_ros.errors import TactileError
from tactile_ros.programs.node_program import find_node_class

PORTS = Ports('/dev/guide', '/dev/tendon', '/dev/sensor')


def by_name(nodes):
    return {node.name: node for node in nodes}


@pytest.fixture
def models(trained):
    return find_models(trained)


def test_rig_has_every_node_with_its_port(models):
    nodes = by_name(rig_graph(PORTS, models, {}, simulated=True))
    assert sorted(nodes) == sorted([*RIG_NODES, 'stiffness_flexion_classifier'])
    assert nodes['linear_guide'].parameters['port'] == '/dev/guide'
    assert nodes['tendon_actuator'].parameters['port'] == '/dev/tendon'
    assert nodes['tendon_sensor'].parameters['port'] == '/dev/sensor'
    # Nobody but the sensor needs to know: its samples say so.
    told = [name for name, node in nodes.items() if 'simulated' in node.parameters]
    assert told == ['tendon_sensor']
    assert nodes['tendon_sensor'].parameters['simulated'] is True


def test_classifier_is_told_what_the_feature_node_is_told(models):
    parameters = {'tactile_features': {'rate_hz': 100.0, 'texture_samples': 300, 'buffer_s': 60.0}}
    nodes = by_name(rig_graph(PORTS, models, parameters, simulated=False))
    classifier = nodes['stiffness_flexion_classifier'].parameters
    assert classifier['rate_hz'] == 100.0
    assert classifier['texture_samples'] == 300
    assert 'buffer_s' not in classifier
    assert classifier['task'] == 'stiffness'
    assert classifier['contact'] == 'flexion'


def test_classifier_names_round_trip():
    assert len(all_classifier_names()) == 6
    for name in all_classifier_names():
        assert classifier_name(*parse_classifier_name(name)) == name
    with pytest.raises(TactileError, match='smell'):
        parse_classifier_name('smell_flexion_classifier')


def test_every_described_node_can_be_created_here(models):
    nodes = rig_graph(PORTS, models, {}, simulated=True)
    nodes.append(recorder_node(Path('bag'), None, (), {}, simulated=True))
    nodes.append(slip_node({}))
    for node in nodes:
        module = find_node_class(node.executable).__module__
        assert module.split('.')[0] == node.package
        assert module.split('.')[-1] == node.executable


def test_recording_notes_where_its_models_are(tmp_path):
    node = recorder_node(tmp_path / 'recording', tmp_path / 'models', (), {}, simulated=True)
    assert '"models": "../models"' in node.parameters['metadata']


def test_recording_notes_the_windows_and_passes_over_parameters_of_every_node(tmp_path):
    parameters = {'texture_samples': 90, 'use_sim_time': True}
    node = recorder_node(tmp_path / 'recording', None, (), parameters, simulated=True)
    assert json.loads(node.parameters['metadata'])['feature_config']['texture_samples'] == 90


def test_nodes_that_can_die_alone_watch_each_other():
    def parameters(given, watched=True):
        nodes = by_name(rig_graph(PORTS, {}, given, simulated=True, watched=watched))
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
