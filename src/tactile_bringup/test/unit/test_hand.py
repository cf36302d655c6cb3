# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

from tactile_bringup.launch_config.hand_file import Finger, parse_finger_names, read_hand
from tactile_ros.errors import TactileError

HAND = """
fingers:
  index:
    sensor_port: /dev/tactile/index
    models: models/texture_flexion.onnx
    phases: texture
    parameters:
      tendon_sensor: {scale: -1.0}
  middle:
"""


def test_fingers_are_read_with_paths_relative_to_the_file(hand_file, tmp_path):
    index, middle = read_hand(hand_file(HAND))
    assert index == Finger(
        'index',
        '/dev/tactile/index',
        tmp_path / 'models/texture_flexion.onnx',
        'texture',
        {'tendon_sensor': {'scale': -1.0}},
    )
    assert middle == Finger('middle')


def test_only_wanted_fingers_are_taken_in_their_order(hand_file):
    assert [f.name for f in read_hand(hand_file(HAND), ['middle', 'index'])] == ['middle', 'index']
    with pytest.raises(TactileError, match='does not describe thumb, only index, middle'):
        read_hand(hand_file(HAND), ['thumb'])


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('', 'is no hand file'),
        ('[index]', 'is no hand file'),
        ('fingers: {}', 'is no hand file'),
        ('fingers: {index: }\nthumbs: {}', 'is no hand file'),
        ('fingers: [', 'cannot read the hand'),
        ('fingers: {2nd: }', '"2nd" is no name for a finger'),
        ('fingers: {index: /dev/ttyUSB0}', 'index must hold names and values'),
        ('fingers: {index: {port: /dev/ttyUSB0}}', 'index has port; it can have sensor_port'),
        ('fingers: {index: {models: 3}}', 'models of index must be text'),
        ('fingers: {index: {model: m}}', 'model of index is now called models'),
        ('fingers: {index: {parameters: {rate_hz: 60.0}}}', 'below the name of their node'),
        ('fingers: {index: !!python/object/apply:os.system [true]}', 'cannot read the hand'),
        ('[' * 5000, 'cannot read the hand'),
        ('#' * 1_000_001, 'larger than 1000000 bytes'),
        ('fingers: {a: &x {}, b: *x}', 'YAML aliases'),
    ],
)
def test_a_file_of_another_form_is_refused_with_a_sentence(hand_file, text, sentence):
    with pytest.raises(TactileError, match=sentence):
        read_hand(hand_file(text))


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(TactileError, match='nowhere'):
        read_hand(Path('nowhere.yaml'))


def test_names_in_a_list():
    assert parse_finger_names('index, middle') == ('index', 'middle')
    assert parse_finger_names('') == ()
    with pytest.raises(TactileError, match='index is named twice'):
        parse_finger_names('index,index')
    with pytest.raises(TactileError, match='"ring finger" is no name'):
        parse_finger_names('ring finger')
