# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile replay` and `tactile repair` on recordings that are made from simulated bags."""

import json

import pytest
from rclpy.serialization import serialize_message
from tactile_command import tactile

from tactile_bags import BagWriter, TactileBag
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import replay_phases
from tactile_features.conversions import feature_window_to_msg
from tactile_ros.topics import FEATURES_TOPIC, STRAIN


def record(source, target, lose=()):
    """Copy a simulated bag, and add the features that nodes would have published.

    The strain messages whose indices are in ``lose`` were received by the nodes, but not recorded.
    """
    with TactileBag(source) as bag, BagWriter(target, bag.metadata) as writer:
        for topic in bag.stored_topics:
            writer.add_stored_topic(topic)
        features = writer.add_topic(FEATURES_TOPIC)
        number = -1
        for message in bag.messages():
            number += message.type_name == STRAIN
            if message.type_name != STRAIN or number not in lose:
                writer.write_raw(message.topic, message.received_at_ns, message.data)
        for window in replay_phases(bag, recorded_features(bag)).windows:
            data = serialize_message(feature_window_to_msg(window))
            writer.write_raw(features, window.window_end_ns, data)
    return target


@pytest.mark.parametrize('lose', [(), {7}])
def test_replay_is_repeated_until_a_difference_and_prints_audits(stiffness_bag, tmp_path, lose):
    bag = record(stiffness_bag, tmp_path / 'bag', lose)
    done = tactile('replay', bag, '--no-nodes', '--times', 2, '--json')
    assert done.returncode == bool(lose)
    (finger,) = json.loads(done.stdout)['fingers']
    assert finger['replays'] == (1 if lose else 2)
    assert finger['audit']['trials'] == 15
    assert finger['audit']['failed_trials'] == bool(lose)
    assert ('samples lost: ' in done.stderr) == bool(lose)


TENSION_BYTE, LENGTH_BYTE = 48, 15
"""Offsets in a serialized message: its first tension value, and the length of its frame id."""


@pytest.mark.parametrize('damage', [0, TENSION_BYTE, LENGTH_BYTE])
def test_repair_makes_a_closed_copy(stiffness_bag, tmp_path, damage):
    source = record(stiffness_bag, tmp_path / 'bag')
    (path,) = source.glob('*.mcap')
    data = bytearray(path.read_bytes())
    if damage:
        with TactileBag(source) as bag:
            *_, message = bag.messages(STRAIN)
        data[data.index(message.data) + damage] ^= 1
        path.write_bytes(data)
    else:
        path.write_bytes(data[: -len(data) // 50])
    done = tactile('repair', source, '-o', tmp_path / 'copy', '--json')
    assert done.returncode == bool(damage), done.stderr
    assert ('not audited' in done.stderr) == (damage == LENGTH_BYTE)
    result = json.loads(done.stdout)
    assert result['recovered']
    assert bool(result['damage']) == bool(damage)
    with TactileBag(tmp_path / 'copy') as bag:
        assert bag.recovered is None
        assert len(list(bag.messages())) == result['message_count']
        assert bag.metadata.get('repair_is_partial', False) == bool(damage)
