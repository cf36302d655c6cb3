# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch files are parsed as Python code, because ``launch`` is not on PyPI.

The tests in ``test/launch`` run them if ``launch`` is installed.
"""

import ast
from pathlib import Path
import re
import shlex

import pytest

from tactile_bringup.launch_config.graph import player_parameters, recorder_parameters
from tactile_bringup.launch_config.parameter_files import CONFIGS, has_parameter, ParameterFile
from tactile_lab.commands.sense import PHASES
from tactile_ros.node_program import find_node_class

ROOT = Path(__file__).resolve().parents[4]
BRINGUP = ROOT / 'src' / 'tactile_bringup'
LAUNCH_FOLDER = BRINGUP / 'launch'
WITH_NODES = ('rig', 'hand', 'replay')
INCLUDES = {'texture': 'rig', 'stiffness': 'rig', 'sense': 'hand'}
NODES = {
    'rig': {*CONFIGS} - {'bag_player'},
    'hand': {'tendon_sensor', 'tactile_features', 'tactile_classifier', 'bag_recorder'},
    'replay': {'tactile_features', 'tactile_classifier', 'bag_recorder', 'bag_player'},
}


@pytest.fixture
def tables(monkeypatch):
    """Return the module that generates the tables of docs/parameters.md."""
    monkeypatch.syspath_prepend(str(ROOT / 'docs'))
    return pytest.importorskip('parameters', reason='the packages are not in their repository')


def parse(name):
    return ast.parse((LAUNCH_FOLDER / f'{name}.launch.py').read_text())


def calls(name, function):
    """Return the keyword arguments of each call of a function in a launch file."""
    return [
        {word.arg: word.value for word in call.keywords}
        for call in ast.walk(parse(name))
        if isinstance(call, ast.Call) and getattr(call.func, 'id', '') == function
    ]


def test_every_launch_file_is_tested_and_documented(tables):
    names = {path.name.removesuffix('.launch.py') for path in LAUNCH_FOLDER.glob('*.py')}
    assert names == {*WITH_NODES, *INCLUDES}
    assert set(tables.ARGUMENTS_OF.values()) == set(WITH_NODES)


@pytest.mark.parametrize('name', WITH_NODES)
def test_launch_files_start_existing_executables(name):
    shown = []
    for words in calls(name, 'Node'):
        package, executable, node = (
            ast.literal_eval(words[key]) for key in ('package', 'executable', 'name')
        )
        module = find_node_class(executable).__module__
        assert (package, executable) == (module.split('.')[0], module.split('.')[-1])
        assert executable == f'{node}_node'
        for layer in words['parameters'].elts:
            if isinstance(layer, ast.Dict):
                for key in layer.keys:
                    assert has_parameter(node, ast.literal_eval(key)), (node, ast.dump(key))
        shown.append(node)
    assert set(shown) == NODES[name]
    assert len(shown) == len(set(shown))


def test_parameters_set_by_launch_helpers_exist():
    for node, made in {
        'bag_recorder': recorder_parameters('bag'),
        'bag_player': player_parameters('bag', 1.0, 'index'),
    }.items():
        assert all(has_parameter(node, key) for key in made)


@pytest.mark.parametrize(('name', 'included'), INCLUDES.items())
def test_short_launch_files_include_another_one(name, included, tables):
    text = (LAUNCH_FOLDER / f'{name}.launch.py').read_text()
    assert f"with_name('{included}.launch.py')" in text
    ((given,),) = (re.findall(r'launch_arguments=\{\'(\w+)\'', text),)
    assert given in [argument.name for argument in tables.read_launch_arguments(included)]


@pytest.mark.parametrize('name', WITH_NODES)
def test_every_launch_argument_is_described_and_used(name, tables):
    arguments = tables.read_launch_arguments(name)
    names = [argument.name for argument in arguments]
    assert len(names) == len(set(names))
    assert {'models', 'record', 'params_file', 'namespace', 'use_sim_time', 'autostart'} <= set(
        names
    )
    described = tables.build_argument_tables()
    for argument in arguments:
        assert len(argument.description) > 20
        assert not argument.choices or argument.default in (*argument.choices, '')
        assert f'| `{argument.name}` |' in described
    shared = {'params_file', 'use_sim_time', 'autostart', 'respawn', 'log_level'}
    text = (LAUNCH_FOLDER / f'{name}.launch.py').read_text()
    used = set(re.findall(r"arguments(?:\.\w+\(|\[)'(\w+)'", text))
    used |= {f'{port}_port' for port in ('guide', 'tendon', 'sensor')} & set(names)
    assert used == set(names) - shared


def test_command_line_has_the_choices_of_the_launch_files(tables):
    (phases,) = (a for a in tables.read_launch_arguments('hand') if a.name == 'phases')
    assert phases.choices == ('', *PHASES)


def test_service_uses_arguments_that_its_launch_file_has(tables):
    service = (BRINGUP / 'systemd' / 'tactile-hand.service').read_text()
    (start,) = re.findall(r'^ExecStart=(.*)$', service, re.MULTILINE)
    *_, commands = shlex.split(start)
    given = {word.partition(':=')[0] for word in commands.split() if ':=' in word}
    assert given
    assert given <= {argument.name for argument in tables.read_launch_arguments('hand')}


def test_parameter_file_of_the_rig_names_existing_parameters():
    file = ParameterFile(LAUNCH_FOLDER.parent / 'config' / 'rig.yaml')
    for namespace in ('', 'thumb'):
        file.refuse_others([namespace])
        for node, device in {
            'tendon_sensor': 'sensor',
            'linear_guide': 'guide',
            'tendon_actuator': 'tendon',
        }.items():
            parameters = file.of(node, namespace)
            assert parameters['port'] == f'/dev/tactile/{device}'
            CONFIGS[node](**parameters)
        guide = set(file.of('linear_guide', namespace)['heartbeat_topics'])
        assert guide == {'trial_runner/heartbeat', 'tendon_actuator/heartbeat'}
        tendon = set(file.of('tendon_actuator', namespace)['heartbeat_topics'])
        assert tendon == {'trial_runner/heartbeat', 'linear_guide/heartbeat'}
