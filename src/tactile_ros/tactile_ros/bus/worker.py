# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A thread of a node beside its executor: for data of its process, and for periodic calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import queue
import threading
import time

END_TIMEOUT_S = 3.0
"""How long the end of a node waits for a callback that runs."""


class Periodic:
    """A call that a `Worker` makes again and again; see `Worker.every`."""

    def __init__(self, worker: Worker, period_s: float, callback: Callable[[], object]) -> None:
        self._worker = worker
        self._period_s = period_s
        self._callback = callback
        self.due_s = time.monotonic() + period_s

    def run(self, now_s: float) -> None:
        """Call, and set the time of the next call. Calls that were missed are left out."""
        self.due_s += self._period_s
        if self.due_s <= now_s:
            self.due_s = now_s + self._period_s
        self._callback()

    def cancel(self) -> None:
        """Call no more. Harmless when called twice."""
        self._worker.remove(self)


class Worker:
    """Runs jobs in the order of their arrival, and periodic calls, on one thread.

    rclpy's executor goes through all that a node owns each time it wakes: services, parameters,
    timers. This thread sleeps in one queue instead.

    Parameters
    ----------
    name : str
        Of the thread.
    on_error : callable
        Given what a job has raised, on this thread, which ends then.

    Attributes
    ----------
    lock : threading.RLock
        Held while a job or a periodic call runs.
    """

    def __init__(self, name: str, on_error: Callable[[Exception], None]) -> None:
        self._name = name
        self._on_error = on_error
        self._jobs: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._periodic: tuple[Periodic, ...] = ()
        self._is_ending = False
        self._thread: threading.Thread | None = None
        self.lock = threading.RLock()

    def submit(self, job: Callable[[], object]) -> None:
        """Have a job run; it waits until the worker is started."""
        self._jobs.put(job)

    def every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call every ``period_s`` seconds of the computer's time, while the worker runs."""
        periodic = Periodic(self, period_s, callback)
        with self.lock:
            self._periodic = (*self._periodic, periodic)
        self.submit(_do_nothing)  # it may sleep for longer
        return periodic

    def remove(self, periodic: Periodic) -> None:
        """Take a periodic call away."""
        with self.lock:
            self._periodic = tuple(p for p in self._periodic if p is not periodic)

    def start(self) -> None:
        """Start the thread. Harmless when it runs or has ended."""
        if self._thread is None and not self._is_ending:
            self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            self._thread.start()

    def stop(self) -> bool:
        """End the thread for good; return False if a callback does not end."""
        self._is_ending = True
        self.submit(_do_nothing)
        thread = self._thread
        if thread is None or thread is threading.current_thread():
            return True
        thread.join(END_TIMEOUT_S)
        return not thread.is_alive()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Let no job run meanwhile. One that does not end is waited for `END_TIMEOUT_S`."""
        is_held = self.lock.acquire(timeout=END_TIMEOUT_S)
        try:
            yield
        finally:
            if is_held:
                self.lock.release()

    def _run(self) -> None:
        while not self._is_ending:
            job = self._next_job()
            if self._is_ending:
                return
            try:
                with self.lock:
                    job()
                    self._run_periodic()
            except Exception as error:
                self._on_error(error)
                return
            del job  # it would keep what it holds until the next one comes

    def _next_job(self) -> Callable[[], object]:
        periodic = self._periodic
        if not periodic:
            return self._jobs.get()
        timeout_s = min(p.due_s for p in periodic) - time.monotonic()
        try:
            return self._jobs.get(timeout=max(0.0, timeout_s))
        except queue.Empty:
            return _do_nothing

    def _run_periodic(self) -> None:
        now_s = time.monotonic()
        for periodic in self._periodic:
            # An earlier call may have cancelled this one.
            if periodic.due_s <= now_s and periodic in self._periodic:
                periodic.run(now_s)


def _do_nothing() -> None: ...
