# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from tactile_features.windows import SampleBuffer
from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 10


def block(sequence, values, *, stamp_ns=None, **fields):
    stamp_ns = sequence * PERIOD_NS if stamp_ns is None else stamp_ns
    return StrainBlock(stamp_ns, sequence, PERIOD_NS, np.array(values, dtype=float), **fields)


def make_buffer(*blocks, max_gap_samples=0, buffer_ns=10**6, capacity=10**6):
    buffer = SampleBuffer(buffer_ns, capacity, max_gap_samples)
    for item in blocks:
        buffer.add(item)
    return buffer


def columns(buffer, *names):
    return [buffer.samples[name].tolist() for name in names]


def test_samples_are_numbered_and_timed_one_by_one():
    buffer = make_buffer(block(5, [1, 2]), block(7, [3]), block(8, []))
    assert columns(buffer, 'sequence', 'stamp_ns') == [[5, 6, 7], [50, 60, 70]]
    assert columns(buffer, 'tension_n', 'hole') == [[1, 2, 3], [True, False, False]]
    assert buffer.watermark_ns == 70
    last = 2**64 - 2  # the largest sequence number has 64 bits
    assert columns(make_buffer(block(last, [1, 2], stamp_ns=0)), 'sequence') == [[last, last + 1]]


def test_an_empty_buffer():
    buffer = make_buffer()
    buffer.evict()
    assert buffer.watermark_ns is None
    assert buffer.first_at(0) == buffer.first_beyond(0) == 0


def test_a_stamp_that_steps_back_does_not_hide_samples():
    buffer = make_buffer(
        block(0, [1, 2]), block(2, [3], stamp_ns=30), block(3, [4], stamp_ns=25), block(4, [5, 6])
    )
    assert columns(buffer, 'stamp_ns') == [[0, 10, 30, 25, 40, 50]]
    assert columns(buffer, 'latest_ns') == [[0, 10, 30, 30, 40, 50]]
    assert (buffer.first_at(26), buffer.first_beyond(26), buffer.first_beyond(30)) == (2, 2, 4)


def test_interpolation_is_linear_in_time_and_tension():
    last = block(4, [8], status=4, stamp_ns=41, stamp_error_s=0.3)
    blocks = block(0, [1, 2], status=1, stamp_error_s=0.1), last
    buffer = make_buffer(*blocks, max_gap_samples=2)
    assert columns(buffer, 'tension_n', 'stamp_ns') == [[1, 2, 4, 6, 8], [0, 10, 20, 30, 41]]
    assert columns(buffer, 'status') == [[1, 1, 5, 5, 4]]
    assert columns(buffer, 'stamp_error_s') == [[0.1, 0.1, 0.3, 0.3, 0.3]]
    assert columns(buffer, 'interpolated') == [[False, False, True, True, False]]


@pytest.mark.parametrize(
    ('max_gap_samples', 'fields'),
    [
        (1, {}),
        (5, {'status': StrainStatus.RECONNECTED}),
        (5, {'lost_before': 3}),  # the sequence numbers skip only two samples
    ],
)
def test_what_must_not_be_filled_is_a_hole(max_gap_samples, fields):
    blocks = block(0, [1, 2]), block(4, [8], **fields)
    buffer = make_buffer(*blocks, max_gap_samples=max_gap_samples)
    assert columns(buffer, 'sequence', 'hole') == [[0, 1, 4], [True, False, True]]


def test_what_is_repeated_is_dropped_and_the_rest_is_kept():
    buffer = make_buffer(block(0, [1, 2, 3]), block(1, [9, 9]), block(1, [9, 9, 4], lost_before=1))
    assert columns(buffer, 'tension_n', 'hole') == [[1, 2, 3, 4], [True, False, False, False]]
    assert (buffer.late_sample_count, buffer.restart_count) == (4, 0)


def test_smaller_numbers_with_later_stamps_are_a_restart():
    buffer = make_buffer(block(7, [1, 2]), block(0, [3, 4], stamp_ns=95))
    assert columns(buffer, 'sequence', 'hole') == [[7, 8, 0, 1], [True, False, True, False]]
    assert buffer.restart_count == 1


def test_a_clock_set_back_empties_the_buffer():
    buffer = make_buffer(block(0, [1, 2], stamp_ns=5_000_000_000))
    assert not buffer.add(block(9, [1], stamp_ns=4_000_000_010))
    assert buffer.add(block(10, [3, 4], stamp_ns=2_000_000_000))
    assert columns(buffer, 'tension_n') == [[3, 4]]
    assert (buffer.watermark_ns, buffer.evicted_ns) == (2_000_000_010, None)


@pytest.mark.parametrize(
    ('limits', 'stamp_ns', 'evicted_ns'),
    [({'buffer_ns': 1000}, None, 48_980), ({'capacity': 101}, 0, 0)],
    ids=['in time', 'when stamps stand still'],
)
def test_memory_is_bounded(limits, stamp_ns, evicted_ns):
    buffer = make_buffer(**limits)
    for sequence in range(5000):
        buffer.add(block(sequence, [sequence], stamp_ns=stamp_ns))
        buffer.evict()
    assert columns(buffer, 'sequence') == [list(range(4899, 5000))]
    assert buffer.evicted_ns == evicted_ns
    assert len(buffer._data) < 2500
