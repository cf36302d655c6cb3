# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import shutil

import numpy as np
import pytest

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    ModelChoice,
    Ports,
    recorder_node,
    rig_graph,
    RIG_NODES,
    sensing_graph,
    sensor_parameters,
    SIMULATED_SATURATION_N,
)
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, ModelFileError
from tactile_features.spec import spec_for
from tactile_ros.errors import TactileError
from tactile_ros.node_program import find_node_class
from tactile_sim.descriptions.catalogue import default_catalogue

PORTS = Ports('/dev/guide', '/dev/tendon', '/dev/sensor')


def by_name(nodes):
    return {node.name: node for node in nodes}


@pytest.fixture(scope='module')
def trained(tmp_path_factory):
    """Return a folder with a model of two labels."""
    labels = np.repeat(['pla', 'sponge'], 24)
    values = np.random.default_rng(0).normal(size=(48, 3)) + (labels == 'pla')[:, None]
    columns = {'contact': np.full(48, 'flexion')}
    table = FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), columns)
    folder = tmp_path_factory.mktemp('models')
    write_model(folder / 'stiffness_flexion.npz', train(table, 'tree'))
    return folder


@pytest.fixture
def models(trained):
    return ModelChoice.read(trained)


def test_rig_has_every_node_with_its_port(models):
    nodes = by_name(rig_graph(PORTS, models, {}, simulated=True))
    assert sorted(nodes) == sorted([*RIG_NODES, CLASSIFIER_NODE])
    assert nodes['linear_guide'].parameters['port'] == '/dev/guide'
    assert nodes['tendon_actuator'].parameters['port'] == '/dev/tendon'
    assert nodes['tendon_sensor'].parameters['port'] == '/dev/sensor'
    # Only the sensor node has the parameter ``simulated``.
    told = [name for name, node in nodes.items() if 'simulated' in node.parameters]
    assert told == ['tendon_sensor']
    assert nodes['tendon_sensor'].parameters['simulated'] is True
    # For each description of a node, the class of the node is found.
    for node in (*nodes.values(), recorder_node(Path('bag'), simulated=True)):
        assert find_node_class(node.executable).__module__.split('.')[-1] == node.executable
    stated = {'linear_guide': {'strain_timeout_s': 0.5, 'port': '/dev/other'}}
    guide = by_name(rig_graph(PORTS, models, stated, simulated=True))['linear_guide']
    assert guide.parameters == {'strain_timeout_s': 0.5, 'port': '/dev/guide'}


def test_range_of_a_simulated_load_cell_is_set():
    def ranges(stated, **options):
        nodes = by_name(rig_graph(PORTS, None, stated, **options))
        names = ('tendon_sensor', 'tendon_actuator')
        return [nodes[name].parameters.get('saturation_n') for name in names]

    assert ranges({}, simulated=False) == [None, None]
    assert ranges({}, simulated=True) == [SIMULATED_SATURATION_N] * 2
    stated = {name: {'saturation_n': 17.0} for name in ('tendon_sensor', 'tendon_actuator')}
    assert ranges(stated, simulated=True) == [17.0, 17.0]
    assert default_catalogue().rig().load_cell.capacity_n > SIMULATED_SATURATION_N


def test_features_and_classifier_get_only_the_paths_of_models(trained):
    choice = ModelChoice.read(trained, 'stiffness', 'flexion')
    nodes = by_name(rig_graph(PORTS, choice, {}, simulated=False))
    told = {'models': str(trained), 'contact': 'flexion'}
    assert nodes['tactile_features'].parameters == told
    assert nodes[CLASSIFIER_NODE].parameters == told


def test_recorder_waits_for_the_classifier_only_if_there_is_one():
    assert recorder_node(Path('bag')).parameters['classifier'] is False
    assert recorder_node(Path('bag'), classifier=True).parameters['classifier'] is True


@pytest.mark.parametrize(
    ('topic', 'expected'),
    [
        ('/ft/wrench', {'topic': '/ft/wrench'}),
        ('wrench:fx', {'topic': 'wrench', 'axis': 'fx'}),
        ('wrench:norm', {'topic': 'wrench', 'axis': 'norm'}),
        ('/joint_states:index_tendon', {'topic': '/joint_states', 'joint': 'index_tendon'}),
    ],
)
def test_a_sensor_on_a_topic_needs_no_port(topic, expected):
    given = sensor_parameters({}, topic=topic)
    assert given == {'sensor': 'topic', 'rate_hz': 0.0, **expected}
    rig = by_name(rig_graph(Ports('g', 't', '', topic), None, {}, simulated=True))
    assert rig['tendon_sensor'].parameters == {**given, 'simulated': True}
    with pytest.raises(TactileError, match='both sensor_port and sensor_topic are given'):
        sensor_parameters({}, port='/dev/a', topic=topic)


def test_rate_of_a_sensor_on_a_topic_is_measured_unless_it_is_given():
    def rate_hz(**stated):
        return sensor_parameters(stated, topic='/f').get('rate_hz')

    assert rate_hz() == 0.0
    assert rate_hz(tactile_features={'rate_hz': 100.0}) == 100.0
    assert rate_hz(tendon_sensor={'rate_hz': 50.0}) is None, 'the rate in the file is used'
    on_topic = {'tendon_sensor': {'sensor': 'topic', 'topic': '/f'}}
    assert sensor_parameters(on_topic) == {'rate_hz': 0.0}


def test_without_a_sensor_port_another_node_publishes_the_strain():
    assert sensor_parameters({}, port='none') is None
    assert sensor_parameters({'tendon_sensor': {'port': 'none'}}) is None
    assert sensor_parameters({'tendon_sensor': {'port': 'none'}}, port='/dev/x') is not None
    net_ft = {'tendon_sensor': {'sensor': 'net_ft', 'host': '10.0.0.1'}}
    assert sensor_parameters(net_ft, port='none') == {}
    assert [node.name for node in sensing_graph('none', None, {})] == ['tactile_features']


def test_models_of_a_finger_match_its_task_and_contact(trained, tmp_path):
    file = tmp_path / 'of any name.npz'
    shutil.copy(trained / 'stiffness_flexion.npz', file)
    assert ModelChoice.read(file, 'stiffness', 'flexion').path == file
    with pytest.raises(TactileError, match='no model for texture flexion, only for stiffness'):
        ModelChoice.read(file, 'texture', 'flexion')
    with pytest.raises((TactileError, FeatureError), match='abduction'):
        ModelChoice.read(file, contact='abduction')
    (tmp_path / 'no.npz').write_text('no')
    with pytest.raises(ModelFileError, match=r'no\.npz is refused: '):
        ModelChoice.read(tmp_path / 'no.npz')
    with pytest.raises(FeatureError, match='nowhere: No such file'):
        ModelChoice.read(Path('nowhere'))


def test_models_may_be_named_in_a_parameter_file(trained):
    stated = {'tactile_classifier': {'models': str(trained)}}
    assert ModelChoice.of_finger('', stated).path == trained
    assert ModelChoice.of_finger('', {}) is None
