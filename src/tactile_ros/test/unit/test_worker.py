# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The thread beside a node's executor."""

import threading

import pytest

from tactile_ros.bus.worker import Worker

DEADLINE_S = 10.0


@pytest.fixture
def errors():
    return []


@pytest.fixture
def worker(errors):
    worker = Worker('worker', errors.append)
    yield worker
    assert worker.stop()


def test_jobs_run_in_order_on_one_thread_once_it_is_started(worker):
    seen, done = [], threading.Event()
    for number in range(50):
        worker.submit(lambda number=number: seen.append((number, threading.current_thread().name)))
    worker.submit(done.set)
    assert seen == []
    worker.start()
    worker.start()
    assert done.wait(DEADLINE_S)
    assert seen == [(number, 'worker') for number in range(50)]


def test_periodic_calls_come_until_they_are_cancelled(worker):
    worker.start()
    came = threading.Semaphore(0)
    periodic = worker.every(0.001, came.release)
    for _ in range(5):
        assert came.acquire(timeout=DEADLINE_S)
    with worker.held():
        periodic.cancel()
        while came.acquire(blocking=False):
            pass
    other = threading.Event()
    worker.every(0.01, other.set)
    assert other.wait(DEADLINE_S)
    assert not came.acquire(blocking=False)


def test_periodic_calls_come_between_jobs_that_never_pause(worker):
    called = threading.Event()

    def again():
        if not called.is_set():
            worker.submit(again)

    worker.submit(again)
    worker.every(0.01, called.set)
    worker.start()
    assert called.wait(DEADLINE_S)


def test_missed_periodic_calls_are_left_out(worker):
    calls = []
    periodic = worker.every(1.0, lambda: calls.append(1))
    due_s = periodic.due_s
    periodic.run(due_s + 5.5)
    assert periodic.due_s == due_s + 6.5
    periodic.run(due_s + 6.6)
    assert periodic.due_s == due_s + 7.5
    assert len(calls) == 2


def test_an_error_is_told_and_ends_the_thread(worker, errors):
    worker.start()
    later, error = [], ValueError('a fault')

    def fail():
        raise error

    worker.submit(fail)
    worker.submit(lambda: later.append(1))
    worker._thread.join(DEADLINE_S)
    assert errors == [error]
    assert later == []


def test_no_job_runs_while_it_is_held(worker):
    worker.start()
    seen, done = [], threading.Event()
    with worker.held():
        worker.submit(lambda: seen.append('job'))
        worker.submit(done.set)
        seen.append('held')
    assert done.wait(DEADLINE_S)
    assert seen == ['held', 'job']


def test_a_worker_that_was_stopped_does_not_start_again(worker):
    assert worker.stop()
    worker.start()
    assert worker._thread is None
