# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from tactile_bringup.launch_config.hand import find_fingers, hand_graph
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_ros.errors import TactileError

HAND = """
/**/tendon_sensor: {ros__parameters: {rate_hz: 80.0, scale: 2.0}}
index:
  tendon_sensor: {ros__parameters: {scale: -1.0}}
  tactile_features: {ros__parameters: {phases: texture}}
middle:
  tendon_sensor: {ros__parameters: {port: /dev/ttyUSB7}}
"""


@pytest.fixture
def graph(parameter_file):
    """Return a function that maps the path of each node of a hand to its parameters."""

    def make(fingers, text='', **options):
        file = ParameterFile(parameter_file(text) if text else None)
        names = find_fingers(fingers, file, options.get('namespace', ''))
        return {node.path: node.parameters for node in hand_graph(names, file, **options)}

    return make


def test_each_finger_has_the_parameters_of_its_blocks(graph):
    nodes = graph('', HAND)
    assert list(nodes) == [
        'index/tendon_sensor',
        'index/tactile_features',
        'middle/tendon_sensor',
        'middle/tactile_features',
    ]
    port = '/dev/tactile/index'
    assert nodes['index/tendon_sensor'] == {'port': port, 'scale': -1.0, 'rate_hz': 80.0}
    assert nodes['index/tactile_features'] == {'phases': 'texture'}
    port = '/dev/ttyUSB7'
    assert nodes['middle/tendon_sensor'] == {'port': port, 'scale': 2.0, 'rate_hz': 80.0}


def test_an_argument_wins_over_the_file(graph):
    nodes = graph('', HAND, phases='stiffness', contact='abduction', sensor_topic='ft')
    for finger in ('index', 'middle'):
        told = {'phases': 'stiffness', 'detected_contact': 'abduction'}
        assert nodes[f'{finger}/tactile_features'] == told
        assert nodes[f'{finger}/tendon_sensor']['topic'] == 'ft'


def test_fingers_by_name_have_namespaces_ports_and_bags_of_their_own(graph, tmp_path):
    nodes = graph('index,middle', namespace='left', record=tmp_path / 'bags')
    assert len(nodes) == 6
    for finger in ('index', 'middle'):
        assert nodes[f'left/{finger}/tendon_sensor']['port'] == f'/dev/tactile/{finger}'
        recorder = nodes[f'left/{finger}/bag_recorder']
        assert recorder['namespaces'] == (f'left/{finger}',)
        assert recorder['rig'] is False, 'no guide will ever be there'
        assert recorder['bag'] == str(tmp_path / 'bags' / finger)


@pytest.mark.parametrize(
    'text',
    [
        f'left:\n{HAND[HAND.index("index") :]}'.replace('\n', '\n  '),
        '/**/index/tendon_sensor: {ros__parameters: {scale: 1.0}}',
    ],
)
def test_a_hand_is_found_below_its_namespace(graph, text):
    assert next(iter(graph('', text, namespace='left'))) == 'left/index/tendon_sensor'


def test_a_simulated_finger_without_a_port_gets_one(graph):
    asked = []

    def simulate(finger):
        asked.append(finger)
        return f'/tmp/{finger}'

    nodes = graph('', HAND, simulate=simulate)
    assert asked == ['index'], 'the other one has a port'
    assert nodes['index/tendon_sensor']['port'] == '/tmp/index'
    for finger in ('index', 'middle'):
        assert nodes[f'{finger}/tendon_sensor']['simulated'] is True
    assert 'simulated' not in nodes['index/tactile_features']


@pytest.mark.parametrize(
    ('fingers', 'text', 'sentence'),
    [
        ('', '', 'name the fingers'),
        ('index', HAND, 'middle.* index'),
        ('index,middle,ring', HAND, 'ring/tendon_sensor'),
        (
            '',
            'a: {tendon_sensor: {ros__parameters: {port: /dev/x}}}\n'
            'b: {tendon_sensor: {ros__parameters: {port: /dev/x}}}',
            'a/tendon_sensor .*b/tendon_sensor .*/dev/x',
        ),
        (
            'a',
            'right: {a: {tendon_sensor: {ros__parameters: {port: /dev/x}}}}',
            '/right/a/tendon_sensor.* /a/tendon_sensor',
        ),
        ('index, index', '', 'index'),
        ('ring finger', '', '"ring finger"'),
    ],
)
def test_a_hand_that_cannot_be_is_refused(graph, fingers, text, sentence):
    with pytest.raises(TactileError, match=sentence):
        graph(fingers, text)


def test_a_port_has_one_finger_and_two_net_ft_need_none(graph):
    with pytest.raises(TactileError, match='port'):
        graph('a,b', sensor_port='/dev/x')
    sensor = '{tendon_sensor: {ros__parameters: {sensor: net_ft, host: 10.0.0.%d}}}'
    assert len(graph('', f'a: {sensor % 1}\nb: {sensor % 2}', simulate=None)) == 4
