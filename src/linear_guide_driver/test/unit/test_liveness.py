# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of `TopicWatchdog` and `SampleLag`."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from linear_guide_driver.safety import find_loss, TopicWatchdog
from linear_guide_driver.tension import SampleLag

MS = 1_000_000
S = 1000 * MS
PERIOD_NS = 10 * MS


def test_a_topic_is_silent_before_the_first_message_and_after_the_time_out():
    watchdog, other = TopicWatchdog('trial_runner/heartbeat', 0.2), TopicWatchdog('b', 0.2)
    assert 'trial_runner/heartbeat' in str(watchdog.find_loss(0))
    assert not watchdog.was_heard
    watchdog.beat(1000 * MS)
    assert watchdog.was_heard
    assert find_loss((watchdog,), 1200 * MS) is None
    # the first silent topic is reported
    assert ' b ' in str(find_loss((watchdog, other), 1200 * MS))
    assert 'trial_runner/heartbeat for 0.2 s' in str(find_loss((watchdog, other), 1201 * MS))
    watchdog.beat(1300 * MS)
    assert watchdog.find_loss(1300 * MS) is None


def ages(lag, stamps_from_ns, arrivals_from_ns, count, period_ns=PERIOD_NS):
    """Return the ages [ns] of samples at a steady rate, given first stamp and first arrival."""
    return [
        lag.add(stamps_from_ns + i * period_ns, arrivals_from_ns + i * PERIOD_NS)
        for i in range(count)
    ]


def test_a_delay_shows_whole_and_ends_with_it():
    lag = SampleLag()
    assert set(ages(lag, 7 * S, 3 * MS, 1500)) == {0}  # no sample is late
    late_ns = ages(lag, 22 * S, 15 * S + 800 * MS, 100)
    assert set(late_ns) == {797 * MS}
    assert lag.add(23 * S, 16 * S + 4 * MS) == MS


@pytest.mark.parametrize('step_ns', [-3600 * S, -S, 3600 * S])
def test_a_step_of_the_clock_makes_no_sample_older(step_ns):
    lag = SampleLag()
    ages(lag, 9000 * S, 0, 100)
    assert set(ages(lag, 9001 * S + step_ns, S, 1000)) == {0}


def test_a_clock_that_stands_makes_no_sample_older():
    lag = SampleLag()
    ages(lag, 0, 0, 100)
    assert set(ages(lag, S, S, 1000, period_ns=0)) == {0}
    assert set(ages(lag, S, 11 * S, 1000)) == {0}


def test_a_step_during_a_silence_settles_within_ten_seconds_or_at_once_if_it_is_told():
    lag = SampleLag()
    ages(lag, 0, 0, 100)
    # the clock was set back by 2 s, which was not detected
    after_ns = ages(lag, 2 * S, 4 * S, 1200)
    assert after_ns[0] == 2 * S
    assert set(after_ns[1000:]) == {0}
    assert lag.add(20 * S, 24 * S, is_step=True) == 0
    assert lag.add(21 * S, 25 * S) == 0


@pytest.mark.parametrize('waited_s', [1, 6, 60])
def test_samples_that_waited_while_nobody_took_any_are_old_however_long(waited_s):
    lag = SampleLag()
    ages(lag, 0, 0, 600)
    taken_at_ns = (6 + waited_s) * S
    ages_ns = [lag.add(6 * S + i * PERIOD_NS, taken_at_ns) for i in range(50)]
    assert ages_ns[-1] == taken_at_ns - 6 * S - 49 * PERIOD_NS
    assert set(ages(lag, taken_at_ns, taken_at_ns, 600)) == {0}


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(-(10**12), 10**12), st.integers(0, 10**10)), min_size=1))
def test_a_stamp_can_only_make_a_sample_older(samples):
    lag, now_ns = SampleLag(), 0
    for stamp_ns, elapsed_ns in samples:
        now_ns += elapsed_ns
        assert lag.add(stamp_ns, now_ns) >= 0
