# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import ast
import dataclasses
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

from tactile_bringup.launch_config.graph import CLASSIFIER_NODE, PLAYER, RIG_NODES
from tactile_bringup.launch_config.launch_arguments import LAUNCH_FILES
from tactile_bringup.launch_config.parameter_tables import argument_tables
from tactile_features.errors import FeatureError, ModelFileError
from tactile_lab.options import PHASES
from tactile_ros.errors import TactileError

LAUNCH_FOLDER = Path(__file__).resolve().parents[3] / 'tactile_bringup' / 'launch'
PROTOCOLS = ('texture', 'stiffness')


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
    launch, name, trained, stiffness_bag, tmp_path
):
    given = {'models': str(trained), 'record': str(tmp_path / 'recording')}
    if name == 'replay':
        given['bag'] = str(stiffness_bag)
    else:
        given['rig'] = 'simulated'
        given |= {'hand': {'fingers': 'a,b', 'slip': 'true'}, 'sense': {'slip': 'true'}}.get(
            name, {}
        )
    if name == 'texture':
        del given['models']  # the small models are for stiffness
    planned = {(n.package, n.executable) for n in launch(name, **given)[0].nodes}
    if name == 'texture':
        planned.add(('tactile_classifier', 'tactile_classifier_node'))
    shown = launched(LAUNCH_FOLDER / f'{name}.launch.py')
    assert shown == planned


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_every_argument_says_what_it_is_for(name):
    names = [argument.name for argument in LAUNCH_FILES[name]]
    assert len(names) == len(set(names))
    assert {'models', 'record', 'params_file', 'namespace', 'use_sim_time', 'log_level'} <= set(
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
    assert phases.choices == PHASES


# -- the rig ---------------------------------------------------------------------------------


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_rig_is_there_with_the_usual_ports(launch, protocol):
    plan, nodes = launch(protocol, namespace='/thumb')
    assert sorted(nodes) == sorted(f'thumb/{name}' for name in RIG_NODES)
    assert nodes['thumb/linear_guide'].parameters['port'] == '/dev/tactile/guide'
    assert nodes['thumb/linear_guide'].parameters['heartbeat_topics']
    assert plan.rigs == ()
    assert not plan.ends_with


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_simulated_rig_changes_ports_and_nothing_else(launch, protocol, tmp_path):
    real, _ = launch(protocol, rig='hardware')
    simulated, nodes = launch(protocol, rig='simulated')
    (rig,) = simulated.rigs
    assert rig.mount[0] == protocol
    assert rig.links.is_relative_to(tmp_path)
    for one, other in zip(real.nodes, simulated.nodes, strict=True):
        assert dataclasses.replace(one, parameters={}) == dataclasses.replace(other, parameters={})
        changed = {
            key for key in one.parameters if one.parameters[key] != other.parameters.get(key)
        }
        added = other.parameters.keys() - one.parameters.keys()
        assert added == ({'simulated'} if one.name == 'tendon_sensor' else set())
        assert changed <= {'port'}
    assert nodes['tendon_sensor'].parameters['port'] == rig.ports.sensor
    assert nodes['tendon_sensor'].parameters['simulated'] is True


def test_a_simulated_rig_that_runs_already_is_used(launch):
    ports = {f'{name}_port': f'/tmp/{name}' for name in ('guide', 'tendon', 'sensor')}
    plan, nodes = launch('texture', rig='simulated', **ports)
    assert plan.rigs == ()
    assert nodes['tendon_actuator'].parameters['port'] == '/tmp/tendon'
    with pytest.raises(TactileError, match='also tendon_port, sensor_port'):
        launch('texture', rig='simulated', guide_port='/tmp/guide')


def test_the_parameter_file_reaches_the_features_and_the_recorder_needs_nothing_of_it(
    launch, trained, parameter_file, tmp_path
):
    text = '/**:\n  tactile_features:\n    ros__parameters: {stiffness_settle_s: 0.75}\n'
    values = {
        'models': str(trained),
        'record': str(tmp_path / 'bag'),
        'params_file': parameter_file(text),
    }
    _, nodes = launch('stiffness', **values)
    assert nodes['tactile_features'].parameters['stiffness_settle_s'] == 0.75
    assert 'stiffness_settle_s' not in nodes[CLASSIFIER_NODE].parameters
    assert nodes['bag_recorder'].parameters == {
        'bag': values['record'],
        'namespaces': ('',),
        'metadata': '{"simulated": false}',
        'rig': True,
        'classifier': True,
    }


def test_nested_parameters_have_the_names_that_ros_gives_them(launch, parameter_file):
    text = (
        'tendon_sensor:\n  ros__parameters:\n    qos_overrides:\n'
        '      /tendon_sensor/strain: {publisher: {depth: 7}}\n'
    )
    _, nodes = launch('sense', params_file=parameter_file(text))
    name = 'qos_overrides./tendon_sensor/strain.publisher.depth'
    assert nodes['tendon_sensor'].parameters[name] == 7


def test_a_single_model_file_says_what_it_is_for(launch, trained, tmp_path):
    file = tmp_path / 'of any name.onnx'
    shutil.copy(trained / 'stiffness_flexion.onnx', file)
    for name in ('stiffness', 'sense'):
        _, nodes = launch(name, models=str(file))
        for node in ('tactile_features', CLASSIFIER_NODE):
            assert nodes[node].parameters['models'] == str(file.resolve())
    with pytest.raises(TactileError, match='no model for texture flexion, only for stiffness'):
        launch('texture', models=str(file))
    (tmp_path / 'no.onnx').write_text('no')
    with pytest.raises(ModelFileError, match='ONNX file'):
        launch('sense', models=str(tmp_path / 'no.onnx'))


def test_the_argument_of_version_0_1_is_refused_by_its_new_name(launch, trained):
    with pytest.raises(TactileError, match='argument model is now called models'):
        launch('sense', model=str(trained))


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_time_from_the_clock_topic_reaches_every_node_but_the_clock(launch, name, stiffness_bag):
    values = {'use_sim_time': 'true'}
    values.update(
        {'hand': {'fingers': 'index'}, 'replay': {'bag': str(stiffness_bag)}}.get(name, {})
    )
    for node in launch(name, **values)[0].nodes:
        assert node.parameters.get('use_sim_time', False) is (node.name != PLAYER)


# -- replay ------------------------------------------------------------------------------------


def test_a_replay_has_what_the_recording_was_made_with(launch, stiffness_bag, trained):
    values = {'bag': str(stiffness_bag), 'rate': '2', 'models': str(trained)}
    plan, nodes = launch('replay', **values)
    assert set(nodes) == {'tactile_features', CLASSIFIER_NODE, PLAYER}
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
        ('texture', {'models': 'nowhere'}, 'nowhere: No such file'),
        ('texture', {'params_file': 'nowhere.yaml'}, 'nowhere.yaml'),
    ],
)
def test_what_does_not_fit_is_refused_with_a_sentence(launch, name, values, sentence):
    with pytest.raises((TactileError, FeatureError), match=sentence):
        launch(name, **values)


def test_a_finger_that_is_not_in_the_recording_is_refused(launch, stiffness_bag):
    with pytest.raises(TactileError, match='no finger thumb, only the root'):
        launch('replay', bag=str(stiffness_bag), namespace='thumb')


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('stiffness', {'rig': 'simulated'}),
        ('sense', {'sensor_port': 'p'}),
        ('hand', {'fingers': 'index'}),
    ],
)
def test_known_trials_recalibrate_the_models(launch, name, values, trained, parameter_file):
    def plan(**more):
        nodes = launch(name, models=str(trained), **values, **more)[0].nodes
        (node,) = (node for node in nodes if node.name == CLASSIFIER_NODE)
        return node.parameters

    assert 'recalibration_trials' not in plan()
    assert plan(recalibrate='5')['recalibration_trials'] == 5
    own = parameter_file('/**: {ros__parameters: {recalibration_trials: 9}}')
    assert plan(recalibrate='5', params_file=own)['recalibration_trials'] == 9
    with pytest.raises(TactileError, match='recalibrate is "some"; it must be a number of trials'):
        plan(recalibrate='some')
