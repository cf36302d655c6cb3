# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Periodic calls on a plain thread.

A timer of rclpy wakes an executor, which goes through all services, parameters and subscriptions
of its nodes each time: 0.6 ms for a lifecycle node. A `Ticker` sleeps until the next call is due,
and costs 0.03 ms a call.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time


class Periodic:
    """A call that a `Ticker` makes again and again."""

    def __init__(self, ticker: Ticker, period_s: float, callback: Callable[[], object]) -> None:
        self._ticker = ticker
        self._period_s = period_s
        self.callback = callback
        self.due_s = time.monotonic() + period_s

    def cancel(self) -> None:
        """Make no further call. One that runs on the ticker's thread is not waited for."""
        self._ticker.remove(self)
        self.callback = _do_nothing  # a circle would keep what it holds until Python collects it

    def change_period(self, period_s: float) -> None:
        """Call with another period [s]; on another thread, after the call that is due."""
        if period_s != self._period_s:
            self._period_s = period_s
            self.due_s = min(self.due_s, time.monotonic() + period_s)

    def schedule(self, now_s: float) -> None:
        """Set the time of the next call; calls that were missed are left out."""
        self.due_s += self._period_s
        if self.due_s <= now_s:
            self.due_s = now_s + self._period_s


class Ticker:
    """Calls at fixed periods of the monotonic clock, on one thread.

    A callback must not raise: the exception would end the thread, which has the ticker's name.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._calls: list[Periodic] = []
        self._thread: threading.Thread | None = None

    def every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call every ``period_s`` seconds until the returned call is cancelled."""
        call = Periodic(self, period_s, callback)
        with self._changed:
            self._calls.append(call)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            else:
                self._changed.notify()
        return call

    def remove(self, call: Periodic) -> None:
        """Make no further call."""
        with self._changed:
            if call in self._calls:
                self._calls.remove(call)
                self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                if not self._calls:
                    self._thread = None
                    return
                call = min(self._calls, key=lambda known: known.due_s)
                now_s = time.monotonic()
                if call.due_s > now_s:
                    self._changed.wait(call.due_s - now_s)
                    continue
                call.schedule(now_s)
            call.callback()
            del call  # it would keep what it holds until the next one is due


def _do_nothing() -> None: ...


SLOW_CALLS = Ticker('periodic calls')
"""Diagnostics and watches of all nodes of the process. Callbacks return within milliseconds."""
