# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Periodic calls that a `Ticker` makes on its thread."""

import threading
import time

from tactile_ros.periodic import Ticker
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


def threads(name):
    return [thread for thread in threading.enumerate() if thread.name == name]


def test_calls_come_on_one_thread_until_they_are_cancelled():
    ticker, names = Ticker('ticker of a test'), set()
    came = [threading.Semaphore(0) for _ in range(2)]

    def note(semaphore):
        names.add(threading.current_thread().name)
        semaphore.release()

    # A function with a long period must not delay the functions with a short period.
    calls = [ticker.every(1000.0, names.clear)]
    calls += [ticker.every(0.001, lambda s=s: note(s)) for s in came]
    for semaphore in came:
        for _ in range(5):
            assert semaphore.acquire(timeout=DEADLINE_S)
    assert len(threads('ticker of a test')) == 1
    for call in calls:
        call.cancel()
        call.cancel()
    wait_until(lambda: not threads('ticker of a test'))
    for semaphore in came:
        while semaphore.acquire(blocking=False):
            pass
    again = threading.Event()
    call = ticker.every(0.001, again.set)
    assert again.wait(DEADLINE_S)
    call.cancel()
    assert not any(semaphore.acquire(blocking=False) for semaphore in came)
    assert names == {'ticker of a test'}


def test_a_call_cancels_itself_and_changes_the_period_of_another():
    ticker, count, others = Ticker('ticker of a test'), [], threading.Semaphore(0)

    def once():
        count.append(1)
        first.cancel()
        other.change_period(0.001)

    other = ticker.every(1000.0, others.release)
    first = ticker.every(0.001, once)
    for _ in range(5):
        assert others.acquire(timeout=DEADLINE_S)
    other.cancel()
    assert count == [1]


def test_missed_calls_are_left_out():
    ticker, go, times = Ticker('ticker of a test'), threading.Event(), []

    def call():
        times.append(periodic.due_s)
        if len(times) == 1:
            assert go.wait(DEADLINE_S)

    periodic = ticker.every(0.02, call)
    wait_until(lambda: times)
    wait_until(lambda: time.monotonic() > times[0] + 0.1)
    released_s = time.monotonic()
    go.set()
    wait_until(lambda: len(times) >= 2)
    periodic.cancel()
    assert times[1] > released_s


def test_an_exception_ends_the_calls_of_its_callback_alone(monkeypatch):
    ticker, others, failures = Ticker('ticker of a test'), threading.Semaphore(0), []
    monkeypatch.setattr(threading, 'excepthook', failures.append)
    other = ticker.every(0.001, others.release)
    first = ticker.every(0.001, lambda: 1 / 0)
    wait_until(lambda: failures)
    for _ in range(5):
        assert others.acquire(timeout=DEADLINE_S)
    other.cancel()
    wait_until(lambda: not threads('ticker of a test'))
    assert not first.is_running
    assert [(each.exc_type, each.thread.name) for each in failures] == [
        (ZeroDivisionError, 'ticker of a test')
    ]


def test_calls_whose_periods_have_a_common_multiple_are_due_together():
    ticker, times = Ticker('ticker of a test'), {0.02: [], 0.04: [], 0.06: []}
    calls = []
    for period_s, came in times.items():
        calls.append(ticker.every(period_s, lambda came=came: came.append(time.monotonic())))
        time.sleep(0.003)  # the functions are added at different times
    dues_s = [call.due_s for call in calls]
    wait_until(lambda: all(len(came) >= 3 for came in times.values()))
    for call in calls:
        call.cancel()
    assert [round((due_s - dues_s[0]) / 0.02 % 1.0, 6) % 1.0 for due_s in dues_s] == [0.0] * 3


def test_a_shorter_period_takes_effect_immediately_on_another_thread():
    ticker, came = Ticker('ticker of a test'), threading.Event()
    call = ticker.every(1000.0, came.set)
    call.change_period(0.001)
    assert came.wait(DEADLINE_S)
    call.cancel()
