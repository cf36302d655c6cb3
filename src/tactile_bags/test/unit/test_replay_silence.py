# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""If a sensor dies in the phase ``hold``, a replay refuses the same windows as the node."""

import dataclasses

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from tactile_bags import BagWriter, TactileBag
from tactile_bags.recorded_setup import computable_features, recorded_features
from tactile_bags.replay import (
    compare,
    recorded_results,
    replay_phases,
    replay_through_core,
    ROUNDING,
    TactileResults,
)
from tactile_features import FeatureConfig, TrialEvent, TrialFeatureExtractor, WindowOutcome
from tactile_features.conversions import (
    event_to_msg,
    feature_window_to_msg,
    strain_block_from_msg,
)
from tactile_features.extraction.extractor import GRACE_S
from tactile_ros.strain import StrainBlock, StrainStatus
from tactile_ros.topics import (
    EVENT_TOPIC,
    FEATURES_TOPIC,
    JOINT_STATE,
    RecordedTopic,
    STRAIN_TOPIC,
)
from tendon_sensor_driver.conversions import to_strain_msg

S = 1_000_000_000
START_NS = 1_760_000_000 * S
PERIOD_NS = 16_666_667
CONFIG = FeatureConfig()
GUIDE = RecordedTopic('linear_guide/joint_states', JOINT_STATE)
NAMES = ('the recording', 'the core')


def block(first, count, status=StrainStatus.OK):
    tension_n = np.random.default_rng(first).normal(5.0, 0.1, count)
    stamp_ns = START_NS + first * PERIOD_NS
    return StrainBlock(stamp_ns, first, PERIOD_NS, tension_n, stamp_error_s=0.001, status=status)


def event(time_s, phase, trial_id='t1'):
    stamp_ns = START_NS + round(time_s * S)
    return TrialEvent(stamp_ns, trial_id, 's1', 'stiffness', 'flexion', 'R1', phase)


def write_bag(path, inputs, timed_out_s, end_s):
    """Write a bag with the inputs and outputs of a feature node.

    The node stops waiting for samples at ``timed_out_s``.
    """
    extractor = TrialFeatureExtractor(CONFIG)
    with BagWriter(path, {'feature_config': dataclasses.asdict(CONFIG)}) as writer:
        names = {
            topic.name: writer.add_topic(topic)
            for topic in (STRAIN_TOPIC, EVENT_TOPIC, FEATURES_TOPIC, GUIDE)
        }

        def write(topic, time_s, message):
            arrived_ns = START_NS + round(time_s * S)
            writer.write_raw(names[topic.name], arrived_ns, serialize_message(message))

        for item in inputs:
            if isinstance(item, TrialEvent):
                time_s = (item.stamp_ns - START_NS) / S + 0.001
                message, topic = event_to_msg(item), EVENT_TOPIC
            else:
                end_ns = item.stamp_ns + len(item.tension_n) * PERIOD_NS
                time_s = (end_ns - START_NS) / S
                message, topic = to_strain_msg(item, 'link'), STRAIN_TOPIC
            if timed_out_s < time_s:
                for window in extractor.time_out():
                    write(FEATURES_TOPIC, timed_out_s, feature_window_to_msg(window))
            write(topic, time_s, message)
            windows = (
                extractor.add_event(item)
                if isinstance(item, TrialEvent)
                else extractor.add_block(strain_block_from_msg(message))
            )
            for window in windows:
                write(FEATURES_TOPIC, time_s + 0.002, feature_window_to_msg(window))
        if timed_out_s < end_s:
            for window in extractor.time_out():
                write(FEATURES_TOPIC, timed_out_s, feature_window_to_msg(window))
        writer.write_raw(names[GUIDE.name], START_NS + round(end_s * S), b'\0\1\0\0')


DIED = [block(60 * i, 60) for i in range(3)]
HOLD = [event(2.0, 'hold'), event(6.0, 'release')]
GIVEN_UP_S = 6.0 + CONFIG.samples_timeout_s + GRACE_S + 0.25
BACK = [block(n, 60, StrainStatus.RECONNECTED) for n in (900, 960, 1020, 1080, 1140, 1200)]
NEXT = [event(15.0, 'hold', 't2'), *BACK, event(20.0, 'done', 't2')]


@pytest.mark.parametrize(
    ('inputs', 'end_s', 'count'),
    [
        ([*DIED, *HOLD], 60.0, 1),
        ([*DIED, *HOLD], 7.0, 0),
        ([*DIED, *HOLD, *NEXT], 60.0, 2),
        ([*DIED, HOLD[0], HOLD[1], event(8.0, 'done'), event(300.0, 'approach', 't3')], 300.1, 1),
    ],
    ids=['to the end', 'recording ends before', 'sensor comes back', 'an event much later'],
)
def test_a_replay_gives_up_what_the_node_gave_up(tmp_path, inputs, end_s, count):
    write_bag(tmp_path / 'bag', inputs, GIVEN_UP_S, end_s)
    with TactileBag(tmp_path / 'bag') as bag:
        assert bag.end_ns == START_NS + round(end_s * S)
        recorded = recorded_results(bag)
        core = replay_through_core(bag, None, recorded_features(bag))
    assert len(recorded.windows) == count
    assert compare(recorded, core, NAMES).first_difference is None
    if count:
        assert recorded.windows[0].outcome == WindowOutcome.GAP


@pytest.mark.parametrize(
    ('other', 'is_equal'),
    [([1.0 + 2e-16, 3e-17], True), ([1.0 + 1e-6, 3e-17], False), ([1.0, 1e-6], False)],
)
def test_rounding_of_another_processor_is_no_difference_but_not_exact(tmp_path, other, is_equal):
    write_bag(tmp_path / 'bag', [*DIED, *HOLD], GIVEN_UP_S, 60.0)
    with TactileBag(tmp_path / 'bag') as bag:
        (window,) = replay_through_core(bag, None, recorded_features(bag)).windows
    one, two = (
        TactileResults([dataclasses.replace(window, values=np.array(values))])
        for values in ([1.0, 1e-17], other)
    )
    assert not compare(one, two, NAMES).is_equal
    found = compare(one, two, NAMES, rounding=ROUNDING)
    assert (found.is_equal, found.is_exact) == (is_equal, False)
    assert compare(one, one, NAMES, rounding=ROUNDING).is_exact


@pytest.mark.parametrize('rate_hz', [60, 100, 1000])
def test_features_are_computed_at_the_rate_of_the_samples(tmp_path, rate_hz):
    """In the recording, the feature node expected 60 Hz and refused windows of other rates."""
    period_ns = round(S / rate_hz)
    tension_n = np.random.default_rng(1).normal(5.0, 0.1, 8 * rate_hz)
    samples = StrainBlock(START_NS, 0, period_ns, tension_n, stamp_error_s=0.001)
    write_bag(tmp_path / 'bag', [samples, *HOLD], GIVEN_UP_S, 60.0)
    with TactileBag(tmp_path / 'bag') as bag:
        (recorded,) = replay_phases(bag, recorded_features(bag), finish=True).windows
        assert recorded.outcome == (
            WindowOutcome.OK if rate_hz == 60 else WindowOutcome.BAD_SIGNAL
        )
        features = computable_features(bag)
        (window,) = replay_phases(bag, features, finish=True).windows
    assert window.outcome == WindowOutcome.OK
    assert {spec.rate_hz for spec in features.specifications} == {float(rate_hz)}
