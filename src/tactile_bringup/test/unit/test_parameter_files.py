# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from tactile_bringup.launch_config.parameter_files import read_parameters
from tactile_ros.errors import TactileError

NAMES = ('tendon_sensor', 'tactile_features')


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
        ('/tactile.features', '', False),
    ],
)
def test_an_entry_is_for_the_nodes_that_its_name_matches(parameter_file, key, namespace, matches):
    path = parameter_file(f'{key}: {{ros__parameters: {{rate_hz: 100.0}}}}')
    found = read_parameters(path, ['tactile_features'], namespace, others_allowed=True)
    assert found == ({'tactile_features': {'rate_hz': 100.0}} if matches else {})


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
    assert read_parameters(path, NAMES, 'thumb') == {
        'tendon_sensor': {'rate_hz': 60.0, 'frame_id': 'tip'},
        'tactile_features': {'rate_hz': 100.0, 'frame_id': 'tip'},
    }


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('tendon_senser: {ros__parameters: {rate_hz: 60.0}}', 'tendon_senser; there are /tendon'),
        ('tendon_sensor: {rate_hz: 60.0}', '/tendon_sensor/rate_hz has no ros__parameters'),
        ('tendon_sensor:', '/tendon_sensor has no ros__parameters'),
        ('tendon_sensor: {ros__parameters: 3}', 'have no names'),
        ('- tendon_sensor', 'node names are expected'),
        ('tendon_sensor: {', 'cannot read'),
        ('a: &x {ros__parameters: {b: 1}}\nc: *x', 'aliases'),
        (' ' * (2**20 + 1), 'larger than'),
    ],
)
def test_what_is_no_parameter_file_for_these_nodes_is_refused(parameter_file, text, message):
    with pytest.raises(TactileError, match=message):
        read_parameters(parameter_file(text), NAMES)


@pytest.mark.parametrize('name', ['texture_flexion_classifier', '/**/stiffness_classifier'])
def test_parameters_of_a_classifier_of_version_0_1_are_refused(parameter_file, name):
    path = parameter_file(f'{name}: {{ros__parameters: {{recalibration_trials: 5}}}}')
    with pytest.raises(TactileError, match='is now called tactile_classifier'):
        read_parameters(path, NAMES, others_allowed=True)
