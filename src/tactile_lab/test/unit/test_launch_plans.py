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

import ast
import dataclasses
import json
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

from tactile_bringup.launch_config.graph import PLAYER, RIG_NODES
from tactile_bringup.launch_config.launch_arguments import LAUNCH_FILES
from tactile_bringup.launch_config.launch_plans import plan_launch
from tactile_bringup.launch_config.parameter_tables import argument_tables
from tactile_classifier.errors import ModelFileError
from tactile_lab.options import Phases
from tactile_ros.errors import TactileError

LAUNCH_FOLDER = Path(__file__).resolve().parents[3] / 'tactile_bringup' / 'launch'
PROTOCOLS = ('texture', 'stiffness')


def by_path(plan):
    return {node.path: node for node in plan.nodes}


@pytest.fixture
def parameter_file(tmp_path):
    def write(text):
        path = tmp_path / 'params.yaml'
        path.write_text(text)
        return str(path)

    return write


# -- the table of arguments --------------------------------------------------------------


def launched(path):
    """Return package and executable of each ``Node(...)`` in a launch file."""
    calls = [
        {word.arg: word.value.value for word in call.keywords if word.arg}
        for call in ast.walk(ast.parse(path.read_text()))
        if isinstance(call, ast.Call) and getattr(call.func, 'id', '') == 'Node'
    ]
    return {(call['package'], call['executable']) for call in calls}


def test_each_launch_file_has_its_arguments():
    assert {p.name.removesuffix('.launch.py') for p in LAUNCH_FOLDER.glob('*.py')} == set(
        LAUNCH_FILES
    )


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_a_launch_file_shows_every_node_that_its_plan_starts(
    name, trained, stiffness_bag, tmp_path
):
    given = {'model': str(trained), 'record': str(tmp_path / 'recording')}
    if name == 'replay':
        given['bag'] = str(stiffness_bag)
    else:
        given['rig'] = 'simulated'
        given |= {'hand': {'fingers': 'a,b', 'slip': 'true'}, 'sense': {'slip': 'true'}}.get(
            name, {}
        )
    if name == 'texture':
        del given['model']  # the small models are for stiffness
    planned = {(n.package, n.executable) for n in plan_launch(name, given, tmp_path).nodes}
    if name == 'texture':
        planned.add(('tactile_classifier', 'tactile_classifier_node'))
    shown = launched(LAUNCH_FOLDER / f'{name}.launch.py')
    assert shown == planned


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_every_argument_says_what_it_is_for(name):
    names = [argument.name for argument in LAUNCH_FILES[name]]
    assert len(names) == len(set(names))
    assert {'model', 'record', 'params_file', 'namespace', 'use_sim_time', 'log_level'} <= set(
        names
    )
    for argument in LAUNCH_FILES[name]:
        assert len(argument.description) > 20
        assert not argument.choices or argument.default in argument.choices
        if not argument.default:
            assert re.search('[Ee]mpty|must be given', argument.description)
        assert f'| `{argument.name}` |' in argument_tables()


def test_arguments_are_read_without_launch_and_without_ros():
    code = (
        'import sys, tactile_bringup.launch_config.launch_plans as plans; '
        'assert not {"launch", "rclpy"} & set(sys.modules), sorted(sys.modules)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_command_line_has_the_same_choices():
    (phases,) = (a for a in LAUNCH_FILES['sense'] if a.name == 'phases')
    assert tuple(choice.value for choice in Phases) == phases.choices


# -- the rig ---------------------------------------------------------------------------------


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_rig_is_there_with_the_usual_ports(protocol, tmp_path):
    plan = plan_launch(protocol, {'namespace': '/thumb'}, tmp_path)
    assert sorted(by_path(plan)) == sorted(f'thumb/{name}' for name in RIG_NODES)
    assert by_path(plan)['thumb/linear_guide'].parameters['port'] == '/dev/tactile/guide'
    assert by_path(plan)['thumb/linear_guide'].parameters['heartbeat_topics']
    assert plan.rigs == ()
    assert not plan.ends_with


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_simulated_rig_changes_ports_and_nothing_else(protocol, tmp_path):
    real = plan_launch(protocol, {'rig': 'hardware'}, tmp_path)
    simulated = plan_launch(protocol, {'rig': 'simulated'}, tmp_path)
    (rig,) = simulated.rigs
    assert rig.mount[0] == protocol
    assert rig.links.is_relative_to(tmp_path)
    for one, other in zip(real.nodes, simulated.nodes, strict=True):
        assert dataclasses.replace(one, parameters={}) == dataclasses.replace(other, parameters={})
        changed = {
            key for key in one.parameters if one.parameters[key] != other.parameters.get(key)
        }
        assert one.parameters.keys() == other.parameters.keys()
        assert changed <= {'port', 'simulated'}
    assert by_path(simulated)['tendon_sensor'].parameters['port'] == rig.ports.sensor
    assert by_path(simulated)['trial_runner'].parameters['simulated'] is True


def test_a_simulated_rig_that_runs_already_is_used(tmp_path):
    ports = {f'{name}_port': f'/tmp/{name}' for name in ('guide', 'tendon', 'sensor')}
    plan = plan_launch('texture', {'rig': 'simulated', **ports}, tmp_path)
    assert plan.rigs == ()
    assert by_path(plan)['tendon_actuator'].parameters['port'] == '/tmp/tendon'
    with pytest.raises(TactileError, match='also tendon_port, sensor_port'):
        plan_launch('texture', {'rig': 'simulated', 'guide_port': '/tmp/guide'}, tmp_path)


def test_the_parameter_file_reaches_the_node_its_classifier_and_the_recording(
    trained, parameter_file, tmp_path
):
    text = '/**:\n  tactile_features:\n    ros__parameters: {stiffness_settle_s: 0.75}\n'
    values = {
        'model': str(trained),
        'record': str(tmp_path / 'bag'),
        'params_file': parameter_file(text),
    }
    nodes = by_path(plan_launch('stiffness', values, tmp_path))
    assert nodes['tactile_features'].parameters['stiffness_settle_s'] == 0.75
    assert nodes['stiffness_flexion_classifier'].parameters['stiffness_settle_s'] == 0.75
    facts = json.loads(nodes['bag_recorder'].parameters['facts'])
    assert facts['feature_config']['stiffness_settle_s'] == 0.75
    assert nodes['bag_recorder'].parameters['classifiers'] == ('stiffness_flexion_classifier',)
    assert nodes['bag_recorder'].parameters['rig'] is True


def test_nested_parameters_have_the_names_that_ros_gives_them(parameter_file, tmp_path):
    text = (
        'tendon_sensor:\n  ros__parameters:\n    qos_overrides:\n'
        '      /tendon_sensor/strain: {publisher: {depth: 7}}\n'
    )
    nodes = by_path(plan_launch('sense', {'params_file': parameter_file(text)}, tmp_path))
    name = 'qos_overrides./tendon_sensor/strain.publisher.depth'
    assert nodes['tendon_sensor'].parameters[name] == 7


def test_a_single_model_file_says_what_it_is_for(trained, tmp_path):
    file = trained / 'stiffness_flexion.onnx'
    for name in ('stiffness', 'sense'):
        nodes = by_path(plan_launch(name, {'model': str(file)}, tmp_path))
        assert nodes['stiffness_flexion_classifier'].parameters['model'] == str(file.resolve())
    with pytest.raises(TactileError, match='no model for the texture_flexion_classifier'):
        plan_launch('texture', {'model': str(file)}, tmp_path)
    (tmp_path / 'no.onnx').write_text('no')
    with pytest.raises(ModelFileError, match='ONNX file'):
        plan_launch('sense', {'model': str(tmp_path / 'no.onnx')}, tmp_path)


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_time_from_the_clock_topic_reaches_every_node_but_the_clock(name, stiffness_bag, tmp_path):
    values = {'use_sim_time': 'true'}
    values.update(
        {'hand': {'fingers': 'index'}, 'replay': {'bag': str(stiffness_bag)}}.get(name, {})
    )
    for node in plan_launch(name, values, tmp_path).nodes:
        assert node.parameters.get('use_sim_time', False) is (node.name != PLAYER)


# -- fingers -----------------------------------------------------------------------------------


def test_a_finger_that_moves_itself_has_no_guide(tmp_path):
    plan = plan_launch('sense', {'phases': 'texture', 'namespace': 'index'}, tmp_path)
    nodes = by_path(plan)
    assert set(nodes) == {'index/tendon_sensor', 'index/tactile_features'}
    assert nodes['index/tendon_sensor'].parameters['port'] == '/dev/tactile/sensor'
    features = nodes['index/tactile_features'].parameters
    assert features['phases'] == 'texture'
    assert features['detected_simulated'] is False
    values = {'phases': 'stiffness', 'contact': 'abduction', 'rig': 'simulated'}
    features = by_path(plan_launch('sense', values, tmp_path))['tactile_features'].parameters
    assert features['detected_contact'] == 'abduction'
    assert features['detected_simulated'] is True


def test_fingers_by_name_have_namespaces_ports_and_bags_of_their_own(tmp_path):
    values = {'fingers': 'index,middle', 'namespace': 'left', 'record': str(tmp_path / 'bags')}
    nodes = by_path(plan_launch('hand', values, tmp_path))
    assert len(nodes) == 6
    for finger in ('index', 'middle'):
        sensor = nodes[f'left/{finger}/tendon_sensor']
        assert sensor.parameters['port'] == f'/dev/tactile/{finger}'
        recorder = nodes[f'left/{finger}/bag_recorder']
        assert recorder.parameters['namespaces'] == (f'left/{finger}',)
        assert recorder.parameters['rig'] is False, 'no guide will ever be there'
        assert recorder.parameters['bag'] == str(tmp_path / 'bags' / finger)


def test_each_simulated_finger_has_a_rig(tmp_path):
    plan = plan_launch('hand', {'fingers': 'index,middle', 'rig': 'simulated'}, tmp_path)
    assert len({rig.links for rig in plan.rigs}) == 2
    assert len({rig.seed for rig in plan.rigs}) == 2
    ports = {node.parameters['port'] for node in plan.nodes if node.name == 'tendon_sensor'}
    assert ports == {rig.ports.sensor for rig in plan.rigs}


def test_a_described_finger_wins_over_the_parameter_file(parameter_file, tmp_path):
    hand = tmp_path / 'hand.yaml'
    hand.write_text(
        'fingers:\n'
        '  index: {phases: stiffness, parameters: {tendon_sensor: {scale: -1.0}}}\n'
        '  middle: {sensor_port: /dev/ttyUSB7}\n'
    )
    text = '/**:\n  tendon_sensor:\n    ros__parameters: {scale: 2.0, rate_hz: 80.0}\n'
    values = {'hand_file': str(hand), 'params_file': parameter_file(text), 'phases': 'texture'}
    nodes = by_path(plan_launch('hand', values, tmp_path))
    assert nodes['index/tendon_sensor'].parameters['scale'] == -1.0
    assert nodes['index/tendon_sensor'].parameters['rate_hz'] == 80.0
    assert nodes['middle/tendon_sensor'].parameters['scale'] == 2.0
    assert nodes['middle/tendon_sensor'].parameters['port'] == '/dev/ttyUSB7'
    assert nodes['index/tactile_features'].parameters['phases'] == 'stiffness'
    assert nodes['middle/tactile_features'].parameters['phases'] == 'texture'


def test_a_slip_detector_listens_where_it_is_wanted(parameter_file, tmp_path):
    hand = tmp_path / 'hand.yaml'
    hand.write_text(
        'fingers:\n'
        '  index: {slip: false}\n'
        '  middle: {parameters: {slip_detector: {threshold: 6.0}, tactile_features: '
        '{rate_hz: 100.0, frame_id: middle_sensor}}}\n'
    )
    text = '/**:\n  slip_detector:\n    ros__parameters: {threshold: 7.0, history_s: 0.3}\n'
    values = {'hand_file': str(hand), 'params_file': parameter_file(text)}
    with pytest.raises(TactileError, match='has parameters for slip_detector; its nodes are'):
        plan_launch('hand', values, tmp_path)
    nodes = by_path(plan_launch('hand', {**values, 'slip': 'true'}, tmp_path))
    assert 'index/slip_detector' not in nodes
    assert nodes['middle/slip_detector'].parameters == {
        'simulated': False,
        'rate_hz': 100.0,
        'frame_id': 'middle_sensor',
        'threshold': 6.0,
        'history_s': 0.3,
    }
    sensing = by_path(plan_launch('sense', {'slip': 'true', 'rig': 'simulated'}, tmp_path))
    assert sensing['slip_detector'].parameters == {'simulated': True}
    assert 'slip_detector' not in by_path(plan_launch('sense', {}, tmp_path))


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('{a: {slip: maybe}}', 'slip of a must be true or false'),
        ('{a: {sensor_port: /dev/x}, b: {sensor_port: /dev/x}}', 'a port has one user'),
        ('{a: {parameters: {tendon_senser: {scale: 1.0}}}}', 'parameters for tendon_senser'),
        ('{a: {phases: smell}}', 'phases of the finger a is "smell"'),
        ('{a: {model: nowhere}}', 'no model files in'),
    ],
)
def test_a_hand_that_cannot_be_is_refused(text, sentence, tmp_path):
    hand = tmp_path / 'hand.yaml'
    hand.write_text(f'fingers: {text}')
    with pytest.raises(TactileError, match=sentence):
        plan_launch('hand', {'hand_file': str(hand)}, tmp_path)


def test_two_net_ft_need_no_port(tmp_path):
    hand = tmp_path / 'hand.yaml'
    sensor = '{sensor_port: none, parameters: {tendon_sensor: {sensor: net_ft, host: 10.0.0.%d}}}'
    hand.write_text(f'fingers: {{a: {sensor % 1}, b: {sensor % 2}}}')
    assert len(plan_launch('hand', {'hand_file': str(hand)}, tmp_path).nodes) == 4


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
def test_a_sensor_on_a_topic_needs_no_port_and_no_rig(topic, expected, rig, tmp_path):
    plan = plan_launch('sense', {'sensor_topic': topic, 'rig': rig}, tmp_path)
    sensor = by_path(plan)['tendon_sensor']
    assert sensor.parameters == {'sensor': 'topic', 'rate_hz': 0.0, **expected}
    assert not plan.rigs


@pytest.mark.parametrize('name', PROTOCOLS)
def test_a_rig_takes_its_force_from_a_topic(name, tmp_path):
    for rig, rigs in (('hardware', 0), ('simulated', 1)):
        values = {'sensor_topic': '/ft/wrench:fx', 'rig': rig}
        plan = plan_launch(name, values, tmp_path)
        sensor = by_path(plan)['tendon_sensor']
        assert sensor.parameters['topic'] == '/ft/wrench'
        assert 'port' not in sensor.parameters
        assert len(plan.rigs) == rigs
    with pytest.raises(TactileError, match='a sensor_port and a sensor_topic; give one'):
        plan_launch(name, {**values, 'sensor_port': '/dev/a'}, tmp_path)


def test_a_sensor_on_a_topic_has_the_rate_of_the_features_unless_stated(parameter_file, tmp_path):
    values = {'sensor_topic': '/f'}
    of_features = parameter_file('tactile_features: {ros__parameters: {rate_hz: 100.0}}')
    plan = plan_launch('sense', {**values, 'params_file': of_features}, tmp_path)
    assert by_path(plan)['tendon_sensor'].parameters['rate_hz'] == 100.0
    of_sensor = parameter_file('tendon_sensor: {ros__parameters: {rate_hz: 50.0, scale: 2.0}}')
    plan = plan_launch('sense', {**values, 'params_file': of_sensor}, tmp_path)
    assert by_path(plan)['tendon_sensor'].parameters['rate_hz'] == 50.0
    assert by_path(plan)['tendon_sensor'].parameters['scale'] == 2.0


def test_fingers_may_share_a_topic_or_have_one_each(tmp_path):
    hand = tmp_path / 'hand.yaml'
    hand.write_text('fingers: {a: {sensor_topic: "/j:x"}, b: {sensor_topic: "/j:y"}, c: }')
    plan = plan_launch('hand', {'hand_file': str(hand), 'sensor_topic': 'ft'}, tmp_path)
    sensors = {path: node.parameters for path, node in by_path(plan).items() if 'sensor' in path}
    assert sensors['a/tendon_sensor']['joint'] == 'x'
    assert sensors['b/tendon_sensor']['topic'] == '/j'
    assert sensors['c/tendon_sensor']['topic'] == 'ft'  # in the namespace of the finger
    hand.write_text('fingers: {a: {sensor_topic: /f, sensor_port: /dev/ttyUSB0}}')
    with pytest.raises(TactileError, match='a has a sensor_port and a sensor_topic; give one'):
        plan_launch('hand', {'hand_file': str(hand)}, tmp_path)


@pytest.mark.parametrize('values', [{}, {'rig': 'simulated'}])
@pytest.mark.parametrize('name', ['sense', *PROTOCOLS])
def test_no_sensor_port_is_no_sensor_node(name, values, tmp_path):
    usual = plan_launch(name, values, tmp_path)
    without = plan_launch(name, {**values, 'sensor_port': 'none'}, tmp_path)
    assert set(by_path(usual)) - set(by_path(without)) == {'tendon_sensor'}
    assert len(without.rigs) == (1 if values and name != 'sense' else 0)
    assert 'none' not in [node.parameters.get('port') for node in without.nodes]


@pytest.mark.parametrize('name', ['guide', 'tendon'])
def test_a_rig_that_cannot_move_is_refused(name, tmp_path):
    with pytest.raises(TactileError, match=f'{name}_port is none, but a trial moves the {name}'):
        plan_launch('texture', {f'{name}_port': 'none'}, tmp_path)


@pytest.mark.parametrize('phases', ['stated', 'stiffness'])
def test_the_contact_narrows_the_models_of_a_finger(phases, trained, tmp_path):
    models = tmp_path / 'models'
    models.mkdir()
    for name in ('stiffness_flexion', 'stiffness_abduction', 'stiffness'):
        shutil.copy(trained / 'stiffness_flexion.onnx', models / f'{name}.onnx')
    values = {'model': str(models), 'phases': phases, 'sensor_port': 'none'}
    every = set(by_path(plan_launch('sense', values, tmp_path)))
    flexion = set(by_path(plan_launch('sense', {**values, 'contact': 'flexion'}, tmp_path)))
    assert every - flexion == {'stiffness_abduction_classifier'}
    (models / 'stiffness.onnx').unlink()
    (models / 'stiffness_flexion.onnx').unlink()
    with pytest.raises(TactileError, match=r'no model is for (stiffness )?flexion, only'):
        plan_launch('sense', {**values, 'contact': 'flexion'}, tmp_path)
    with pytest.raises(TactileError, match='no model is for texture, only stiffness_abduction'):
        plan_launch('sense', {**values, 'phases': 'texture'}, tmp_path)


# -- replay ------------------------------------------------------------------------------------


def test_a_replay_has_what_the_recording_was_made_with(stiffness_bag, trained, tmp_path):
    values = {'bag': str(stiffness_bag), 'rate': '2', 'model': str(trained)}
    plan = plan_launch('replay', values, tmp_path)
    nodes = by_path(plan)
    assert set(nodes) == {'tactile_features', 'stiffness_flexion_classifier', PLAYER}
    assert plan.ends_with == PLAYER
    assert nodes[PLAYER].parameters['bag'] == str(stiffness_bag)
    assert nodes[PLAYER].parameters['rate'] == 2.0
    assert nodes[PLAYER].parameters['subscriber_timeout_s'] > 10, 'others start slowly'
    assert nodes['tactile_features'].parameters['use_sim_time'] is True
    assert nodes['tactile_features'].parameters['texture_samples'] == 180


@pytest.mark.parametrize(
    ('name', 'values', 'sentence'),
    [
        ('replay', {}, 'name the recording'),
        ('replay', {'bag': 'nowhere'}, 'nowhere is not a readable bag'),
        ('replay', {'bag': 'nowhere', 'rate': 'fast'}, 'rate is "fast"'),
        ('hand', {}, 'name the fingers'),
        ('sense', {'rig': 'toy'}, 'rig is "toy"; it must be one of hardware, simulated'),
        ('sense', {'colour': 'red'}, 'sense has no argument colour'),
        ('texture', {'model': 'nowhere'}, 'no model files in nowhere'),
        ('texture', {'params_file': 'nowhere.yaml'}, 'nowhere.yaml'),
    ],
)
def test_what_does_not_fit_is_refused_with_a_sentence(name, values, sentence, tmp_path):
    with pytest.raises(TactileError, match=sentence):
        plan_launch(name, values, tmp_path)


def test_a_finger_that_is_not_in_the_recording_is_refused(stiffness_bag, tmp_path):
    with pytest.raises(TactileError, match='no finger thumb, only the root'):
        plan_launch('replay', {'bag': str(stiffness_bag), 'namespace': 'thumb'}, tmp_path)


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('stiffness', {'rig': 'simulated'}),
        ('sense', {'sensor_port': 'p'}),
        ('hand', {'fingers': 'index'}),
    ],
)
def test_known_trials_recalibrate_every_classifier(
    name, values, trained, parameter_file, tmp_path
):
    def plan(**more):
        nodes = plan_launch(name, {'model': str(trained), **values, **more}, tmp_path).nodes
        (node,) = (node for node in nodes if node.name == 'stiffness_flexion_classifier')
        return node.parameters

    assert 'recalibration_trials' not in plan()
    assert plan(recalibrate='5')['recalibration_trials'] == 5
    own = parameter_file('/**: {ros__parameters: {recalibration_trials: 9}}')
    assert plan(recalibrate='5', params_file=own)['recalibration_trials'] == 9
    with pytest.raises(TactileError, match='recalibrate is "some"; it must be a number of trials'):
        plan(recalibrate='some')
