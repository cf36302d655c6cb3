# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given
from hypothesis import strategies as st
import pytest

from linear_guide_driver.safety import SampleLag

MS = 1_000_000
S = 1000 * MS
PERIOD_NS = 10 * MS


def run(lag, stamps_ns, arrivals_ns):
    return [lag.add(*times) for times in zip(stamps_ns, arrivals_ns, strict=True)]


def steady(begin_ns, count):
    return [begin_ns + i * PERIOD_NS for i in range(count)]


def test_samples_that_arrive_as_ever_are_no_older():
    lag = SampleLag()
    assert set(run(lag, steady(7 * S, 2000), steady(0, 2000))) == {0}


def test_a_delay_shows_whole_and_ends_with_it():
    lag = SampleLag()
    run(lag, steady(0, 100), steady(3 * MS, 100))
    late = run(lag, steady(S, 100), steady(S + 800 * MS, 100))
    assert set(late) == {797 * MS}
    assert lag.add(2 * S, 2 * S + 4 * MS) == MS


@pytest.mark.parametrize('step_ns', [-3600 * S, -S, 3600 * S])
def test_a_step_of_the_clock_makes_no_sample_older(step_ns):
    lag = SampleLag()
    run(lag, steady(9000 * S, 100), steady(0, 100))
    after = run(lag, steady(9000 * S + S + step_ns, 1000), steady(S, 1000))
    assert set(after) == {0}


def test_a_clock_that_stands_makes_no_sample_older():
    lag = SampleLag()
    run(lag, steady(0, 100), steady(0, 100))
    assert set(run(lag, [S] * 1000, steady(S, 1000))) == {0}
    assert set(run(lag, steady(S, 1000), steady(11 * S, 1000))) == {0}


def test_a_step_during_a_silence_settles_within_ten_seconds():
    lag = SampleLag()
    run(lag, steady(0, 100), steady(0, 100))
    after = run(lag, steady(2 * S, 1200), steady(4 * S, 1200))  # set back by 2 s, unseen
    assert after[0] == 2 * S
    assert set(after[1000:]) == {0}


def test_a_step_that_the_sensor_tells_settles_at_once():
    lag = SampleLag()
    run(lag, steady(0, 100), steady(0, 100))
    assert lag.add(2 * S, 4 * S, is_step=True) == 0
    assert lag.add(3 * S, 5 * S) == 0


@given(st.lists(st.tuples(st.integers(-(10**12), 10**12), st.integers(0, 10**10)), min_size=1))
def test_a_stamp_can_only_make_a_sample_older(samples):
    lag, now_ns = SampleLag(), 0
    for stamp_ns, elapsed_ns in samples:
        now_ns += elapsed_ns
        assert lag.add(stamp_ns, now_ns) >= 0
