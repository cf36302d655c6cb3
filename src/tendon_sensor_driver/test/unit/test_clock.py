# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stamps of the clocks agree with a model of device time, delays and clock steps."""

from itertools import pairwise
import random
import time
from types import SimpleNamespace

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import clock as clock_module
from tendon_sensor_driver.clock import ArrivalClock, DeviceClock, HostClock
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.strain_stream import StrainStream
from tendon_sensor_driver.types import LineReading

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000
PERIOD_NS = 16_666_667
EPOCH_NS = 1_700_000_000 * SECOND_NS
WRAP = 2**32


class Model:
    """A device whose millisecond counter is faster than the host's clock by ``drift_ppm``."""

    def __init__(self, drift_ppm=0, first_ticks=5000, delay_ns=2 * MS_NS):
        self.drift_ppm = drift_ppm
        self.first_ticks = first_ticks
        self.delay_ns = delay_ns  # constant part of the delay from sample to arrival

    def ticks(self, elapsed_ns):
        device_ns = elapsed_ns * (1_000_000 + self.drift_ppm) // 1_000_000
        return (self.first_ticks + device_ns // MS_NS) % WRAP

    def true_stamp(self, elapsed_ns):
        """Return the best possible stamp of a sample: its time plus the constant delay."""
        return EPOCH_NS + elapsed_ns + self.delay_ns


def run(model, seconds, extra_delay_ns=lambda elapsed_ns: 0, clock=None):
    """Simulate samples; return tuples of elapsed time [ns], ticks and `Instant`."""
    clock = clock or DeviceClock(0.001, PERIOD_NS)
    arrived_ns = 0
    rows = []
    for i in range(seconds * 60):
        elapsed_ns = i * SECOND_NS // 60
        delay_ns = model.delay_ns + extra_delay_ns(elapsed_ns)
        arrived_ns = max(arrived_ns, EPOCH_NS + elapsed_ns + delay_ns)
        ticks = model.ticks(elapsed_ns)
        rows.append((elapsed_ns, ticks, clock.place(ticks, arrived_ns)))
    return rows


def check(model, rows):
    known = 0
    for elapsed_ns, _, instant in rows:
        if instant.stamp_error_s >= 0:
            known += 1
            error_ns = instant.stamp_ns - model.true_stamp(elapsed_ns)
            assert abs(error_ns) <= instant.stamp_error_s * SECOND_NS
    assert known > 0.9 * len(rows) - 361
    check_steps(rows)


def check_steps(rows):
    for (_, _, before), (_, _, after) in pairwise(rows):
        step_ns = after.stamp_ns - before.stamp_ns
        device_step_ns = after.device_ns - before.device_ns
        assert 20 * abs(step_ns - device_step_ns) <= device_step_ns


def jitter(seed, most_ns):
    source = random.Random(seed)
    return lambda _: source.randrange(most_ns)


@pytest.mark.parametrize('newest', [18, None])
def test_samples_that_waited_for_the_hosts_thread_do_not_make_the_stamps_late(newest):
    model, clock = Model(), DeviceClock(0.001, PERIOD_NS)
    waited_ns = 18 * SECOND_NS // 60  # the first 19 samples wait and arrive together
    if newest is not None:
        clock.note_newest(model.ticks(newest * SECOND_NS // 60), model.true_stamp(waited_ns))
    rows = run(model, 7, lambda elapsed_ns: max(waited_ns - elapsed_ns, 0), clock)
    check(model, rows)
    late_ns = [instant.stamp_ns - model.true_stamp(elapsed_ns) for elapsed_ns, _, instant in rows]
    if newest is None:  # the first offset is late, and is corrected within six seconds
        assert late_ns[0] == waited_ns
        assert max(instant.stamp_error_s for *_, instant in rows) > 0.03
    else:
        assert max(map(abs, late_ns)) <= 2 * MS_NS
        assert max(instant.stamp_error_s for *_, instant in rows) < 0.006


def test_a_newest_sample_of_another_time_is_not_taken():
    for ticks in (10, WRAP - 1):
        clock = DeviceClock(0.001, PERIOD_NS)
        clock.note_newest(ticks, EPOCH_NS)
        assert clock.place(5000, EPOCH_NS).stamp_ns == EPOCH_NS


@pytest.mark.parametrize('drift_ppm', [-100, 0, 37])
def test_jitter_and_drift_stay_within_the_stated_error(drift_ppm):
    model = Model(drift_ppm)
    rows = run(model, 120, jitter(drift_ppm, 8 * MS_NS))
    check(model, rows)
    # One tick is 1 ms, and 100 ppm of ten seconds are 1 ms. The rest is due to the jitter.
    assert max(instant.stamp_error_s for _, _, instant in rows[1200:]) < 0.005


@pytest.mark.parametrize('drift_ppm', [-100, 100])
def test_bursts_do_not_move_the_stamps(drift_ppm):
    """Every 10 s, the host stalls for 3 s, and then receives the samples of this time at once."""

    def burst(elapsed_ns):
        into_ns = elapsed_ns % (10 * SECOND_NS)
        return max(0, 3 * SECOND_NS - into_ns) if elapsed_ns > 10 * SECOND_NS else 0

    model = Model(drift_ppm)
    rows = run(model, 120, burst)
    check(model, rows)
    # One tick is 1 ms, and 100 ppm of the 13 s until the end of the next stall are 1.3 ms.
    for elapsed_ns, _, instant in rows:
        assert abs(instant.stamp_ns - model.true_stamp(elapsed_ns)) <= 2.4 * MS_NS


def run_bursts(drift_ppm_at, *, rate_hz=60.0, tick_ns=1000, seconds=120):
    """Simulate samples through a USB adapter; return (time [s], error [ns], stated error [ns]).

    The adapter delivers the received samples every 16 ms, with a jitter of up to 0.2 ms. One
    sample in a hundred is missing.
    """
    source = random.Random(0)
    clock = DeviceClock(tick_ns / 1e9, PERIOD_NS)
    burst_ns, first_ns = 16 * MS_NS, source.randrange(16 * MS_NS)
    device_ns, before_ns, rows = 5.0 * SECOND_NS, 0, []
    for i in range(round(seconds * rate_hz)):
        elapsed_ns = round(i * SECOND_NS / (rate_hz * 1.0003))
        device_ns += (elapsed_ns - before_ns) * (1 + drift_ppm_at(elapsed_ns / 1e9) / 1e6)
        before_ns = elapsed_ns
        if source.random() < 0.01:
            continue
        bursts = -((first_ns - elapsed_ns) // burst_ns)
        arrived_ns = first_ns + bursts * burst_ns + source.randrange(MS_NS // 5)
        instant = clock.place(int(device_ns) // tick_ns % WRAP, EPOCH_NS + arrived_ns)
        error_ns = instant.stamp_ns - EPOCH_NS - elapsed_ns
        rows.append((elapsed_ns / 1e9, error_ns, instant.stamp_error_s * SECOND_NS))
    assert (clock.outliers, clock.late_samples, clock.restarts) == (0, 0, 0)
    return rows


@pytest.mark.parametrize('rate_hz', [60.0, 1000.0])
@pytest.mark.parametrize('drift_ppm', [-100, 100, 5000])
def test_usb_bursts_of_16_ms_cost_less_than_a_millisecond(rate_hz, drift_ppm):
    rows = run_bursts(lambda _: drift_ppm, rate_hz=rate_hz, seconds=30)
    for _, error_ns, stated_ns in rows:
        assert stated_ns < 0 or abs(error_ns) <= stated_ns
    settled = [row for row in rows if row[0] > 12]
    assert max(abs(error_ns) for _, error_ns, _ in settled) < MS_NS
    assert max(stated_ns for _, _, stated_ns in settled) < 2 * MS_NS


def test_a_drift_that_changes_is_followed_within_the_bursts():
    rows = run_bursts(lambda t_s: 100 if 40 < t_s < 80 else 60)
    errors_ns = [abs(error_ns) for t_s, error_ns, _ in rows if t_s > 10]
    assert max(errors_ns) < MS_NS


def test_ticks_of_a_millisecond_add_a_millisecond_at_most():
    """The ticks and the arrivals have a fixed phase, so the rounding to ticks stays unknown."""
    rows = run_bursts(lambda _: 100, tick_ns=MS_NS)
    errors_ns = sorted(abs(error_ns) for t_s, error_ns, _ in rows if t_s > 10)
    assert errors_ns[len(errors_ns) * 9 // 10] < MS_NS
    assert errors_ns[-1] < 2 * MS_NS


@pytest.mark.parametrize('first_ticks', [WRAP - 1, WRAP - 10, WRAP - 4000])
def test_the_wrap_of_a_32_bit_counter_leaves_no_trace(first_ticks):
    plain = run(Model(first_ticks=1000), 10)
    wrapped = run(Model(first_ticks=first_ticks), 10)
    assert [row[2].stamp_ns for row in wrapped] == [row[2].stamp_ns for row in plain]
    assert min(ticks for _, ticks, _ in wrapped) < 100
    assert not any(instant.is_restart for _, _, instant in wrapped)


def test_a_wrap_in_a_gap_is_understood_and_a_restart_after_it_starts_from_the_ticks_themselves():
    clock = DeviceClock(0.001, PERIOD_NS)
    model = Model(first_ticks=WRAP - 1000)
    before_ns, _, before = run(model, 1, clock=clock)[-1]
    later_ns = 500 * SECOND_NS
    after = clock.place(model.ticks(later_ns), model.true_stamp(later_ns))
    assert not after.is_restart
    assert abs((after.device_ns - before.device_ns) - (later_ns - before_ns)) <= MS_NS
    start_ns = EPOCH_NS + 510 * SECOND_NS
    instants = [clock.place(ms, start_ns + ms * MS_NS) for ms in (10, 27, 43)]
    assert instants[0] is None
    assert [instant.device_ns for instant in instants[1:]] == [27 * MS_NS, 43 * MS_NS]


def test_a_restarted_device_is_believed_from_its_second_line_on():
    clock = DeviceClock(0.001, PERIOD_NS)
    run(Model(first_ticks=100_000), 30, clock=clock)
    start_ns = EPOCH_NS + 32 * SECOND_NS
    assert clock.place(10, start_ns) is None
    again = clock.place(27, start_ns + 17 * MS_NS)
    assert again.is_restart
    assert again.stamp_error_s < 0  # the error of the restarted clock is unknown
    assert again.stamp_ns == start_ns + 17 * MS_NS
    assert not clock.place(43, start_ns + 33 * MS_NS).is_restart
    assert clock.outliers == 1


@pytest.mark.parametrize('ticks', [3, 20_000, 350_001, WRAP - 1, 10**18])
def test_one_broken_time_changes_nothing(ticks):
    model = Model(first_ticks=30_000)
    clock, undisturbed = DeviceClock(0.001, PERIOD_NS), DeviceClock(0.001, PERIOD_NS)
    run(model, 5, clock=clock)
    run(model, 5, clock=undisturbed)
    elapsed_ns = 5 * SECOND_NS
    assert clock.place(ticks, model.true_stamp(elapsed_ns)) is None
    assert clock.outliers == 1
    for _ in range(3):
        elapsed_ns += PERIOD_NS
        line = model.ticks(elapsed_ns), model.true_stamp(elapsed_ns)
        assert clock.place(*line) == undisturbed.place(*line)
    # Two outliers that agree do not count as a restart if a valid sample is between them.
    assert clock.place(ticks + 67, model.true_stamp(elapsed_ns)) is None
    assert clock.outliers == 2


@pytest.mark.parametrize('back', [0, 1, 17, 249])
def test_duplicates_and_late_samples_have_no_place(back):
    clock = DeviceClock(0.001, PERIOD_NS)
    run(Model(), 5, clock=clock)
    last_ticks = Model().ticks(299 * SECOND_NS // 60)
    assert clock.place(last_ticks - back, EPOCH_NS + 5 * SECOND_NS) is None
    assert (clock.duplicates, clock.late_samples, clock.outliers) == (back == 0, back > 0, 0)


def test_after_a_reconnection_the_first_line_tells_whether_the_device_ran_on():
    for ticks, is_restart in [(45_010, False), (45_000 - 2000, True), (20, True), (5017, True)]:
        clock = DeviceClock(0.001, PERIOD_NS)
        run(Model(first_ticks=5000), 10, clock=clock)
        clock.note_reconnection()
        instant = clock.place(ticks, EPOCH_NS + 40 * SECOND_NS + 12 * MS_NS)
        assert instant.is_restart is is_restart
        assert clock.outliers == clock.late_samples == 0
        # Only the first sample after the reconnection can show a restart.
        later = clock.place(ticks + 17, EPOCH_NS + 43 * SECOND_NS)
        assert not later.is_restart


@pytest.mark.parametrize('step_ms', [-500, -100, 100, 500, 3_600_000])
def test_a_step_of_the_host_clock_that_nobody_tells_is_followed(step_ms):
    model, clock = Model(), DeviceClock(0.001, PERIOD_NS)
    last_ns = run(model, 20, clock=clock)[-1][2].stamp_ns
    for i in range(20 * 60, 45 * 60):
        elapsed_ns = i * SECOND_NS // 60
        true_ns = model.true_stamp(elapsed_ns) + step_ms * MS_NS
        instant = clock.place(model.ticks(elapsed_ns), true_ns)
        assert instant.stamp_ns > last_ns
        last_ns = instant.stamp_ns
        assert i < 38 * 60 or abs(last_ns - true_ns) <= 1.1 * MS_NS
    assert not clock.restarts


def test_a_host_clock_set_back_never_takes_the_stamps_back():
    clock = DeviceClock(0.001, PERIOD_NS)
    *_, (_, _, before) = run(Model(), 20, clock=clock)
    instants = [
        clock.place(5000 + ms, EPOCH_NS - 30 * SECOND_NS + ms * MS_NS)
        for ms in range(20_000, 60_000, 16)
    ]
    placed = [instant for instant in instants if instant is not None]
    assert len(placed) == len(instants) - 1
    assert all(b.stamp_ns > a.stamp_ns for a, b in pairwise([before, *placed]))
    assert sum(instant.is_restart for instant in placed) == 1
    # The stamps approach the new time of the host by 1/20 of the elapsed time. The difference
    # that is left is part of the stated error.
    ahead_ns = placed[-1].stamp_ns - (EPOCH_NS + 30 * SECOND_NS)
    assert ahead_ns > 27 * SECOND_NS
    assert placed[-1].stamp_error_s > ahead_ns / 1e9


@given(
    st.lists(
        st.tuples(st.integers(0, WRAP + 5) | st.integers(0, 2000), st.integers(0, 3 * SECOND_NS)),
        max_size=60,
    ),
    st.integers(0, 2**60),
)
def test_stamps_increase_whatever_the_device_says(lines, start_ns):
    clock = DeviceClock(0.001, PERIOD_NS)
    now_ns, last_ns = start_ns, None
    for ticks, pause_ns in lines:
        now_ns += pause_ns
        instant = clock.place(ticks, now_ns)
        if instant is not None:
            assert last_ns is None or instant.stamp_ns > last_ns
            last_ns = instant.stamp_ns


def test_ticks_that_are_no_whole_nanoseconds_stay_exact():
    clock = DeviceClock(1 / 32768, PERIOD_NS)
    clock.place(0, 0)
    seconds = 86400 * 30
    instant = clock.place(32768 * seconds, seconds * SECOND_NS)
    assert instant.device_ns == seconds * SECOND_NS
    # The float 1e-6 is a little smaller than a microsecond, so it must not be rounded down.
    clock = DeviceClock(1e-6, PERIOD_NS)
    clock.place(0, 0)
    assert clock.place(1, 1000).device_ns == 1000


def test_without_a_device_clock_arrival_counts_and_the_error_is_unknown():
    clock = HostClock(PERIOD_NS)
    stamps = [clock.place(None, at_ns) for at_ns in (5, 5, 5, 20, 19)]
    assert [instant.stamp_ns for instant in stamps] == [5, 6, 7, 20, 21]
    assert {instant.stamp_error_s for instant in stamps} == {-1.0}


# -- steps detected by the monotonic clock ------------------------------------------------


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(st.integers(1, 30), st.integers(-3600 * 1000, 3600 * 1000)),
        min_size=1,
        max_size=4,
    ),
    st.integers(0, 2**32 - 1),
)
def test_steps_that_are_told_leave_the_error_as_stated(steps, seed):
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
        arrived_ns = EPOCH_NS + elapsed_ns + 2 * MS_NS + source.randrange(8 * MS_NS)
        instant = clock.place(ticks, arrived_ns + offset_ns)
        assert not instant.is_restart
        assert not instant.is_step
        error_ns = instant.stamp_ns - (EPOCH_NS + elapsed_ns + 2 * MS_NS) - offset_ns
        # While the error is unknown, stamps are the times of arrival, which are 8 ms late at most.
        most_s = instant.stamp_error_s if instant.stamp_error_s >= 0 else 0.01
        assert abs(error_ns) <= most_s * SECOND_NS
    assert (clock.restarts, clock.outliers, clock.late_samples) == (0, 0, 0)


def test_a_device_that_stood_still_is_no_step_of_the_hosts_clock():
    """If the offset jumps but the host's clock was not set, the device's clock paused."""
    stream = StrainStream(TendonSensorConfig(rate_hz=60.0))
    blocks = []
    for i in range(30 * 60):
        device_ns = i * SECOND_NS // 60
        pause_ns = 1380 * MS_NS if device_ns > 12 * SECOND_NS else 0
        arrived_ns = EPOCH_NS + device_ns + pause_ns
        blocks += stream.add_reading(LineReading(device_ns // MS_NS, float(i), arrived_ns))
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
    now_ns[0] = 50 * MS_NS  # too small for a step
    arrivals.now_ns()
    assert arrivals.take_step_ns() == 0
    now_ns[0] -= 5 * SECOND_NS
    arrivals.now_ns()
    now_ns[0] += 2 * SECOND_NS
    arrivals.now_ns()
    assert arrivals.take_step_ns() == pytest.approx(-3 * SECOND_NS, abs=5 * MS_NS)
    assert arrivals.take_step_ns() == 0


def test_a_pause_of_the_reader_is_no_step_of_the_hosts_clock(monkeypatch):
    host_ns = EPOCH_NS
    both = SimpleNamespace(monotonic_ns=lambda: host_ns - EPOCH_NS)
    monkeypatch.setattr(clock_module, 'time', both)
    arrivals = ArrivalClock(lambda: host_ns)
    for pause_ns in (0, 1380 * MS_NS, 3600 * SECOND_NS):
        host_ns += pause_ns
        assert arrivals.now_ns() == host_ns
    assert arrivals.take_step_ns() == 0
