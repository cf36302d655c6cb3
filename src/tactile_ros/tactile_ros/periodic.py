# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Periodic calls on a plain thread.

A timer of rclpy wakes an executor, which then checks all services, parameters and subscriptions
of its nodes; for a lifecycle node this takes 0.6 ms. A `Ticker` sleeps until the next call is due
and needs 0.03 ms per call.
"""

from __future__ import annotations

from collections.abc import Callable
import sys
import threading
import time


class Periodic:
    """A periodic call of a `Ticker`."""

    def __init__(self, ticker: Ticker, period_s: float, callback: Callable[[], object]) -> None:
        self._ticker = ticker
        self._period_s = period_s
        self.callback = callback
        self.due_s = time.monotonic() + period_s

    @property
    def is_running(self) -> bool:
        """False after `cancel`."""
        return self.callback is not _do_nothing

    def cancel(self) -> None:
        """End the periodic call, without waiting for a call that is running."""
        self._ticker.remove(self)
        self.callback = _do_nothing  # break a reference cycle

    def change_period(self, period_s: float) -> None:
        """Change the period [s].

        If called on another thread than the ticker's, it applies after the next call.
        """
        if period_s != self._period_s:
            self._period_s = period_s
            self.due_s = min(self.due_s, time.monotonic() + period_s)

    def schedule(self, now_s: float) -> None:
        """Set the time of the next call; missed calls are skipped."""
        self.due_s += self._period_s
        if self.due_s <= now_s:
            self.due_s = now_s + self._period_s


class Ticker:
    """Makes periodic calls on one thread, by the monotonic clock.

    An exception of a callback ends its periodic calls and is passed to `threading.excepthook`,
    which prints it. The other periodic calls continue.

    Parameters
    ----------
    name : str
        Name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._calls: list[Periodic] = []
        self._thread: threading.Thread | None = None

    def every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call ``callback`` every ``period_s`` [s] until the returned `Periodic` is cancelled."""
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
        """Remove a periodic call."""
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
            try:
                call.callback()
            except Exception:
                call.cancel()
                threading.excepthook(
                    threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread()))
                )
            del call  # do not keep its objects alive until the next call


def _do_nothing() -> None: ...


SLOW_CALLS = Ticker('periodic calls')
"""Ticker of diagnostics and watches of all nodes; its callbacks must return within
milliseconds."""
