# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The chain from readings to blocks, without a port."""

from fractions import Fraction
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import (
    encode_reading,
    LineDecoder,
    Reading,
    StrainStream,
    TendonSensorConfig,
)

SECOND_NS = 1_000_000_000
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
)
def test_newtons_are_right_to_three_roundings(unit, value, scale):
    stream = StrainStream(TendonSensorConfig(unit=unit, scale=scale))
    (block,) = stream.add_reading(Reading(0, value, 0))
    exact = Fraction(value) * Fraction(scale) * EXACT_NEWTONS[unit]
    # One rounding each: the unit's factor, its product with scale, the product with value.
    bound = max(abs(exact) * 3 * Fraction(2) ** -53, Fraction(5e-324))
    assert abs(Fraction(float(block.tension_n[0])) - exact) <= bound


def test_an_offset_is_added_to_the_product():
    stream = StrainStream(TendonSensorConfig(scale=-0.5, offset_n=-0.3))
    (block,) = stream.add_reading(Reading(0, 0.51, 0))
    assert block.tension_n[0] == pytest.approx(-0.5 * 0.51 * 9.80665 - 0.3, rel=1e-15)


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
        stream.add_reading(Reading(None, value, at_ns))[0].status
        for at_ns, value in enumerate([1.0, 15.0, -20.0, 14.999])
    ]
    host, saturated = StrainStatus.HOST_TIME, StrainStatus.SATURATED
    assert statuses == [host, host | saturated, host | saturated, host]


def test_dropped_bytes_and_reconnections_are_told_once():
    stream = StrainStream(TendonSensorConfig())
    (first,) = stream.add_reading(Reading(0, 0.5, 0))
    stream.note_dropped_bytes()
    (second,) = stream.add_reading(Reading(17, 0.5, 17_000_000))
    stream.note_reconnection()
    (third,) = stream.add_reading(Reading(5017, 0.5, 5_017_000_000))
    (fourth,) = stream.add_reading(Reading(5033, 0.5, 5_033_000_000))
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
        (last,) = stream.add_reading(Reading(ticks, ticks / 1e5, ticks * 1_000_000))
    assert stream.add_reading(Reading(40, 0.5, 93_000_000_000)) == []
    (after,) = stream.add_reading(Reading(57, 0.5, 93_017_000_000))
    assert after.status == (
        StrainStatus.RECONNECTED | StrainStatus.RESTARTED | StrainStatus.RESYNCHRONISED
    )
    assert (after.sequence, after.lost_before) == (last.sequence + 1, 0)
    assert (stream.clock.outliers, stream.clock.restarts) == (1, 1)


@pytest.mark.parametrize('time_column', [0, -1])
def test_a_board_without_a_clock_counts_as_restarted_when_it_is_back(time_column):
    stream = StrainStream(TendonSensorConfig(time_column=time_column))
    has_clock = time_column == 0
    stream.add_reading(Reading(0 if has_clock else None, 0.5, 0))
    stream.note_reconnection()
    (back,) = stream.add_reading(Reading(5000 if has_clock else None, 0.6, 5_000_000_000))
    (next_one,) = stream.add_reading(Reading(5017 if has_clock else None, 0.5, 5_017_000_000))
    assert back.status & StrainStatus.RECONNECTED
    assert bool(back.status & StrainStatus.RESTARTED) is not has_clock
    assert stream.clock.restarts == (0 if has_clock else 1)
    assert not next_one.status & StrainStatus.RESTARTED


def test_a_value_that_stays_exactly_the_same_is_stuck_until_it_changes():
    stream = StrainStream(TendonSensorConfig(stuck_s=0.5))
    values = [0.5] * 50 + [0.6] + [0.5] * 31
    blocks = [stream.add_reading(Reading(1000 * i // 60, v, i))[0] for i, v in enumerate(values)]
    stuck = [i for i, block in enumerate(blocks) if block.status & StrainStatus.STUCK]
    assert stuck == [*range(30, 50), 81]


def test_a_coarse_sensor_is_never_stuck_when_told_so():
    stream = StrainStream(TendonSensorConfig(stuck_s=0.0))
    blocks = [stream.add_reading(Reading(1000 * i // 60, 0.5, i))[0] for i in range(200)]
    assert {block.status for block in blocks} == {StrainStatus.OK}
