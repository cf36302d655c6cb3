# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From readings to blocks: conversion to newtons, status, sequence numbers and grouping."""

from fractions import Fraction
from itertools import pairwise
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import (
    encode_reading,
    LineDecoder,
    LineReading,
    StrainStream,
    TendonSensorConfig,
)
from tendon_sensor_driver.clock import Batch, Instant, SampleClock
from tendon_sensor_driver.strain_stream import Stream

MS_NS = 1_000_000
SECOND_NS = 1_000_000_000
PERIOD_NS = 16_666_667
LOST = {200, 201, 350}
EXACT_NEWTONS = {
    'kg': Fraction('9.80665'),
    'g': Fraction('0.00980665'),
    'N': Fraction(1),
    'lbf': Fraction('0.45359237') * Fraction('9.80665'),
}


@pytest.mark.parametrize('unit', EXACT_NEWTONS)
@given(
    value=st.floats(-1e15, 1e15, allow_subnormal=False),
    scale=st.sampled_from([1.0, -1.0, 0.1, -419.7, 1e-7]),
    offset_n=st.sampled_from([0.0, -0.3, 1e6]),
)
def test_newtons_are_right_to_one_rounding_a_step(unit, value, scale, offset_n):
    stream = StrainStream(TendonSensorConfig(unit=unit, scale=scale, offset_n=offset_n))
    (block,) = stream.add_reading(LineReading(0, value, 0))
    product = Fraction(value) * Fraction(scale) * EXACT_NEWTONS[unit]
    exact = product + Fraction(offset_n)
    # Four numbers are rounded: the factor of the unit, its product with the scale, the product of
    # this with the value, and the sum with the offset.
    bound = (abs(product) * 3 + (abs(exact) if offset_n else 0)) * Fraction(2) ** -53
    assert abs(Fraction(float(block.tension_n[0])) - exact) <= max(bound, Fraction(5e-324))


@pytest.mark.parametrize('time_column', [0, -1])
def test_a_simulated_reading_marks_its_block_and_no_other(time_column):
    config = TendonSensorConfig(time_column=time_column, samples_per_block=1)
    stream, blocks = StrainStream(config), []
    for i, simulated in enumerate((True, False, True)):
        ticks = 17 * i if time_column == 0 else None
        blocks += stream.add_reading(LineReading(ticks, 1.0, 17 * i * MS_NS, simulated=simulated))
    blocks += stream.flush()
    assert [bool(b.status & StrainStatus.SIMULATED) for b in blocks] == [True, False, True]


def test_a_sine_goes_in_as_bytes_and_comes_out_as_newtons():
    config = TendonSensorConfig(samples_per_block=7, scale=-1.0)
    decoder, stream = LineDecoder(config), StrainStream(config)
    decoder.feed(b'\n', 0)
    expected, blocks = {}, []
    for i in range(600):
        if i in LOST:
            continue
        kilograms = round(0.5 + 0.3 * math.sin(i / 10), 5)
        expected[i] = -kilograms * 9.80665
        for reading in decoder.feed(
            encode_reading(i * 1000 // 60, kilograms), i * SECOND_NS // 60
        ):
            blocks += stream.add_reading(reading)
    blocks += stream.flush()
    samples = {b.sequence + i: n for b in blocks for i, n in enumerate(b.tension_n)}
    assert samples == pytest.approx(expected, rel=1e-15)
    assert stream.lost_samples == sum(b.lost_before for b in blocks) == len(LOST)


def test_saturation_and_host_time_are_flagged():
    config = TendonSensorConfig(unit='N', time_column=-1, value_column=0, saturation_n=15.0)
    stream = StrainStream(config)
    statuses = [
        stream.add_reading(LineReading(None, value, at_ns))[0].status
        for at_ns, value in enumerate([1.0, 15.0, -20.0, 14.999])
    ]
    host, saturated = StrainStatus.HOST_TIME, StrainStatus.SATURATED
    assert statuses == [host, host | saturated, host | saturated, host]


def test_dropped_bytes_and_reconnections_are_told_once():
    stream = StrainStream(TendonSensorConfig())
    (first,) = stream.add_reading(LineReading(0, 0.5, 0))
    stream.note_dropped_bytes()
    (second,) = stream.add_reading(LineReading(17, 0.5, 17_000_000))
    stream.note_reconnection()
    (third,) = stream.add_reading(LineReading(5017, 0.5, 5_017_000_000))
    (fourth,) = stream.add_reading(LineReading(5033, 0.5, 5_033_000_000))
    blocks = (first, second, third, fourth)
    assert [block.status for block in blocks] == [
        StrainStatus.OK,
        StrainStatus.RESYNCHRONISED,
        StrainStatus.RECONNECTED,
        StrainStatus.OK,
    ]
    assert [block.lost_before for block in blocks] == [0, 0, 299, 0]


def test_a_device_restart_is_told_although_the_link_held():
    stream = StrainStream(TendonSensorConfig())
    for ticks in range(90_000, 91_000, 17):
        (last,) = stream.add_reading(LineReading(ticks, ticks / 1e5, ticks * 1_000_000))
    assert stream.add_reading(LineReading(40, 0.5, 93_000_000_000)) == []
    (after,) = stream.add_reading(LineReading(57, 0.5, 93_017_000_000))
    assert after.status == (
        StrainStatus.RECONNECTED | StrainStatus.RESTARTED | StrainStatus.RESYNCHRONISED
    )
    assert (after.sequence, after.lost_before) == (last.sequence + 1, 0)
    assert (stream.clock.outliers, stream.clock.restarts) == (1, 1)


def test_a_board_without_a_clock_counts_as_restarted_when_it_is_back():
    stream = StrainStream(TendonSensorConfig(time_column=-1))
    stream.add_reading(LineReading(None, 0.5, 0))
    stream.note_reconnection()
    (back,) = stream.add_reading(LineReading(None, 0.6, 5_000_000_000))
    (after,) = stream.add_reading(LineReading(None, 0.5, 5_017_000_000))
    both = StrainStatus.RECONNECTED | StrainStatus.RESTARTED
    assert (back.status & both, after.status & both) == (both, 0)
    assert stream.clock.restarts == 1


@pytest.mark.parametrize(('stuck_s', 'stuck'), [(0.5, [*range(30, 50), 81]), (0.0, [])])
def test_a_value_that_stays_exactly_the_same_is_stuck_until_it_changes(stuck_s, stuck):
    stream = StrainStream(TendonSensorConfig(stuck_s=stuck_s))
    values = [0.5] * 50 + [0.6] + [0.5] * 31
    blocks = [
        stream.add_reading(LineReading(1000 * i // 60, v, i))[0] for i, v in enumerate(values)
    ]
    assert [i for i, block in enumerate(blocks) if block.status == StrainStatus.STUCK] == stuck
    assert sum(block.status == StrainStatus.OK for block in blocks) == len(values) - len(stuck)


# -- grouping ------------------------------------------------------------------------------


def at(ms, *, error_s=0.001):
    return Instant(ms * MS_NS, 10**18 + ms * MS_NS, error_s)


class StatedClock(SampleClock):
    """Clock that returns the `Instant` in its attribute ``instant``, which tests set."""

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
def test_milliseconds_at_60_hz_make_no_false_gap(drift_ppm):
    stream = make(1000)
    count = 200 * 60
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


def test_a_block_ends_before_every_change():
    stream = make(100)
    saturated, dropped = StrainStatus.SATURATED, StrainStatus.RESYNCHRONISED
    blocks = add(stream, at(0), 0.0)
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
    # The error of the clock is 1 ms, and the sample at 16 ms deviates from the period by 2/3 ms.
    assert block.stamp_error_s == pytest.approx(0.001 + 0.000666667)


def test_blocks_are_larger_while_the_tendon_is_at_rest_unless_their_size_is_stated():
    stream = make(0)
    stream.set_at_rest(True)
    sizes = [len(block.tension_n) for block in run(stream, [at(16 * n) for n in range(7)])]
    assert sizes == [3, 3, 1]
    assert run(stream, [at(200), at(216)])[0].tension_n.tolist() == [0, 1]
    assert add(stream, at(300), 0.0) == add(stream, at(316), 1.0) == []
    stream.set_at_rest(False)  # the next sample ends the larger block
    assert [b.tension_n.tolist() for b in add(stream, at(333), 2.0)] == [[0, 1], [2]]
    for rate_hz, samples in ((25.0, 1), (59.0, 2), (60.0, 3), (100.0, 5)):
        assert TendonSensorConfig(rate_hz=rate_hz).rest_block_samples == samples
    stated = make(2)
    stated.set_at_rest(True)
    assert [len(b.tension_n) for b in run(stated, [at(16 * n) for n in range(4)])] == [2, 2]


def test_one_unknown_error_makes_the_error_of_the_block_unknown():
    stream = make(3)
    (block,) = run(stream, [at(0), at(16, error_s=-1.0), at(33)])
    assert block.stamp_error_s < 0


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
