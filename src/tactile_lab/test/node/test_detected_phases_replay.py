# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings replayed through nodes: with phases found in the tension, and one of version 0.1."""

import dataclasses
from pathlib import Path

from rclpy.serialization import serialize_message
from tactile_command import ask_tactile

from tactile_bags import BagWriter, EVENT_TOPIC, STRAIN, STRAIN_TOPIC, TactileBag
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import compare, replay_through_core
from tactile_bringup.nodes.replay_nodes import replay_through_nodes
from tactile_features.conversions import event_to_msg, strain_block_from_msg
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_lab.datasets.feature_tables import read_tables

FOUND_TOPIC = dataclasses.replace(EVENT_TOPIC, name='tactile_features/detected_events')


def test_nodes_answer_a_recording_of_version_0_1_as_it_was_answered():
    folder = Path(__file__).parents[1] / 'data' / 'recorded_by_0_1'
    told = ask_tactile('replay', folder / 'recording', '--models', folder / 'models')
    assert told['equal'], told
    compared = told['fingers'][0]['comparisons']
    assert set(compared) == {'recorded and plain core', 'plain core and nodes'}
    for one in compared.values():
        assert not one['left_out']
        assert (one['window_count'], one['classification_count']) == (3, 3)


def test_nodes_find_the_phases_that_the_core_finds(stiffness_bag, context):
    with TactileBag(stiffness_bag) as bag:
        config = dataclasses.replace(recorded_features(bag).config, phases='stiffness')
        core = replay_through_core(bag, None, RecordedFeatures(config))
        nodes = replay_through_nodes(bag, None, config, context, expected=core)
    comparison = compare(core, nodes, ('core', 'nodes'))
    assert comparison.first_difference == ''
    assert comparison.window_count == 15


def record_hand(path, source, label):
    """Write what a hand without a rig records: strain, and the phases found in it."""
    with TactileBag(source) as bag:
        config = dataclasses.replace(
            recorded_features(bag).config,
            phases='stiffness',
            detected_contact='flexion',
            detected_object_label=label,
            detected_session_id=f'{label}s',
        )
        extractor = TrialFeatureExtractor(config)
        with BagWriter(
            path, {**bag.metadata, 'feature_config': dataclasses.asdict(config)}
        ) as writer:
            strain, found = writer.add_topic(STRAIN_TOPIC), writer.add_topic(FOUND_TOPIC)
            for message in bag.messages(STRAIN):
                writer.write_raw(strain, message.received_at_ns, message.data)
                extractor.add_block(strain_block_from_msg(message.decode()))
                for event in extractor.take_detected_events():
                    data = serialize_message(event_to_msg(event))
                    writer.write_raw(found, message.received_at_ns, data)
    return path


def test_recordings_of_a_hand_train_together(stiffness_bag, tmp_path):
    bags = [record_hand(tmp_path / name, stiffness_bag, name) for name in ('apple', 'sponge')]
    read = read_tables(bags)
    table = read.tables['stiffness', 'flexion']
    assert read.left_out == ()
    assert sorted(table.labels) == ['apple'] * 15 + ['sponge'] * 15
    assert set(table.columns['session_id']) == {'apples', 'sponges'}
