# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import TendonSensorConfig
from tendon_sensor_driver.clock import Batch, Instant, SampleClock
from tendon_sensor_driver.strain_stream import Stream

MS_NS = 1_000_000
PERIOD_NS = 16_666_667


def at(ms, *, error_s=0.001, is_restart=False):
    return Instant(ms * MS_NS, 10**18 + ms * MS_NS, error_s, is_restart)


class StatedClock(SampleClock):
    """Places samples at instants that a test states."""

    def place(self, ticks, received_at_ns):
        return self.instant


def make(samples_per_block):
    config = TendonSensorConfig(samples_per_block=samples_per_block, stuck_s=0.0)
    return Stream(config, StatedClock(PERIOD_NS))


def add(stream, instant, tension_n, status=StrainStatus.OK):
    stream.clock.instant = instant
    statuses = np.array([int(status)], dtype=np.uint32)
    return stream.add(Batch(0, np.array([tension_n]), status=statuses))


def run(stream, samples):
    blocks = []
    for i, sample in enumerate(samples):
        blocks += add(stream, sample, float(i))
    return blocks + stream.flush()


@pytest.mark.parametrize('drift_ppm', [-100, 100])
def test_milliseconds_at_60_hz_make_no_false_gap_in_half_an_hour(drift_ppm):
    stream = make(1000)
    count = 1800 * 60
    sequence = 0
    for i in range(count):
        true_ns = i * 10**9 // 60
        device_ms = true_ns * (1_000_000 + drift_ppm) // 10**12
        for block in add(stream, at(device_ms), 0.0):
            assert block.lost_before == 0
            assert block.sequence == sequence
            sequence += len(block.tension_n)
    assert stream.lost_samples == 0
    assert sequence == count


@pytest.mark.parametrize('drift_ppm', [-100, 100])
@pytest.mark.parametrize('lost', [1, 2, 59, 600, 3600])
@pytest.mark.parametrize('phase', range(3))
def test_the_samples_of_a_gap_are_counted_exactly(drift_ppm, lost, phase):
    numbers = [*range(phase + 7), *range(phase + 7 + lost, phase + 20 + lost)]
    samples = [at(n * 1000 * (1_000_000 + drift_ppm) // 60_000_000) for n in numbers]
    before, after = run(make(100), samples)
    assert (before.sequence, before.lost_before) == (0, 0)
    assert (after.sequence, after.lost_before) == (phase + 7 + lost, lost)


def test_samples_that_come_too_often_are_all_kept():
    blocks = run(make(1), [at(ms) for ms in range(0, 100, 5)])
    assert [block.sequence for block in blocks] == list(range(20))


@pytest.mark.parametrize('ms', [10, 90_000])
def test_a_restart_goes_on_counting_and_claims_no_loss(ms):
    stream = make(1)
    run(stream, [at(1000), at(1017)])
    (block,) = add(stream, at(ms, is_restart=True), 0.0)
    assert (block.sequence, block.lost_before) == (2, 0)


def test_a_block_ends_before_every_change():
    stream = make(100)
    saturated, dropped = StrainStatus.SATURATED, StrainStatus.RESYNCHRONISED
    blocks = []
    blocks += add(stream, at(0), 0.0)
    blocks += add(stream, at(16), 1.0)
    blocks += add(stream, at(33), 2.0, saturated)
    blocks += add(stream, at(50), 3.0)
    stream.note_dropped_bytes()
    blocks += add(stream, at(66), 4.0)
    blocks += add(stream, at(83), 5.0)
    blocks += add(stream, at(116), 6.0)
    blocks += stream.flush()
    assert [block.tension_n.tolist() for block in blocks] == [[0, 1], [2], [3], [4, 5], [6]]
    assert [block.sequence for block in blocks] == [0, 2, 3, 4, 7]
    assert [block.status for block in blocks] == [0, saturated, 0, dropped, 0]
    assert [block.lost_before for block in blocks] == [0, 0, 0, 0, 1]
    assert stream.flush() == []


def test_a_full_block_leaves_at_once():
    stream = make(3)
    assert add(stream, at(0), 0.0) == add(stream, at(16), 1.0) == []
    (block,) = add(stream, at(33), 2.0)
    assert block.tension_n.dtype == np.float64
    assert block.stamp_ns == 10**18
    # One millisecond is the clock's own error, 2/3 ms that 16 ms is no whole period.
    assert block.stamp_error_s == pytest.approx(0.001 + 0.000666667)


def test_one_unknown_error_makes_the_error_of_the_block_unknown():
    stream = make(3)
    samples = [at(0), at(16, error_s=-1.0), at(33)]
    (block,) = run(stream, samples)
    assert block.stamp_error_s < 0


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.sampled_from([5, 12, 16, 17, 17, 20, 33, 50, 400]), min_size=1, max_size=60),
    st.integers(1, 10),
)
def test_no_sample_is_lost_or_moved_by_the_grouping(steps_ms, samples_per_block):
    times = np.cumsum(steps_ms).tolist()
    samples = [at(ms) for ms in times]
    singles = run(make(1), samples)
    blocks = run(make(samples_per_block), samples)
    assert max(len(block.tension_n) for block in blocks) <= samples_per_block
    rows = [
        (block.sequence + i, tension_n, block.stamp_ns + i * PERIOD_NS)
        for block in blocks
        for i, tension_n in enumerate(block.tension_n)
    ]
    for row, single in zip(rows, singles, strict=True):
        assert row[:2] == (single.sequence, single.tension_n[0])
        assert 2 * abs(row[2] - single.stamp_ns) <= PERIOD_NS
    assert sum(b.lost_before for b in blocks) == sum(b.lost_before for b in singles)
    for before, after in pairwise(blocks):
        assert after.sequence == before.sequence + len(before.tension_n) + after.lost_before
