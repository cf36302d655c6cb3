# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The chain from readings to blocks, without a port."""

import math

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
            blocks += stream.add(reading)
    blocks += stream.flush()
    samples = {b.sequence + i: n for b in blocks for i, n in enumerate(b.tension_n)}
    assert samples == pytest.approx(expected, rel=1e-15)
    assert stream.lost_samples == sum(b.lost_before for b in blocks) == len(LOST)


def test_saturation_and_host_time_are_flagged():
    config = TendonSensorConfig(unit='N', time_column=-1, value_column=0, saturation_n=15.0)
    stream = StrainStream(config)
    statuses = [
        stream.add(Reading(None, value, at_ns))[0].status
        for at_ns, value in enumerate([1.0, 15.0, -20.0, 14.999])
    ]
    host, saturated = StrainStatus.HOST_TIME, StrainStatus.SATURATED
    assert statuses == [host, host | saturated, host | saturated, host]


def test_dropped_bytes_and_reconnections_are_told_once():
    stream = StrainStream(TendonSensorConfig())
    (first,) = stream.add(Reading(0, 0.5, 0))
    stream.note_dropped_bytes()
    (second,) = stream.add(Reading(17, 0.5, 17_000_000))
    stream.note_reconnection()
    (third,) = stream.add(Reading(5017, 0.5, 5_017_000_000))
    (fourth,) = stream.add(Reading(5033, 0.5, 5_033_000_000))
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
        (last,) = stream.add(Reading(ticks, ticks / 1e5, ticks * 1_000_000))
    assert stream.add(Reading(40, 0.5, 93_000_000_000)) == []
    (after,) = stream.add(Reading(57, 0.5, 93_017_000_000))
    assert after.status == (
        StrainStatus.RECONNECTED | StrainStatus.RESTARTED | StrainStatus.RESYNCHRONISED
    )
    assert (after.sequence, after.lost_before) == (last.sequence + 1, 0)
    assert (stream.outliers, stream.restarts) == (1, 1)


def test_a_value_that_stays_exactly_the_same_is_stuck_until_it_changes():
    stream = StrainStream(TendonSensorConfig(stuck_s=0.5))
    values = [0.5] * 50 + [0.6] + [0.5] * 31
    blocks = [stream.add(Reading(1000 * i // 60, v, i))[0] for i, v in enumerate(values)]
    stuck = [i for i, block in enumerate(blocks) if block.status & StrainStatus.STUCK]
    assert stuck == [*range(30, 50), 81]


def test_a_coarse_sensor_is_never_stuck_when_told_so():
    stream = StrainStream(TendonSensorConfig(stuck_s=0.0))
    blocks = [stream.add(Reading(1000 * i // 60, 0.5, i))[0] for i in range(200)]
    assert {block.status for block in blocks} == {StrainStatus.OK}
