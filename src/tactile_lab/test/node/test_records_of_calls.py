# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The feature stage gets the same record of a strain block from memory and from a message."""

import dataclasses

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_features.conversions import check_record, strain_block_from_msg
from tactile_ros.errors import MessageError
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.conversions import to_strain_msg

BLOCKS = st.builds(
    StrainBlock,
    stamp_ns=st.integers(0, 2**31 * 10**9 + 10**9),
    sequence=st.integers(0, 2**64 - 1),
    period_ns=st.integers(-1, 2**40),
    tension_n=st.lists(
        st.floats(allow_nan=True, allow_infinity=True)
        | st.floats(-100.0, 100.0)
        | st.sampled_from([1e9, 1.1e9, -0.0, 5e-324]),
        min_size=0,
        max_size=20,
    ).map(lambda values: np.array(values, dtype=np.float64)),
    lost_before=st.integers(0, 2**64 - 1),
    stamp_error_s=st.floats(allow_nan=True, allow_infinity=True),
    status=st.integers(0, 255).map(StrainStatus),
)


def convert(convert_one, given_one):
    """Return the fields of the converted record as text, or the reason why conversion fails."""
    try:
        record = convert_one(given_one)
    except MessageError as error:
        return str(error)
    fields = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    assert all(type(fields[n]) is int for n in ('stamp_ns', 'sequence', 'lost_before'))
    assert type(fields['status']) is StrainStatus
    fields['tension_n'] = fields['tension_n'].tobytes()
    return repr(fields)


@settings(deadline=None, max_examples=300)
@given(BLOCKS)
def test_block_is_the_same_record_in_memory_and_in_a_message(block):
    try:
        message = to_strain_msg(block, 'sensor')
    except AssertionError:  # rclpy refuses a stamp that is out of range
        assert block.stamp_ns >= 2**31 * 10**9
        return
    assert convert(check_record, block) == convert(strain_block_from_msg, message)


def test_shared_records_cannot_be_changed():
    block = StrainBlock(0, 0, 1, np.ones(3))
    record = check_record(block)
    with pytest.raises(ValueError, match='read-only'):
        record.tension_n[0] = 2.0
    block.tension_n[0] = 2.0  # the array of the original block is still writable
