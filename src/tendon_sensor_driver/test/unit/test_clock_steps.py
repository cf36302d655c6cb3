# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Steps of the host's clock: told by the monotonic clock, followed by the stamps."""

import random
import time

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.clock import ArrivalClock, DeviceClock
from tendon_sensor_driver.records import Reading, TendonSensorConfig
from tendon_sensor_driver.strain_stream import StrainStream

SECOND_NS = 1_000_000_000
PERIOD_NS = 16_666_667
MS_NS = 1_000_000
EPOCH_NS = 1_700_000_000 * SECOND_NS
DELAY_NS = 2 * MS_NS


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(1, 30), st.integers(-3600 * 1000, 3600 * 1000)),
        min_size=1,
        max_size=4,
    ),
    st.integers(0, 2**32 - 1),
)
def test_steps_that_are_told_leave_the_error_as_stated(steps, seed):
    """The host's clock is set at any moment, by any number of milliseconds."""
    clock, source = DeviceClock(0.001, PERIOD_NS), random.Random(seed)
    step_at = {}
    for second, step_ms in steps:
        step_at[60 * second + source.randrange(60)] = step_ms * MS_NS
    offset_ns = 0
    for i in range(40 * 60):
        if i in step_at:
            offset_ns += step_at[i]
            clock.note_step(step_at[i])
        elapsed_ns = i * SECOND_NS // 60
        ticks = 5000 + elapsed_ns * 1_000_037 // 1_000_000 // MS_NS
        arrived_ns = EPOCH_NS + elapsed_ns + DELAY_NS + source.randrange(8 * MS_NS)
        instant = clock.place(ticks, arrived_ns + offset_ns)
        assert not instant.is_restart
        assert not instant.is_step
        error_ns = instant.stamp_ns - (EPOCH_NS + elapsed_ns + DELAY_NS) - offset_ns
        # The first stamps are those of arrivals.
        most_s = instant.stamp_error_s if instant.stamp_error_s >= 0 else 0.01
        assert abs(error_ns) <= most_s * SECOND_NS
    assert (clock.restarts, clock.outliers, clock.late_samples) == (0, 0, 0)


def test_a_device_that_stood_still_is_no_step_of_the_hosts_clock():
    """The monotonic clock tells no step, so the time that lacks is the device's."""
    stream = StrainStream(TendonSensorConfig(rate_hz=60.0))
    blocks = []
    for i in range(30 * 60):
        device_ns = i * SECOND_NS // 60
        pause_ns = 1380 * MS_NS if device_ns > 12 * SECOND_NS else 0
        arrived_ns = EPOCH_NS + device_ns + pause_ns
        blocks += stream.add_reading(Reading(device_ns // MS_NS, float(i), arrived_ns))
    marked = [b for b in blocks if b.status]
    assert [b.status for b in marked] == [StrainStatus.RESYNCHRONISED]
    at = blocks.index(marked[0])
    leap_s = (blocks[at].stamp_ns - blocks[at - 1].stamp_ns) / 1e9
    assert leap_s == pytest.approx(1.380, abs=0.05)
    assert stream.lost_samples == 0


def test_the_time_of_arrival_tells_steps_from_delays_of_its_own():
    now_ns = [0]
    arrivals = ArrivalClock(lambda: time.monotonic_ns() + now_ns[0])
    for _ in range(200):
        arrivals.now_ns()
    assert arrivals.take_step_ns() == 0
    now_ns[0] = 50 * MS_NS  # less than what counts
    arrivals.now_ns()
    assert arrivals.take_step_ns() == 0
    now_ns[0] -= 5 * SECOND_NS
    arrivals.now_ns()
    now_ns[0] += 2 * SECOND_NS
    arrivals.now_ns()
    assert arrivals.take_step_ns() == pytest.approx(-3 * SECOND_NS, abs=5 * MS_NS)
    assert arrivals.take_step_ns() == 0
