# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from builtin_interfaces.msg import Time
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from std_msgs.msg import Header

from tactile_features import (
    FeatureConfig,
    FeatureSpecifications,
    FeatureWindow,
    Outcome,
    records,
    TrialFeatureExtractor,
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
from tactile_msgs.msg import StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.errors import MessageError

uint32 = st.integers(0, 2**32 - 1)
uint64 = st.integers(0, 2**64 - 1)
stamps_ns = st.integers(0, 2**31 * 10**9 - 1)
# A ROS string ends at its first zero.
text = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=20)

windows = st.builds(
    FeatureWindow,
    feature_set=text,
    feature_set_version=uint32,
    trial_id=text,
    contact=st.sampled_from(['', 'flexion', 'abduction']),
    simulated=st.booleans(),
    outcome=st.sampled_from(Outcome),
    reason=text,
    values=st.lists(st.floats(allow_nan=False), max_size=5).map(
        lambda v: np.array(v, dtype=np.float64)
    ),
    window_start_ns=stamps_ns,
    window_end_ns=stamps_ns,
    first_sequence=uint64,
    rate_hz=st.floats(0, 1e5),
    sample_count=uint32,
    interpolated_count=uint32,
    status=st.integers(0, 63),
    frame_id=text,
)


@pytest.fixture(scope='module')
def typestore():
    store = get_typestore(Stores.ROS2_JAZZY)
    share = Path(get_package_share_directory('tactile_msgs'))
    for path in (share / 'msg').glob('*.msg'):
        store.register(get_types_from_msg(path.read_text(), f'tactile_msgs/msg/{path.stem}'))
    return store


@pytest.fixture(params=['rclpy', 'rosbags'])
def read(request, typestore):
    """Return a sent message as a library reads it."""

    def read(msg):
        data = serialize_message(msg)
        if request.param == 'rclpy':
            return deserialize_message(data, type(msg))
        return typestore.deserialize_cdr(data, f'tactile_msgs/msg/{type(msg).__name__}')

    return read


def test_reads_messages_of_either_library(read):
    header = Header(stamp=Time(sec=1_760_000_000, nanosec=999_999_999), frame_id='cell_link')
    msg = StrainBlock(
        header=header,
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

    msg = TrialEvent(
        header=header,
        trial_id='t1',
        session_id='s1',
        protocol='texture',
        contact='abduction',
        object_label='R2',
        phase='aborted',
        message='stopped',
        glide_speed_m_s=0.015,
        simulated=True,
        mounting_id='m1',
    )
    event = event_from_msg(read(msg))
    for field in dataclasses.fields(event):
        if field.name != 'stamp_ns':
            assert getattr(event, field.name) == getattr(msg, field.name)
    assert event.stamp_ns == 1_760_000_000_999_999_999
    assert event_from_msg(read(event_to_msg(event))) == event


@given(window=windows)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
def test_a_window_survives_the_wire_bit_for_bit(read, window):
    message = feature_window_to_msg(window)
    assert message.header.stamp == message.window_end
    assert feature_window_from_msg(read(message)) == window


@pytest.mark.parametrize(
    ('message', 'prefix', 'ours'),
    [
        (TrialEvent, 'PROTOCOL_', vars(records)),
        (TrialEvent, 'CONTACT_', vars(records)),
        (TrialEvent, 'PHASE_', vars(records)),
        (TactileFeatures, 'SET_', vars(records)),
        (TactileFeatures, 'OUTCOME_', {f'OUTCOME_{o.name}': o.value for o in Outcome}),
    ],
)
def test_constants_are_those_of_the_messages(message, prefix, ours):
    theirs = {
        name: getattr(message, name) for name in dir(type(message)) if name.startswith(prefix)
    }
    assert theirs
    assert {name: value for name, value in ours.items() if name.startswith(prefix)} == theirs


CONFIG = FeatureConfig(texture_crop_start_s=1 / 3, partial_samples=(60, 120), max_gap_samples=2)


def test_specifications_come_back_as_they_were(read):
    announced = FeatureSpecifications(
        TrialFeatureExtractor(CONFIG).wanted, dataclasses.asdict(CONFIG), 1_760_000_000_000_000_001
    )
    found = specifications_from_msg(read(specifications_to_msg(announced)))
    assert found.wanted == announced.wanted
    assert [s.digest for s in found.specs] == [s.digest for s in announced.specs]
    assert FeatureConfig(**found.config) == CONFIG
    assert found.stamp_ns == announced.stamp_ns


@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        (lambda m: m.specifications[0].parameter_values.pop(), 'they must be as many'),
        (lambda m: setattr(m.specifications[0], 'rate_hz', 61.0), 'one of them was changed'),
        (lambda m: setattr(m.specifications[0], 'rate_hz', 0.0), 'rate_hz is 0'),
        (lambda m: setattr(m, 'config', '[1]'), 'config is no JSON object'),
        (lambda m: setattr(m, 'config', '{'), 'config is not JSON'),
        (
            lambda m: m.specifications[0].parameter_values.__setitem__(0, '[]'),
            'cannot be read',
        ),
    ],
)
def test_specifications_that_are_wrong_are_refused(change, fault):
    message = specifications_to_msg(FeatureSpecifications(TrialFeatureExtractor(CONFIG).wanted))
    change(message)
    with pytest.raises(MessageError, match=fault):
        specifications_from_msg(message)
