# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_ros.errors import TactileError


@pytest.mark.parametrize(
    ('key', 'namespace', 'matches'),
    [
        ('tactile_features', '', True),
        ('/tactile_features', '', True),
        ('tactile_features', 'thumb', False),
        ('/thumb/tactile_features', 'thumb', True),
        ('thumb/tactile_features', '/thumb', True),
        ('/thumb/tactile_features', 'index', False),
        ('/*/tactile_features', 'thumb', True),
        ('/*/tactile_features', '', False),
        ('/**/tactile_features', '', True),
        ('/**/tactile_features', 'hand/thumb', True),
        ('/**', 'thumb', True),
        ('/th.mb/tactile_features', 'thumb', False),
    ],
)
def test_an_entry_is_for_the_nodes_that_its_name_matches(parameter_file, key, namespace, matches):
    path = parameter_file(f'{key}: {{ros__parameters: {{rate_hz: 100.0}}}}')
    found = ParameterFile(path).of('tactile_features', namespace)
    assert found == ({'rate_hz': 100.0} if matches else {})


def test_later_entries_win_and_namespaces_may_nest(parameter_file):
    path = parameter_file(
        """
/**:
  ros__parameters: {rate_hz: 60.0, frame_id: tip}
thumb:
  tactile_features:
    ros__parameters: {rate_hz: 100.0}
"""
    )
    file = ParameterFile(path)
    assert file.of('tendon_sensor', 'thumb') == {'rate_hz': 60.0, 'frame_id': 'tip'}
    assert file.of('tactile_features', 'thumb') == {'rate_hz': 100.0, 'frame_id': 'tip'}
    assert file.of('linear_guide', 'thumb') == {'frame_id': 'tip'}, 'it has no rate_hz'


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('tendon_senser: {ros__parameters: {rate_hz: 60.0}}', 'tendon_senser.* tendon_sensor'),
        ('tendon_sensor: {ros__parameters: {prot: x}}', 'prot.* port'),
        ('a: {tendon_sensor: {ros__parameters: {colour: 1}}}', 'colour'),
        ('tendon_sensor: !!python/object/apply:os.system [true]', ''),
        pytest.param('[' * 5000, '', id='deep'),
        ('tendon_sensor: {rate_hz: 60.0}', '/tendon_sensor/rate_hz .*ros__parameters'),
        ('tendon_sensor:', '/tendon_sensor .*ros__parameters'),
        ('tendon_sensor: {ros__parameters: 3}', '/tendon_sensor'),
        ('- tendon_sensor', ''),
        ('tendon_sensor: {', ''),
        ('a: &x {ros__parameters: {b: 1}}\nc: *x', 'alias'),
        pytest.param(' ' * (2**20 + 1), 'larger', id='large'),
    ],
)
def test_what_is_no_parameter_file_for_these_nodes_is_refused(parameter_file, text, named):
    with pytest.raises(TactileError, match=named):
        ParameterFile(parameter_file(text))


def test_nodes_of_others_may_stand_in_the_file(parameter_file):
    text = (
        'controller_manager: {ros__parameters: {update_rate: 500}}\n'
        'tendon_sensor: {ros__parameters: {rate_hz: 60.0}}\n'
    )
    file = ParameterFile(parameter_file(text))
    file.refuse_others([''])
    assert file.of('tendon_sensor') == {'rate_hz': 60.0}
    with pytest.raises(TactileError, match=r'/tendon_sensor.* /a/'):
        file.refuse_others(['a', 'b'])


def test_nested_parameters_have_the_names_that_ros_gives_them(parameter_file):
    text = (
        'tendon_sensor:\n  ros__parameters:\n    qos_overrides:\n'
        '      /tendon_sensor/strain: {publisher: {depth: 7}}\n'
    )
    name = 'qos_overrides./tendon_sensor/strain.publisher.depth'
    assert ParameterFile(parameter_file(text)).of('tendon_sensor') == {name: 7}


@pytest.mark.parametrize(('place', 'above'), [('models/a.npz', True), ('/models', False)])
def test_a_place_of_models_counts_from_the_file(parameter_file, tmp_path, place, above):
    path = parameter_file(f'tactile_features: {{ros__parameters: {{models: {place}}}}}')
    found = ParameterFile(path).of('tactile_features')
    assert found == {'models': str(tmp_path / place) if above else place}


def test_without_a_file_nothing_is_said_and_one_that_is_not_there_is_named():
    file = ParameterFile()
    file.refuse_others([''])
    assert file.of('tendon_sensor') == {}
    assert file.fingers() == ()
    with pytest.raises(TactileError, match='nowhere'):
        ParameterFile(Path('nowhere.yaml'))
