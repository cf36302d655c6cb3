# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion of messages and records; invalid messages are refused with an error."""

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from tactile_features import (
    FeatureConfig,
    FeatureSpecifications,
    TrialFeatureExtractor,
    types,
    WindowOutcome,
)
from tactile_features.conversions import (
    event_from_msg,
    event_to_msg,
    feature_window_from_msg,
    feature_window_to_msg,
    specifications_from_msg,
    specifications_to_msg,
    strain_block_from_msg,
)
from tactile_msgs.msg import FeatureSpecification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.errors import MessageError

PHASES = ['approach', 'contact', 'glide', 'hold', 'release', 'return', 'done', 'aborted', 'pull']
PHASES_BY_NAME = {
    'PHASE_CONTACT' if name == 'PHASE_TOUCH' else name: value
    for name, value in vars(types).items()
}
"""Constants of `tactile_features.types` by the names that they have in the message."""
START_S = 1_760_000_000

long_runs = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))

floats = st.floats() | st.sampled_from([0.0, -1.0, 1e308, -1e308, 1e9, 5e-324])
int32 = st.integers(-(2**31), 2**31 - 1)
uint32 = st.integers(0, 2**32 - 1) | st.sampled_from([0, 2**32 - 1, 999_999_999, 10**9])
int64 = st.integers(-(2**63), 2**63 - 1) | st.sampled_from([0, -1, 1, 2**63 - 1, -(2**63)])
uint64 = st.integers(0, 2**64 - 1) | st.sampled_from([0, 1, 2**64 - 1, 2**63])
words = st.sampled_from(['', 'flexion', 'abduction', 'dance', *PHASES]) | st.text(
    st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=5
)


def strategy_of(kind):
    """Return a strategy for all values of a field of this type; None for any other type."""
    if kind.startswith('sequence<double>'):
        return st.lists(floats, max_size=4)
    return {
        'double': floats,
        'int64': int64,
        'uint64': uint64,
        'uint32': uint32,
        'uint8': st.integers(0, 255),
        'boolean': st.booleans(),
        'string': words,
    }.get(kind)


def mutations(message_type):
    """Return a strategy for dictionaries of changed fields; ``stamp`` is in the header."""
    fields = {
        name: strategy
        for name, kind in message_type.get_fields_and_field_types().items()
        if (strategy := strategy_of(kind)) is not None
    }
    stamps = st.tuples(int32, uint32)
    return st.dictionaries(st.sampled_from(['stamp', *fields]), st.none(), max_size=3).flatmap(
        lambda names: st.fixed_dictionaries({n: fields.get(n, stamps) for n in names})
    )


def mutate(message, changes):
    for name, value in changes.items():
        if name == 'stamp':
            message.header.stamp.sec, message.header.stamp.nanosec = value
        else:
            setattr(message, name, value)
    return message


def stream(changes_of_blocks, changes_of_events):
    """Yield the messages of two trials: for each second, its samples and then one event.

    The changes of each message are applied; their keys are the seconds.
    """
    generator = np.random.default_rng(1)
    for second in range(14):
        block = StrainBlock(
            sequence=60 * second,
            period_ns=16_666_667,
            tension_n=generator.normal(3.0, 0.1, 60),
        )
        block.header.stamp.sec = START_S + second
        yield mutate(block, changes_of_blocks.get(second, {}))
        event = TrialEvent(
            trial_id=f'trial-{second // 7}',
            protocol='texture',
            contact='flexion',
            phase=['approach', 'contact', 'glide', 'glide', 'hold', 'release', 'done'][second % 7],
            glide_speed_m_s=0.01,
        )
        event.header.stamp.sec = START_S + second
        yield mutate(event, changes_of_events.get(second, {}))


@pytest.mark.parametrize(
    ('message', 'prefix', 'ours'),
    [
        (TrialEvent, 'PROTOCOL_', vars(types)),
        (TrialEvent, 'CONTACT_', vars(types)),
        (TrialEvent, 'PHASE_', PHASES_BY_NAME),
        (TactileFeatures, 'SET_', vars(types)),
        (TactileFeatures, 'OUTCOME_', {f'OUTCOME_{o.name}': o.value for o in WindowOutcome}),
    ],
)
def test_constants_are_those_of_the_messages(message, prefix, ours):
    theirs = {
        name: getattr(message, name) for name in dir(type(message)) if name.startswith(prefix)
    }
    assert theirs
    assert {name: value for name, value in ours.items() if name.startswith(prefix)} == theirs


CONFIG = FeatureConfig(texture_crop_start_s=1 / 3, early_windows=True, max_gap_samples=2)


# -- messages that anybody may send --------------------------------------------------------

changes_of = {
    kind: st.dictionaries(st.integers(0, 13), mutations(kind), max_size=4)
    for kind in (StrainBlock, TrialEvent)
}


def block_message():
    return StrainBlock(period_ns=1, tension_n=[1.0])


def event_message():
    return TrialEvent(phase='hold')


@pytest.mark.parametrize(
    ('make', 'convert', 'convert_back'),
    [
        (block_message, strain_block_from_msg, lambda _: block_message()),
        (event_message, event_from_msg, event_to_msg),
        (TactileFeatures, feature_window_from_msg, feature_window_to_msg),
    ],
)
@given(data=st.data())
@settings(deadline=None)
def test_a_message_is_refused_or_converted_and_can_be_sent_on(make, convert, convert_back, data):
    message = make()
    try:
        record = convert(mutate(message, data.draw(mutations(type(message)))))
    except MessageError:
        return
    serialize_message(convert_back(record))


@given(changes=mutations(FeatureSpecification), values=st.lists(words, max_size=4))
@settings(deadline=None)
def test_a_specification_is_refused_or_that_of_its_digest(changes, values):
    specs = TrialFeatureExtractor(FeatureConfig()).specifications
    message = specifications_to_msg(FeatureSpecifications(specs))
    changes.pop('stamp', None)  # specifications have no header
    mutate(message.specifications[0], changes)
    message.specifications[1].parameter_values[: len(values)] = values
    try:
        found = specifications_from_msg(message)
    except MessageError:
        return
    assert found.specs == specs
    serialize_message(specifications_to_msg(found))


def test_a_refusal_says_nothing_that_a_terminal_obeys():
    phase = '\x1b[2J\x1b]0;owned\x07\nhold\u202e' + 'x' * 100_000
    with pytest.raises(MessageError, match=r'phase is "\?\[2J\?\]0;owned\?\?hold\?xxx') as refusal:
        event_from_msg(TrialEvent(phase=phase))
    assert str(refusal.value).isprintable()
    assert len(str(refusal.value)) < 400


@pytest.mark.parametrize(
    'config',
    [
        FeatureConfig(texture_samples=90, early_windows=True),
        FeatureConfig(texture_features='texture_spatial'),
        FeatureConfig(phases='texture'),
        FeatureConfig(phases='stiffness'),
    ],
    ids=['stated', 'spatial', 'texture found', 'stiffness found'],
)
@given(blocks=changes_of[StrainBlock], events=changes_of[TrialEvent])
@long_runs
def test_the_extractor_takes_all_that_is_not_refused(config, blocks, events):
    extractor = TrialFeatureExtractor(config)
    windows = []
    for message in stream(blocks, events):
        try:
            if isinstance(message, StrainBlock):
                windows += extractor.add_block(strain_block_from_msg(message))
            else:
                windows += extractor.add_event(event_from_msg(message))
        except MessageError:
            continue
        for event in extractor.take_detected_events():
            serialize_message(event_to_msg(event))
    for window in [*windows, *extractor.finish()]:
        serialize_message(feature_window_to_msg(window))


@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        (lambda m: m.specifications[0].parameter_values.pop(), 'both must have the same length'),
        (lambda m: setattr(m.specifications[0], 'rate_hz', 61.0), 'one of them was changed'),
        (lambda m: setattr(m.specifications[0], 'rate_hz', 0.0), 'rate_hz is 0'),
        (lambda m: setattr(m, 'config', '[1]'), 'config is not a JSON object'),
        (lambda m: setattr(m, 'config', '{'), 'config is not JSON'),
        (lambda m: m.specifications[0].parameter_values.__setitem__(0, '[]'), 'cannot be read'),
    ],
)
def test_what_is_wrong_with_specifications_is_said(change, fault):
    message = specifications_to_msg(
        FeatureSpecifications(TrialFeatureExtractor(CONFIG).specifications)
    )
    change(message)
    with pytest.raises(MessageError, match=fault):
        specifications_from_msg(message)


@pytest.mark.parametrize(
    ('make', 'convert', 'changes', 'fault'),
    [
        (block_message, strain_block_from_msg, changes, fault)
        for changes, fault in (
            ({'tension_n': []}, 'tension_n is empty'),
            ({'period_ns': -1}, 'period_ns is -1'),
            ({'period_ns': 0, 'tension_n': [1.0, 2.0]}, 'period_ns is 0'),
            ({'period_ns': 2**62, 'tension_n': [1.0, 2.0]}, 'exceeds the range of ROS time'),
            ({'sequence': 2**64 - 1, 'tension_n': [1.0, 2.0]}, 'do not fit into 64 bits'),
            ({'tension_n': [1.0, 1e300]}, '1e+300'),
            ({'status': 2**31 + 4}, 'its bits 2147483648 are unknown'),
            ({'stamp': (-1, 0)}, 'not a valid ROS time'),
            ({'stamp_error_s': float('inf')}, 'stamp_error_s is inf'),
        )
    ]
    + [
        (event_message, event_from_msg, changes, fault)
        for changes, fault in (
            ({'phase': 'dance'}, 'phase is "dance"; it must be one of approach, contact'),
            ({'contact': 'thumb'}, 'contact is "thumb"'),
            ({'protocol': 'smell'}, 'protocol is "smell"'),
            ({'glide_speed_m_s': float('nan')}, 'glide_speed_m_s is nan'),
        )
    ]
    + [
        (TactileFeatures, feature_window_from_msg, changes, fault)
        for changes, fault in (
            ({'outcome': 9}, 'outcome is 9; it must be one of 0 (OK), 1 (GAP)'),
            ({'contact': 'thumb'}, 'contact is "thumb"'),
            ({'rate_hz': float('inf')}, 'rate_hz is inf'),
            ({'status': 2**31}, 'are unknown'),
        )
    ],
)
def test_what_is_wrong_is_said(make, convert, changes, fault):
    with pytest.raises(MessageError) as caught:
        convert(mutate(make(), changes))
    assert fault in str(caught.value)


def test_values_that_are_not_finite_are_for_the_core():
    block = strain_block_from_msg(StrainBlock(period_ns=1, tension_n=[float('nan'), 1.0]))
    assert np.isnan(block.tension_n[0])


def test_features_of_another_set_are_for_another_node():
    assert feature_window_from_msg(TactileFeatures(feature_set='smell')).feature_set == 'smell'
