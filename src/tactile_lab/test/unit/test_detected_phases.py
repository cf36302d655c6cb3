# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of simulated trials whose phases are found in the tension, not read from the events."""

import dataclasses

import numpy as np
import pytest

from tactile_bags import (
    BagWriter,
    EVENT,
    EVENT_TOPIC,
    STRAIN,
    STRAIN_TOPIC,
    TactileBag,
)
from tactile_bags.audit import audit_bag
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_windows
from tactile_features.records import Outcome

WITHIN_NS = 50_000_000


@pytest.fixture(scope='module')
def texture_bag(simulate_bag):
    return simulate_bag('texture', 'abduction', 1, seed=8)


def windows(path, phases):
    with TactileBag(path) as bag:
        config = dataclasses.replace(recorded_features(bag).config, phases=phases)
        return replay_windows(bag, RecordedFeatures(config), finish=True)


def check_each_trial_is_found(path, phases):
    stated, detected = windows(path, 'stated'), windows(path, phases)
    assert len(stated) == len(detected)
    for one, other in zip(stated, detected, strict=True):
        assert one.outcome == other.outcome == Outcome.OK
        assert abs(one.window_start_ns - other.window_start_ns) <= WITHIN_NS
        assert other.trial_id.startswith('detected-')
    return stated, detected


def test_every_press_is_found(stiffness_bag):
    stated, detected = check_each_trial_is_found(stiffness_bag, 'stiffness')
    # In newtons: the tension relaxes by some hundredths of one within the tolerance.
    np.testing.assert_allclose(
        [w.values[1] for w in detected], [w.values[1] for w in stated], atol=0.1
    )


def test_every_glide_is_found(texture_bag):
    check_each_trial_is_found(texture_bag, 'texture')


def test_an_audit_goes_by_the_stated_trials_where_others_were_found_beside_them(
    stiffness_bag, tmp_path
):
    both = tmp_path / 'both'
    with TactileBag(stiffness_bag) as bag, BagWriter(both, bag.metadata) as writer:
        found_topic = dataclasses.replace(EVENT_TOPIC, name='tactile_features/detected_events')
        strain, stated, found = map(writer.add_topic, (STRAIN_TOPIC, EVENT_TOPIC, found_topic))
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
