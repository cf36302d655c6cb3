# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from tactile_features.errors import FeatureError
from tactile_ros.errors import TactileError

PROTOCOLS = ('texture', 'stiffness')


def test_a_finger_that_moves_itself_has_no_guide(launch):
    _, nodes = launch('sense', phases='texture', namespace='index')
    assert set(nodes) == {'index/tendon_sensor', 'index/tactile_features'}
    assert nodes['index/tendon_sensor'].parameters['port'] == '/dev/tactile/sensor'
    features = nodes['index/tactile_features'].parameters
    assert features['phases'] == 'texture'
    assert 'simulated' not in nodes['index/tendon_sensor'].parameters
    _, nodes = launch('sense', phases='stiffness', contact='abduction', rig='simulated')
    features = nodes['tactile_features'].parameters
    assert features['detected_contact'] == 'abduction'
    assert nodes['tendon_sensor'].parameters['simulated'] is True


def test_fingers_by_name_have_namespaces_ports_and_bags_of_their_own(launch, tmp_path):
    values = {'fingers': 'index,middle', 'namespace': 'left', 'record': str(tmp_path / 'bags')}
    _, nodes = launch('hand', **values)
    assert len(nodes) == 6
    for finger in ('index', 'middle'):
        sensor = nodes[f'left/{finger}/tendon_sensor']
        assert sensor.parameters['port'] == f'/dev/tactile/{finger}'
        recorder = nodes[f'left/{finger}/bag_recorder']
        assert recorder.parameters['namespaces'] == (f'left/{finger}',)
        assert recorder.parameters['rig'] is False, 'no guide will ever be there'
        assert recorder.parameters['bag'] == str(tmp_path / 'bags' / finger)


def test_each_simulated_finger_has_a_rig(launch):
    plan, _ = launch('hand', fingers='index,middle', rig='simulated')
    assert len({rig.links for rig in plan.rigs}) == 2
    assert len({rig.seed for rig in plan.rigs}) == 2
    ports = {node.parameters['port'] for node in plan.nodes if node.name == 'tendon_sensor'}
    assert ports == {rig.ports.sensor for rig in plan.rigs}


def test_a_described_finger_wins_over_the_parameter_file(launch, parameter_file, hand_file):
    hand = hand_file(
        'fingers:\n'
        '  index: {phases: stiffness, parameters: {tendon_sensor: {scale: -1.0}}}\n'
        '  middle: {sensor_port: /dev/ttyUSB7}\n'
    )
    text = '/**:\n  tendon_sensor:\n    ros__parameters: {scale: 2.0, rate_hz: 80.0}\n'
    values = {'hand_file': hand, 'params_file': parameter_file(text), 'phases': 'texture'}
    _, nodes = launch('hand', **values)
    assert nodes['index/tendon_sensor'].parameters['scale'] == -1.0
    assert nodes['index/tendon_sensor'].parameters['rate_hz'] == 80.0
    assert nodes['middle/tendon_sensor'].parameters['scale'] == 2.0
    assert nodes['middle/tendon_sensor'].parameters['port'] == '/dev/ttyUSB7'
    assert nodes['index/tactile_features'].parameters['phases'] == 'stiffness'
    assert nodes['middle/tactile_features'].parameters['phases'] == 'texture'


def test_a_slip_detector_listens_where_it_is_wanted(launch, parameter_file, hand_file):
    hand = hand_file(
        'fingers:\n'
        '  index: {slip: false}\n'
        '  middle: {parameters: {slip_detector: {threshold: 6.0}}}\n'
    )
    text = '/**:\n  slip_detector:\n    ros__parameters: {threshold: 7.0, history_s: 0.3}\n'
    values = {'hand_file': hand, 'params_file': parameter_file(text)}
    with pytest.raises(TactileError, match='has parameters for slip_detector; its nodes are'):
        launch('hand', **values)
    _, nodes = launch('hand', **values, slip='true')
    assert 'index/slip_detector' not in nodes
    assert nodes['middle/slip_detector'].parameters == {'threshold': 6.0, 'history_s': 0.3}
    _, nodes = launch('sense', slip='true', rig='simulated')
    assert nodes['slip_detector'].parameters == {}
    assert 'slip_detector' not in launch('sense')[1]


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('{a: {slip: maybe}}', 'slip of a must be true or false'),
        ('{a: {sensor_port: /dev/x}, b: {sensor_port: /dev/x}}', 'a port has one user'),
        ('{a: {parameters: {tendon_senser: {scale: 1.0}}}}', 'parameters for tendon_senser'),
        ('{a: {phases: smell}}', 'phases of the finger a is "smell"'),
        ('{a: {model: nowhere}}', 'model of a is now called models'),
    ],
)
def test_a_hand_that_cannot_be_is_refused(launch, text, sentence, hand_file):
    hand = hand_file(f'fingers: {text}')
    with pytest.raises(TactileError, match=sentence):
        launch('hand', hand_file=hand)


def test_models_that_are_not_there_are_refused(launch, hand_file):
    hand = hand_file('fingers: {a: {models: nowhere}}')
    with pytest.raises(FeatureError, match='nowhere: No such file'):
        launch('hand', hand_file=hand)


def test_two_net_ft_need_no_port(launch, hand_file):
    sensor = '{sensor_port: none, parameters: {tendon_sensor: {sensor: net_ft, host: 10.0.0.%d}}}'
    hand = hand_file(f'fingers: {{a: {sensor % 1}, b: {sensor % 2}}}')
    assert len(launch('hand', hand_file=hand)[0].nodes) == 4


@pytest.mark.parametrize(
    ('topic', 'expected'),
    [
        ('/ft/wrench', {'topic': '/ft/wrench'}),
        ('wrench:fx', {'topic': 'wrench', 'axis': 'fx'}),
        ('wrench:norm', {'topic': 'wrench', 'axis': 'norm'}),
        ('/joint_states:index_tendon', {'topic': '/joint_states', 'joint': 'index_tendon'}),
    ],
)
@pytest.mark.parametrize('rig', ['hardware', 'simulated'])
def test_a_sensor_on_a_topic_needs_no_port_and_no_rig(launch, topic, expected, rig):
    plan, nodes = launch('sense', sensor_topic=topic, rig=rig)
    marked = {'simulated': True} if rig == 'simulated' else {}
    parameters = {'sensor': 'topic', 'rate_hz': 0.0, **marked, **expected}
    assert nodes['tendon_sensor'].parameters == parameters
    assert not plan.rigs


@pytest.mark.parametrize('name', PROTOCOLS)
def test_a_rig_takes_its_force_from_a_topic(launch, name):
    for rig, rigs in (('hardware', 0), ('simulated', 1)):
        values = {'sensor_topic': '/ft/wrench:fx', 'rig': rig}
        plan, nodes = launch(name, **values)
        sensor = nodes['tendon_sensor'].parameters
        assert sensor['topic'] == '/ft/wrench'
        assert 'port' not in sensor
        assert len(plan.rigs) == rigs
    with pytest.raises(TactileError, match='a sensor_port and a sensor_topic; give one'):
        launch(name, **values, sensor_port='/dev/a')


def test_a_sensor_on_a_topic_has_the_rate_of_the_features_unless_stated(launch, parameter_file):
    values = {'sensor_topic': '/f'}
    of_features = parameter_file('tactile_features: {ros__parameters: {rate_hz: 100.0}}')
    _, nodes = launch('sense', **values, params_file=of_features)
    assert nodes['tendon_sensor'].parameters['rate_hz'] == 100.0
    of_sensor = parameter_file('tendon_sensor: {ros__parameters: {rate_hz: 50.0, scale: 2.0}}')
    _, nodes = launch('sense', **values, params_file=of_sensor)
    assert nodes['tendon_sensor'].parameters['rate_hz'] == 50.0
    assert nodes['tendon_sensor'].parameters['scale'] == 2.0


def test_fingers_may_share_a_topic_or_have_one_each(launch, hand_file):
    hand = hand_file('fingers: {a: {sensor_topic: "/j:x"}, b: {sensor_topic: "/j:y"}, c: }')
    _, nodes = launch('hand', hand_file=hand, sensor_topic='ft')
    sensors = {path: node.parameters for path, node in nodes.items() if 'sensor' in path}
    assert sensors['a/tendon_sensor']['joint'] == 'x'
    assert sensors['b/tendon_sensor']['topic'] == '/j'
    assert sensors['c/tendon_sensor']['topic'] == 'ft'  # in the namespace of the finger
    hand = hand_file('fingers: {a: {sensor_topic: /f, sensor_port: /dev/ttyUSB0}}')
    with pytest.raises(TactileError, match='a has a sensor_port and a sensor_topic; give one'):
        launch('hand', hand_file=hand)


@pytest.mark.parametrize('values', [{}, {'rig': 'simulated'}])
@pytest.mark.parametrize('name', ['sense', *PROTOCOLS])
def test_no_sensor_port_is_no_sensor_node(launch, name, values):
    _, usual = launch(name, **values)
    plan, without = launch(name, **values, sensor_port='none')
    assert set(usual) - set(without) == {'tendon_sensor'}
    assert len(plan.rigs) == (1 if values and name != 'sense' else 0)
    assert 'none' not in [node.parameters.get('port') for node in without.values()]


@pytest.mark.parametrize('name', ['guide', 'tendon'])
def test_a_rig_that_cannot_move_is_refused(launch, name):
    with pytest.raises(TactileError, match=f'{name}_port is none, but a trial moves the {name}'):
        launch('texture', **{f'{name}_port': 'none'})


def test_the_contact_narrows_the_models_of_a_finger(launch, trained):
    values = {'models': str(trained), 'sensor_port': 'none'}
    _, nodes = launch('sense', **values, phases='stiffness', contact='flexion')
    for name in ('tactile_features', 'tactile_classifier'):
        assert nodes[name].parameters['contact'] == 'flexion'
    assert 'contact' not in launch('sense', **values)[1]['tactile_classifier'].parameters
    with pytest.raises((TactileError, FeatureError), match='abduction'):
        launch('sense', **values, contact='abduction')
    with pytest.raises(TactileError, match='no model for texture, only for stiffness'):
        launch('sense', **values, phases='texture')


def test_a_sensor_on_a_topic_has_the_rate_of_the_models(launch, trained):
    _, nodes = launch('sense', sensor_topic='/f', models=str(trained))
    assert nodes['tendon_sensor'].parameters['rate_hz'] == 60.0
