# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages are converted to the same records, no matter whether rclpy or rosbags has read them."""

import dataclasses

from builtin_interfaces.msg import Time
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from tactile_bags.message_types import message_store
from tactile_features import (
    FeatureConfig,
    FeatureSpecifications,
    FeatureWindow,
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
from tactile_msgs.msg import StrainBlock

PHASES = ['approach', 'contact', 'glide', 'hold', 'release', 'return', 'done', 'aborted', 'pull']
CONFIG = FeatureConfig(texture_crop_start_s=1 / 3, early_windows=True, max_gap_samples=2)

uint32 = st.integers(0, 2**32 - 1) | st.sampled_from([0, 2**32 - 1, 999_999_999, 10**9])
uint64 = st.integers(0, 2**64 - 1) | st.sampled_from([0, 1, 2**64 - 1, 2**63])
words = st.sampled_from(['', 'flexion', 'abduction', 'dance', *PHASES]) | st.text(
    st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=5
)
stamps_ns = st.integers(0, 2**31 * 10**9 - 1)

OF_TYPE = {
    'str': words,
    'int': uint32,
    'bool': st.booleans(),
    'float': st.floats(allow_nan=False, allow_infinity=False),
}


def records_of(kind, **fields):
    """Return a Hypothesis strategy for records; fields that are not given are arbitrary."""
    others = {f.name: OF_TYPE[f.type] for f in dataclasses.fields(kind) if f.name not in fields}
    return st.builds(kind, **others, **fields)


contacts = st.sampled_from(['', 'flexion', 'abduction'])
events = records_of(
    types.TrialEvent,
    stamp_ns=stamps_ns,
    protocol=st.sampled_from(['', 'texture', 'stiffness', 'slip']),
    contact=contacts,
    phase=st.sampled_from(PHASES),
)
windows = records_of(
    FeatureWindow,
    contact=contacts,
    outcome=st.sampled_from(WindowOutcome),
    values=st.lists(st.floats(allow_nan=False), max_size=5).map(np.array),
    window_start_ns=stamps_ns,
    window_end_ns=stamps_ns,
    first_sequence=uint64,
    status=st.integers(0, 511),
)


@pytest.fixture(params=['rclpy', 'rosbags'])
def read(request):
    """Return a function that serialises a message and reads it with one of the two libraries."""

    def read(msg):
        data = serialize_message(msg)
        if request.param == 'rclpy':
            return deserialize_message(data, type(msg))
        return message_store().deserialize_cdr(data, f'tactile_msgs/msg/{type(msg).__name__}')

    return read


@pytest.mark.parametrize(
    ('sent', 'to_msg', 'from_msg'),
    [
        (events, event_to_msg, event_from_msg),
        (windows, feature_window_to_msg, feature_window_from_msg),
    ],
    ids=['event', 'window'],
)
@given(data=st.data())
@settings(deadline=None, suppress_health_check=list(HealthCheck), max_examples=40)
def test_a_record_survives_the_wire_bit_for_bit(read, sent, to_msg, from_msg, data):
    record = data.draw(sent)
    message = to_msg(record)
    assert from_msg(read(message)) == record
    for field in dataclasses.fields(record):  # fields of record and message
        if isinstance(value := getattr(record, field.name), (str, bool)):
            assert getattr(message, field.name, value) == value


def test_reads_blocks_of_either_library(read):
    msg = StrainBlock(
        header=Header(stamp=Time(sec=1_760_000_000, nanosec=999_999_999)),
        sequence=2**64 - 2,
        period_ns=16_666_667,
        tension_n=[0.1, -2.5],
        lost_before=3,
        stamp_error_s=0.01,
        status=StrainBlock.STATUS_STUCK,
    )
    block = strain_block_from_msg(read(msg))
    assert block.tension_n.tolist() == [0.1, -2.5]
    assert block.tension_n.dtype == np.float64
    assert block.stamp_ns == 1_760_000_000_999_999_999
    for name in ('sequence', 'period_ns', 'lost_before', 'status', 'stamp_error_s'):
        assert getattr(block, name) == getattr(msg, name)


def test_specifications_come_back_as_they_were(read):
    announced = FeatureSpecifications(
        TrialFeatureExtractor(CONFIG).specifications,
        dataclasses.asdict(CONFIG),
        1_760_000_000_000_000_001,
    )
    found = specifications_from_msg(read(specifications_to_msg(announced)))
    assert found.specs == announced.specs
    assert [s.digest for s in found.specs] == [s.digest for s in announced.specs]
    assert FeatureConfig(**found.config) == CONFIG
    assert found.stamp_ns == announced.stamp_ns
