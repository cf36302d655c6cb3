# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import time

import pytest

from tactile_ros.clock_watch import boot_time_s, ClockWatch


class FakeClock:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def watch(clock):
    return ClockWatch(1.0, clock)


def test_a_process_that_looks_in_time_has_not_stood_still(watch, clock):
    for _ in range(10):
        clock.now_s += 1.0
        assert watch.look() is None


def test_a_pause_is_a_standstill_and_is_remembered(watch, clock):
    clock.now_s += 7.5  # the clock also advances during a suspend
    assert watch.look() == (7.5, 107.5)
    clock.now_s += 0.5
    assert watch.look() == (7.5, 107.5)
    clock.now_s += 1.5
    assert watch.look() == (1.5, 109.5)


def test_the_clock_includes_suspends():
    before_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert before_s <= boot_time_s() <= time.clock_gettime(time.CLOCK_BOOTTIME)


def test_without_such_a_clock_the_monotonic_one_is_used(monkeypatch):
    monkeypatch.delattr(time, 'CLOCK_BOOTTIME')
    before_s = time.monotonic()
    assert before_s <= boot_time_s() <= time.monotonic()
