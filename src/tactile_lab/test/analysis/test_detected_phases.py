# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Phases of simulated trials are detected in the tension, not read from the events."""

import dataclasses

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from tactile_analysis.datasets.feature_tables import compute_tables, open_trials
from tactile_bags import BagWriter, TactileBag
from tactile_bags.audit import audit_bag
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_features.conversions import event_to_msg, strain_block_from_msg
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.types import WindowOutcome
from tactile_ros.topics import EVENT, EVENT_TOPIC, STRAIN, STRAIN_TOPIC

WITHIN_NS = 50_000_000
FOUND_TOPIC = dataclasses.replace(EVENT_TOPIC, name='tactile_features/detected_events')


@pytest.fixture(scope='module')
def texture_bag(simulate_bag):
    return simulate_bag('texture', 'abduction', 1, seed=8)


def windows(path, phases):
    with TactileBag(path) as bag:
        config = dataclasses.replace(recorded_features(bag).config, phases=phases)
        return replay_phases(bag, RecordedFeatures(config), finish=True).windows


def check_each_trial_is_found(path, phases):
    stated, detected = windows(path, 'stated'), windows(path, phases)
    assert len(stated) == len(detected)
    for one, other in zip(stated, detected, strict=True):
        assert one.outcome == other.outcome == WindowOutcome.OK
        assert abs(one.window_start_ns - other.window_start_ns) <= WITHIN_NS
        assert other.trial_id.startswith('detected-')
    return stated, detected


def test_every_press_is_detected(stiffness_bag):
    stated, detected = check_each_trial_is_found(stiffness_bag, 'stiffness')
    # Compare the intercepts of the fitted lines. The tolerance allows for errors of the
    # detected start of the hold phase.
    np.testing.assert_allclose(
        [w.values[1] for w in detected], [w.values[1] for w in stated], atol=0.1
    )


def test_every_glide_is_detected(texture_bag):
    check_each_trial_is_found(texture_bag, 'texture')


def test_audit_uses_stated_trials_and_ignores_detected_ones(stiffness_bag, tmp_path):
    both = tmp_path / 'both'
    with TactileBag(stiffness_bag) as bag, BagWriter(both, bag.metadata) as writer:
        strain, stated, found = map(writer.add_topic, (STRAIN_TOPIC, EVENT_TOPIC, FOUND_TOPIC))
        for message in bag.messages(STRAIN, EVENT):
            if message.type_name == EVENT:
                later_ns = message.received_at_ns + 10_000_000
                writer.write_raw(stated, message.received_at_ns, message.data)
                renamed = message.data.replace(b'stiffness_flexion-', b'detected__flexion-')
                assert renamed != message.data
                writer.write_raw(found, later_ns, renamed)
            else:
                writer.write_raw(strain, message.received_at_ns, message.data)
    assert audit_bag(both) == audit_bag(stiffness_bag)


def record_hand(path, source, label):
    """Write a bag with samples and with the phases that the feature node detects in them."""
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


def test_recordings_of_a_hand_are_used_together_for_training(stiffness_bag, tmp_path):
    bags = [record_hand(tmp_path / name, stiffness_bag, name) for name in ('apple', 'sponge')]
    with open_trials(bags) as trials:
        tables, left_out = compute_tables(trials)
    table = tables['stiffness', 'flexion']
    assert left_out == ()
    assert sorted(table.labels) == ['apple'] * 15 + ['sponge'] * 15
    assert set(table.columns['session_id']) == {'apples', 'sponges'}
