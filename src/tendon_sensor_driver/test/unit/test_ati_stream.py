# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import TendonSensorConfig
from tendon_sensor_driver.clock import Batch
from tendon_sensor_driver.config import AXES
from tendon_sensor_driver.counter_clock import CounterClock, CounterRestartError
from tendon_sensor_driver.strain_stream import Stream

RATE_HZ = 7000
START_NS = 1_800_000_000_000_000_000


def configure(**changes):
    return TendonSensorConfig(
        **{'sensor': 'net_ft', 'rate_hz': 1000.0, 'samples_per_block': 10, **changes}
    )


def batch_of(ticks, *, records=None, status=0, first=0, delay_s=0.0, values=None, scale=1.0):
    """Return a batch of samples at ``ticks``, whose tensions are equal to the ticks."""
    ticks = np.asarray(ticks, dtype=np.int64)
    wrench = np.zeros((len(ticks), 6))
    wrench[:, 2] = ticks if values is None else values
    newest_s = (ticks.max() - first) / RATE_HZ
    return Batch(
        records=np.asarray(ticks // 7 if records is None else records).astype(np.uint32),
        ticks=(ticks % 2**32).astype(np.uint32),
        tension_n=scale * wrench[:, AXES.index('fz')],
        wrench=wrench,
        status=np.full(len(ticks), status, dtype=np.uint32),
        timed=len(ticks) - 1,
        received_at_ns=START_NS + round(1e9 * (newest_s + delay_s)),
    )


def run(stream, batches):
    blocks = []
    for batch in batches:
        blocks += stream.add(batch)
    return blocks + stream.flush()


def start(**changes):
    stream = Stream(configure(**changes), CounterClock())
    stream.clock.begin_session(RATE_HZ, 7)
    return stream


def begin_again(stream):
    """Begin a new session, as the client does after it has lost the link."""
    stream.clock.begin_session(RATE_HZ, 7)
    stream.note_reconnection()


def check(blocks, ticks):
    """Check that the blocks contain exactly the samples at ``ticks``, with right numbers."""
    values = np.concatenate([block.tension_n for block in blocks])
    np.testing.assert_array_equal(values, ticks)
    expected = end_ns = 0
    for block in blocks:
        assert block.sequence == expected + block.lost_before
        numbers = block.sequence + np.arange(len(block.tension_n))
        np.testing.assert_array_equal(block.tension_n, ticks[0] + 7 * numbers)
        np.testing.assert_array_equal(block.wrench[:, 2], block.tension_n)
        assert block.stamp_ns > end_ns
        expected = int(numbers[-1]) + 1
        end_ns = block.stamp_ns + (len(numbers) - 1) * block.period_ns


@settings(max_examples=60)
@given(
    count=st.integers(1, 300),
    seed=st.integers(0, 2**32 - 1),
    first=st.sampled_from([0, 70_000, 2**32 - 700]),
    samples_per_block=st.sampled_from([1, 10, 40]),
)
def test_any_loss_duplication_order_and_cutting_gives_true_samples_once(
    count, seed, first, samples_per_block
):
    generator = np.random.default_rng(seed)
    sent = first + 7 * np.arange(1, count + 1)
    kept = sent[np.sort(generator.choice(count, generator.integers(1, count + 1), replace=False))]
    stream = start(samples_per_block=samples_per_block)
    batches, expected, done = [], [], first
    while len(kept):
        part, kept = np.split(kept, [generator.integers(1, 30)])
        expected += part[part > done].tolist()
        twice = generator.choice(part, generator.integers(0, 4))
        part = np.concatenate((part, twice))
        if batches:
            generator.shuffle(part)
        else:  # the first sample stays first, because sequence numbers start there
            part = np.concatenate((part[:1], generator.permutation(part[1:])))
        batches.append(batch_of(part, first=first))
    blocks = run(stream, batches)
    check(blocks, np.array(expected))
    clock = stream.clock
    assert clock.late_samples == 0
    assert stream.readings == len(expected)
    assert stream.lost_samples == (expected[-1] - expected[0]) // 7 + 1 - len(expected)


@pytest.mark.parametrize(
    ('batches', 'taken', 'duplicates', 'late', 'lost'),
    [
        ([[7, 14, 28], [21, 35]], [7, 14, 28, 35], 0, 1, 1),
        ([[7, 14, 14, 21]], [7, 14, 21], 1, 0, 0),
        ([[7, 14], [14, 7]], [7, 14], 1, 1, 0),
    ],
)
def test_samples_that_come_late_or_twice_are_dropped_and_counted(
    batches, taken, duplicates, late, lost
):
    stream = start()
    check(run(stream, map(batch_of, batches)), np.array(taken))
    counts = stream.clock.duplicates, stream.clock.late_samples, stream.lost_samples
    assert counts == (duplicates, late, lost)


def test_the_period_follows_the_records_and_not_the_expectation():
    stream = Stream(configure(samples_per_block=1, rate_hz=60.0), CounterClock())
    stream.clock.begin_session(RATE_HZ, 117)  # 7000 / 60, although the sensor uses 116
    batches = [batch_of([116 * i], records=[i]) for i in range(1, 8)]
    blocks = run(stream, batches)
    assert blocks[-1].period_ns == round(116e9 / 7000)
    assert stream.clock.rate_hz == pytest.approx(60.345, abs=1e-3)
    assert [block.sequence for block in blocks] == list(range(7))


def test_one_odd_record_does_not_change_the_period():
    clock = CounterClock()
    clock.begin_session(RATE_HZ, 7)
    for ticks, record in [(7, 1), (14, 2), (28, 3), (35, 4), (42, 5)]:
        clock.place_batch(batch_of([ticks], records=[record]))
    assert clock.ticks_per_sample == 7


def test_a_counter_that_falls_back_within_a_session_is_an_error():
    stream = start()
    stream.add(batch_of(700_000 + 7 * np.arange(5), first=700_000))
    with pytest.raises(CounterRestartError):
        stream.add(batch_of([7], first=-35))
    begin_again(stream)
    again = batch_of([7, 14, 70])._replace(received_at_ns=START_NS + 20 * 10**9)
    _, first, after = stream.add(again) + stream.flush()
    assert first.status == StrainStatus.RECONNECTED | StrainStatus.RESTARTED
    assert (first.sequence, first.lost_before) == (5, 0)
    assert (after.status, after.lost_before) == (StrainStatus.OK, 7)
    assert stream.clock.restarts == 1


@pytest.mark.parametrize('step_s', [-3600.0, 3600.0])
def test_a_step_of_the_clock_of_the_host_is_no_restart(step_s):
    stream = start(samples_per_block=1)
    blocks = stream.add(batch_of(7 * np.arange(1, 6)))
    for i in range(6, 20):
        blocks += stream.add(batch_of([7 * i], delay_s=step_s))
    assert stream.clock.restarts == 0
    assert blocks[-1].sequence == 18
    stamps_ns = [block.stamp_ns for block in blocks]
    assert stamps_ns == sorted(set(stamps_ns))


def test_a_gap_over_a_new_session_is_counted_by_the_counter():
    stream = start(samples_per_block=1)
    stream.add(batch_of(7 * np.arange(1, 6)))
    begin_again(stream)
    block = stream.add(batch_of([7 * 3006], records=[1]))[0]
    assert (block.sequence, block.lost_before) == (3005, 3000)
    assert block.status == StrainStatus.RECONNECTED
    assert stream.clock.restarts == 0


@pytest.mark.parametrize('is_stated', [True, False])
def test_a_change_of_status_begins_a_block(is_stated):
    stream = start(samples_per_block=100, saturation_n=0.0 if is_stated else 20.0)
    batch = batch_of(7 * np.arange(1, 7), values=[7, 14, 21, 28, 7, 14], scale=-1.0)
    if is_stated:
        batch.status[2:4] = int(StrainStatus.SATURATED)
    blocks = run(stream, [batch])
    assert [int(block.status) for block in blocks] == [0, 2, 0]
    assert [block.tension_n.tolist() for block in blocks] == [[-7, -14], [-21, -28], [-7, -14]]
    assert stream.status == StrainStatus.OK


@pytest.mark.parametrize('cut', [1, 3, 40])
def test_equal_values_are_stuck_after_their_time_and_not_before(cut):
    stream = start(stuck_s=0.02, samples_per_block=1)
    values = np.concatenate((np.arange(15.0), np.full(25, 99.0), np.arange(10.0)))
    blocks = []
    for i in range(0, len(values), cut):
        ticks = 7 * np.arange(i + 1, min(i + cut, len(values)) + 1)
        blocks += stream.add(batch_of(ticks, values=values[i : i + cut]))
    stuck = [StrainStatus.STUCK in block.status for block in blocks]
    assert stuck == [False] * 35 + [True] * 5 + [False] * 10


def test_late_batches_do_not_spoil_the_stamps():
    generator = np.random.default_rng(2)
    stream = start(samples_per_block=7)
    blocks = []
    for i in range(3000):
        late_s = 0.016 * generator.random() if generator.random() < 0.7 else 0.0
        ticks = 7 * np.arange(7 * i + 1, 7 * i + 8)
        blocks += stream.add(batch_of(ticks, delay_s=late_s))
    error_s = [
        (block.stamp_ns - START_NS) / 1e9 - block.tension_n[0] / RATE_HZ
        for block in blocks
        if block.tension_n[0] / RATE_HZ > 10
    ]
    assert np.abs(error_s).max() < 1e-3


def test_a_box_that_stood_still_is_no_step_of_the_hosts_clock():
    stream = start()
    parts = np.split(7 * np.arange(1, 20_001), 400)  # batches of 50 ms
    blocks = run(stream, [batch_of(p, delay_s=1.38 * (i > 200)) for i, p in enumerate(parts)])
    assert [b.status for b in blocks if b.status] == [StrainStatus.RESYNCHRONISED]
    assert (stream.clock.restarts, stream.clock.outliers, stream.lost_samples) == (0, 0, 0)


@pytest.mark.parametrize('step_s', [5.0, -5.0, 0.2, -0.2])
@pytest.mark.parametrize('is_reconnected', [False, True])
def test_a_step_of_the_hosts_clock_moves_the_stamps_and_is_no_restart(step_s, is_reconnected):
    stream = start()
    ticks = 7 * np.arange(1, 2001)
    blocks = run(stream, [batch_of(part) for part in np.split(ticks[:1000], 20)])
    stream.note_clock_step(round(step_s * 1e9))
    if is_reconnected:
        begin_again(stream)
    after = run(stream, [batch_of(part, delay_s=step_s) for part in np.split(ticks[1000:], 20)])
    assert {block.status for block in (*blocks, *after[1:])} == {StrainStatus.OK}
    lost = StrainStatus.RECONNECTED if is_reconnected else StrainStatus.OK
    assert after[0].status == StrainStatus.CLOCK_STEP | lost
    assert (stream.clock.restarts, stream.clock.outliers, stream.lost_samples) == (0, 0, 0)
    end_ns = blocks[-1].stamp_ns + 9 * blocks[-1].period_ns
    apart_s = (after[0].stamp_ns - end_ns) / 1e9
    assert apart_s == pytest.approx(step_s + 0.001, abs=0.01)
