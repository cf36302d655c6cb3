# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Times of samples from a topic: order, missing samples, clock steps, and rate."""

from fractions import Fraction
from itertools import pairwise
import random

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from tendon_sensor_driver.topic_stream import measure_rate_hz, RateMeter, StampClock

PERIOD_NS = 1_000_000
START_NS = 1_795_378_589_611_991_580
MILLISECOND_NS = 1_000_000


def place_all(clock, stamps_ns, delay_ns=300_000):
    """Place samples that all have the same delay; return `Instant`, or None if dropped."""
    return [clock.place(stamp_ns, stamp_ns + delay_ns) for stamp_ns in stamps_ns]


def count_lost(instants):
    """Return the number of samples lost before each accepted sample."""
    placed = [instant for instant in instants if instant is not None]
    periods = [instant.device_ns // PERIOD_NS for instant in placed]
    return [after - before - 1 for before, after in pairwise(periods)]


@pytest.mark.parametrize('rate_error', [-0.04, 0.0, 0.01])
@pytest.mark.parametrize('jitter', [0.0, 0.3])
def test_jitter_and_a_rate_that_is_off_make_no_false_gap_and_hide_none(rate_error, jitter):
    draw = random.Random(4).uniform
    period_ns = PERIOD_NS * (1 + rate_error)
    lost_at = set(range(3000, 10_000, 777))
    numbers = [i for i in range(10_000) if i not in lost_at]
    stamps_ns = [START_NS + round((i + draw(-jitter, jitter)) * period_ns) for i in numbers]
    clock = StampClock(PERIOD_NS)
    instants = place_all(clock, stamps_ns)
    assert count_lost(instants) == [after - before - 1 for before, after in pairwise(numbers)]
    assert {instant.stamp_error_s for instant in instants} == {0.0003}


def test_a_long_gap_is_counted_to_the_sample():
    stamps_ns = [START_NS + i * PERIOD_NS for i in (*range(1000), *range(61_000, 61_100))]
    assert sum(count_lost(place_all(StampClock(PERIOD_NS), stamps_ns))) == 60_000


def test_duplicates_and_late_samples_have_no_place_and_are_counted():
    clock = StampClock(PERIOD_NS)
    order = [0, 1, 1, 3, 2, 4, 4, 4, 6, 5, 7]
    instants = place_all(clock, [START_NS + i * PERIOD_NS for i in order])
    placed = [i for i, instant in zip(order, instants, strict=True) if instant is not None]
    assert placed == [0, 1, 3, 4, 6, 7]
    assert (clock.duplicates, clock.late_samples, clock.outliers) == (3, 2, 0)
    # The late samples 2 and 5 are dropped, and count as lost before samples 3 and 6.
    assert count_lost(instants) == [0, 1, 0, 1, 0]


def test_one_wild_stamp_is_an_outlier_and_nothing_else_changes():
    for wild_ns in (0 + 1, START_NS - 10**9, START_NS + 10**10, 2**62):
        clock = StampClock(PERIOD_NS)
        before = place_all(clock, [START_NS + i * PERIOD_NS for i in range(10)])
        arrival_ns = START_NS + 10 * PERIOD_NS
        assert clock.place(wild_ns, arrival_ns) is None
        after = place_all(clock, [START_NS + i * PERIOD_NS for i in range(11, 20)])
        assert (clock.outliers, clock.steps) == (1, 0)
        assert count_lost([*before, *after]) == [0] * 9 + [1] + [0] * 8


@pytest.mark.parametrize('step_s', [-3600, -5, -0.5, 0.5, 5, 3600])
def test_a_clock_of_the_publisher_that_is_set_is_followed_after_one_sample(step_s):
    clock = StampClock(PERIOD_NS)
    place_all(clock, [START_NS + i * PERIOD_NS for i in range(3000)])
    step_ns = round(step_s * 10**9)
    instants = [
        clock.place(START_NS + i * PERIOD_NS + step_ns, START_NS + i * PERIOD_NS + 300_000)
        for i in range(3000, 3100)
    ]
    assert instants[0] is None
    assert instants[1].is_step
    assert not any(instant.is_step for instant in instants[2:])
    assert [i.stamp_ns for i in instants[1:]] == [
        START_NS + i * PERIOD_NS + step_ns for i in range(3001, 3100)
    ]
    assert count_lost(instants) == [0] * 98
    # The difference between the clocks of publisher and host is part of the stated error.
    assert instants[-1].stamp_error_s == pytest.approx(abs(step_s), abs=0.001)


@pytest.mark.parametrize('step_s', [-5, -0.5, 0.5, 5])
def test_a_clock_of_both_that_is_set_keeps_the_bound_on_the_error(step_s):
    clock = StampClock(PERIOD_NS)
    place_all(clock, [START_NS + i * PERIOD_NS for i in range(3000)])
    step_ns = round(step_s * 10**9)
    clock.note_step(step_ns)
    instants = place_all(clock, [START_NS + i * PERIOD_NS + step_ns for i in range(3000, 3100)])
    assert sum(instant is None for instant in instants) <= 1
    assert count_lost(instants) == [0] * (len([i for i in instants if i]) - 1)
    assert instants[-1].stamp_error_s == 0.0003


def test_a_queue_that_waits_and_empties_is_no_step_and_loses_nothing():
    clock = StampClock(PERIOD_NS)
    first_ns = START_NS + 500 * MILLISECOND_NS  # arrival of the samples that have waited
    instants = []
    for i in range(2000):
        stamp_ns = START_NS + i * PERIOD_NS
        instants.append(clock.place(stamp_ns, max(first_ns, stamp_ns + 200_000)))
    assert None not in instants
    assert not any(instant.is_step for instant in instants)
    assert sum(count_lost(instants)) == 0
    assert instants[0].stamp_error_s == 0.5
    assert instants[-1].stamp_error_s == 0.0002


def test_the_bound_on_the_error_is_that_of_the_last_ten_seconds():
    clock = StampClock(10 * PERIOD_NS)
    for i in range(3000):
        stamp_ns = START_NS + i * 10 * PERIOD_NS
        delay_ns = 200_000 if i < 1000 else 2_000_000
        instant = clock.place(stamp_ns, stamp_ns + delay_ns)
        if i == 1400:
            assert instant.stamp_error_s == 0.0002
    assert instant.stamp_error_s == 0.002


def stamp_late(count, late_at):
    """Return regular stamps, apart from late stamps at the indices ``late_at``."""
    late_ns = {i: round(1.6 * PERIOD_NS) for i in late_at}
    late_ns |= {i + 1: round(0.7 * PERIOD_NS) for i in late_at}
    return [START_NS + i * PERIOD_NS + late_ns.get(i, 0) for i in range(count)]


@pytest.mark.parametrize('has_numbers', [True, False])
def test_a_publisher_that_stamps_late_has_irregular_stamps_and_loses_nothing(has_numbers):
    late_at = range(100, 2000, 150)
    clock = StampClock(PERIOD_NS)
    instants = []
    for number, stamp_ns in enumerate(stamp_late(2000, late_at)):
        clock.number = number if has_numbers else None
        instants.append(clock.place(stamp_ns, stamp_ns + 300_000))
    assert None not in instants
    assert clock.irregular_stamps >= len(late_at)
    # Without sequence numbers, the irregular stamps also count as lost messages.
    assert (sum(count_lost(instants)) == 0) == has_numbers


def test_numbers_tell_lost_messages_and_pauses_from_irregular_stamps():
    clock = StampClock(PERIOD_NS)
    instants = []
    # Message 50 is lost; the publisher pauses for 5 periods after message 80.
    for number in (*range(50), *range(51, 100)):
        clock.number = number
        stamp_ns = START_NS + (number + 5 * (number > 80)) * PERIOD_NS
        instants.append(clock.place(stamp_ns, stamp_ns + 300_000))
    lost = count_lost(instants)
    assert (lost[49], lost[79], sum(lost)) == (1, 5, 6)
    assert clock.irregular_stamps == 0
    clock.note_reconnection()  # another publisher, with other sequence numbers
    clock.number = 100
    instants.append(clock.place(stamp_ns + 2 * PERIOD_NS, stamp_ns + 2 * PERIOD_NS + 300_000))
    assert count_lost(instants)[-1] == 1


def test_without_stamps_arrivals_are_the_time_and_numbers_tell_the_gaps():
    clock = StampClock(PERIOD_NS)
    instants = []
    for number in (5, 6, 9, 9, 10, 2, 3):  # 2 and 3 are from another publisher
        clock.number = number
        instants.append(clock.place(None, START_NS))
    assert count_lost(instants) == [0, 2, 0, 0, 0, 0]
    assert [instant.stamp_ns - START_NS for instant in instants] == list(range(7))
    assert {instant.stamp_error_s for instant in instants} == {-1.0}
    clock.note_reconnection()
    clock.number = 100
    again = clock.place(None, START_NS + 10)
    # A change between messages with and without stamps counts as a step, not as lost messages.
    stamped = clock.place(START_NS + 20, START_NS + 20)
    clock.number = 200
    arrived = clock.place(None, START_NS + 30)
    assert [instant.is_step for instant in (again, stamped, arrived)] == [False, True, True]
    assert count_lost([instants[-1], again, stamped, arrived]) == [0, 0, 0]


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.none() | st.integers(1, 2**63 - 1) | st.integers(-(10**9), 10**9),
            st.integers(-(10**6), 10**9),
            st.none() | st.integers(0, 2**64 - 1),
            st.sampled_from([0, 0, 0, 10**9, -(10**9)]),
        ),
        max_size=60,
    ),
    st.floats(0.1, 10_000.0),
)
def test_whatever_comes_times_and_numbers_rise_between_steps(messages, rate_hz):
    period_ns = round(1e9 / rate_hz)
    clock, arrival_ns = StampClock(period_ns), START_NS
    last, placed, moved = None, 0, False
    for stamp, pause_ns, number, step_ns in messages:
        arrival_ns += pause_ns + step_ns
        if step_ns:
            clock.note_step(step_ns)
        clock.number = number
        near_now = stamp is not None and abs(stamp) <= 10**9
        ticks = START_NS + stamp if near_now else stamp
        moved |= step_ns != 0
        instant = clock.place(ticks, arrival_ns)
        if instant is None:
            continue
        placed += 1
        if last is not None:
            assert instant.device_ns - last.device_ns >= period_ns
            assert (instant.device_ns - last.device_ns) % period_ns == 0
            assert instant.is_step or moved or instant.stamp_ns > last.stamp_ns
        if ticks is not None:
            assert instant.stamp_ns == ticks
            assert instant.stamp_error_s >= 0
        last, moved = instant, False
    dropped = clock.duplicates + clock.late_samples + clock.outliers
    assert placed + dropped == len(messages)


@settings(max_examples=100)
@given(
    st.floats(0.5, 5000.0),
    st.tuples(st.floats(0.0, 0.2), st.floats(0.0, 0.05))
    | st.tuples(st.floats(0.0, 0.05), st.floats(0.0, 0.06)),
    st.integers(0, 2**32),
)
def test_the_measured_rate_is_that_of_the_samples_whatever_is_lost(rate_hz, jitter_lost, seed):
    jitter, lost = jitter_lost
    draw = random.Random(seed)
    numbers = [i for i in range(400) if draw.random() >= lost]
    times_ns = [
        START_NS + round((i + draw.uniform(-jitter, jitter)) * 1e9 / rate_hz) for i in numbers
    ]
    measured = Fraction(measure_rate_hz(times_ns, is_regular=True))
    # The tolerance covers the jitter of the first and the last stamp, and one wrong period.
    assert abs(measured / Fraction(rate_hz) - 1) < 0.005


def test_arrivals_in_bursts_are_counted():
    times_ns = [START_NS + (i // 20) * 20_000_000 for i in range(2001)]
    assert measure_rate_hz(times_ns, is_regular=False) == pytest.approx(1000.0)
    # The stamps of a publisher that pauses and then sends several messages give the same rate.
    times_ns = [START_NS + (i // 20) * 20_000_000 + (i % 20) * 100_000 for i in range(2001)]
    assert measure_rate_hz(times_ns, is_regular=True) == pytest.approx(1000.0)
    assert measure_rate_hz([5, 5, 5], is_regular=True) == 0.0
    assert measure_rate_hz([5, 5, 5], is_regular=False) == 0.0


def test_the_meter_measures_every_two_seconds_and_survives_a_step():
    meter = RateMeter()
    measured = [
        i for i in range(500) if meter.add(START_NS + i * 10_000_000, START_NS + i * 10_000_000)
    ]
    assert measured == [200, 400]
    assert meter.rate_hz == pytest.approx(100.0)
    for i in range(300):
        meter.add(10**9 + i * 20_000_000, START_NS)
    assert meter.rate_hz == pytest.approx(50.0)
