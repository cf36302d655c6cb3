# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch files and `tactile` commands must start the same nodes with the same parameters.

The launch files are evaluated by ``launch``, but no process is started.
"""

from pathlib import Path
import sys

import pytest

pytest.importorskip('launch_ros', reason='launch comes with an ordinary ROS 2, not from PyPI')

from launch import LaunchContext
from launch.launch_description_sources import PythonLaunchDescriptionSource

from tactile_bringup.launch_config.graph import ModelChoice, Ports, recorder_node, rig_graph
from tactile_bringup.launch_config.hand import find_fingers, hand_graph
from tactile_bringup.launch_config.launching import Node, SimulatedRigProcess
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_lab.commands.replay import replay_graph
from tactile_ros.errors import TactileError

LAUNCH_FOLDER = Path(__file__).resolve().parents[3] / 'tactile_bringup' / 'launch'
PORTS = Ports('/dev/guide', '/dev/tendon', '/dev/sensor')


def evaluate(name, **arguments):
    """Return the actions of a launch file, except arguments and includes."""
    context = LaunchContext()
    context.launch_configurations.update({k: str(v) for k, v in arguments.items()})
    source = PythonLaunchDescriptionSource(str(LAUNCH_FOLDER / f'{name}.launch.py'))
    found, waiting = [], list(source.get_launch_description(context).entities)
    while waiting:
        entity = waiting.pop(0)
        if isinstance(entity, (Node, SimulatedRigProcess)):
            found.append(entity)
        else:
            waiting = [*(entity.visit(context) or ()), *waiting]
    return found


def launched(name, **arguments):
    return as_dict(action.description for action in evaluate(name, **arguments))


def as_dict(descriptions):
    found = {}
    for node in descriptions:
        assert node.path not in found
        # Omit empty values, which are defaults.
        parameters = {k: v for k, v in node.parameters.items() if v not in ('', (), [])}
        found[node.path] = parameters
    return found


@pytest.mark.parametrize('protocol', ['texture', 'stiffness'])
@pytest.mark.parametrize('namespace', ['', 'thumb'])
def test_launch_file_of_a_rig_starts_the_nodes_of_the_command(
    protocol, namespace, trained, parameter_file, tmp_path
):
    given = {f'{name}_port': f'/dev/{name}' for name in ('guide', 'tendon', 'sensor')}
    text = '/**/trial_runner: {ros__parameters: {guide_start_m: 0.05}}'
    record, models = tmp_path / 'bag', trained if protocol == 'stiffness' else ''
    nodes = launched(
        protocol,
        namespace=namespace,
        models=models,
        record=record,
        params_file=parameter_file(text),
        **given,
    )
    config = ParameterFile(LAUNCH_FOLDER.parent / 'config' / 'rig.yaml')
    stated = ParameterFile(parameter_file(text))
    parameters = {
        name: config.of(name, namespace) | stated.of(name, namespace)
        for name in ('tendon_sensor', 'linear_guide', 'tendon_actuator', 'trial_runner')
    }
    choice = ModelChoice.read(trained, protocol, 'flexion') if models else None
    expected = rig_graph(PORTS, choice, parameters, simulated=False, namespace=namespace)
    expected.append(recorder_node(record, namespace, classifier=choice is not None))
    assert nodes == as_dict(expected)


HAND = """
left:
  index:
    tendon_sensor: {ros__parameters: {scale: -1.0}}
    tactile_features: {ros__parameters: {phases: stiffness}}
  middle:
    tendon_sensor: {ros__parameters: {sensor: topic, topic: /ft}}
"""


@pytest.mark.parametrize('options', [{}, {'phases': 'stiffness', 'contact': 'flexion'}])
@pytest.mark.parametrize('has_models', [True, False])
def test_launch_file_of_a_hand_starts_the_nodes_of_the_command(
    options, has_models, trained, parameter_file, tmp_path
):
    path, models = parameter_file(HAND), str(trained) if has_models else ''
    shared = {'models': models, 'record': tmp_path / 'bags', 'namespace': 'left', **options}
    nodes = launched('hand', params_file=path, processes='node', **shared)
    file = ParameterFile(path)
    expected = hand_graph(find_fingers('', file, 'left'), file, **shared)
    assert nodes == as_dict(expected)
    assert len(nodes) == (8 if has_models else 6)


@pytest.mark.parametrize(
    'options', [{}, {'sensor_port': '/dev/x'}, {'sensor_port': 'none'}, {'sensor_topic': '/f:fx'}]
)
def test_launch_file_of_a_finger_starts_the_nodes_of_the_command(options, trained):
    nodes = launched('sense', models=trained, processes='node', **options)
    assert nodes == as_dict(hand_graph([''], ParameterFile(), models=str(trained), **options))


def test_launch_file_of_a_replay_starts_the_nodes_of_the_command(stiffness_bag, trained, tmp_path):
    nodes = launched('replay', bag=stiffness_bag, models=trained)
    assert nodes == as_dict(replay_graph(stiffness_bag, trained, tmp_path))


@pytest.mark.parametrize('value', ['true', 'True', '1'])
def test_every_node_gets_use_sim_time_and_autostart(value):
    for action in evaluate('texture', use_sim_time=value, autostart='False'):
        assert action.description.parameters['use_sim_time'] is True
        assert action.description.parameters['autostart'] is False


def test_recorder_is_not_restarted_and_the_tendon_actuator_restarts_first(tmp_path):
    for action in evaluate('texture', record=tmp_path / 'bag'):
        name = action.description.name
        assert action.process['respawn'] is (name != 'bag_recorder')
        assert action.process['respawn_delay'] == (0.2 if name == 'tendon_actuator' else 1.0)


def test_a_simulated_rig_is_started_unless_ports_are_given():
    (rig,) = evaluate('texture', rig='simulated')
    assert isinstance(rig, SimulatedRigProcess), 'the nodes come when its ports are there'
    running = {f'{name}_port': f'/tmp/{name}' for name in ('guide', 'tendon', 'sensor')}
    nodes = launched('texture', rig='simulated', **running)
    assert nodes['tendon_sensor'] == {'port': '/tmp/sensor', 'simulated': True}
    running = {'guide_port': '/tmp/guide', 'tendon_port': '/tmp/tendon', 'sensor_topic': '/ft'}
    nodes = launched('texture', rig='simulated', **running)
    assert nodes['tendon_sensor']['topic'] == '/ft'
    with pytest.raises(TactileError, match='also tendon_port, sensor_port'):
        evaluate('texture', rig='simulated', guide_port='/tmp/guide')
    (rig,) = evaluate('hand', rig='simulated', fingers='index,middle')
    words = [part.text for part, *_ in rig.cmd[1:]]
    first, second = words[words.index('--links') + 1 : words.index('--linger')]
    assert (Path(first).name, Path(second).name) == ('rig_index', 'rig_middle')


@pytest.mark.parametrize(
    ('name', 'values', 'sentence'),
    [
        ('replay', {'bag': 'nowhere'}, 'nowhere is not a readable bag'),
        ('replay', {'bag': 'nowhere', 'rate': 'fast'}, 'rate is "fast"'),
        ('hand', {}, 'name the fingers'),
        ('hand', {'fingers': 'a,b', 'sensor_port': '/dev/x'}, 'a sensor port belongs'),
        ('sense', {'autostart': 'maybe'}, 'autostart is "maybe"; it must be true or false'),
        ('texture', {'models': 'nowhere'}, 'nowhere: No such file'),
        ('texture', {'params_file': 'nowhere.yaml'}, 'nowhere.yaml'),
        ('texture', {'rig': 'simulated', 'object': 'R9'}, 'object is "R9"; for texture there are'),
        ('texture', {'guide_port': 'none'}, 'guide_port is none, but a trial moves the guide'),
        ('replay', {'bag': ''}, 'name the recording to play'),
        ('texture', {'log_level': 'loud'}, 'log_level'),
        (
            'texture',
            {'guide_port': '/dev/a', 'tendon_port': '/dev/a'},
            'have the same port /dev/a; give each its own port',
        ),
    ],
)
def test_contradictory_values_are_refused_with_a_sentence(name, values, sentence):
    with pytest.raises(Exception, match=sentence):
        evaluate(name, **values)


@pytest.mark.parametrize(
    ('word', 'sentence'),
    [
        ('modle:=x', 'there is no argument modle; did you mean models'),
        ('hand_file:=x', 'there is no argument hand_file'),
    ],
)
def test_undeclared_launch_argument_is_refused(monkeypatch, word, sentence):
    command = ['ros2', 'launch', 'tactile_bringup', 'sense.launch.py', word]
    monkeypatch.setattr(sys, 'argv', command)
    with pytest.raises(TactileError, match=sentence):
        evaluate('sense')
    # A launch file that includes these files may have additional arguments.
    monkeypatch.setattr(sys, 'argv', [*command[:2], 'my_robot', 'sense.launch.py', word])
    assert evaluate('sense', processes='node', model='of my robot')
