# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Periodic calls on a plain thread.

A timer of rclpy wakes an executor, which then checks all services, parameters and subscriptions
of its nodes; for a lifecycle node this takes 0.6 ms. A `Ticker` sleeps until the next call is due
and needs 0.03 ms per call.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import sys
import threading
import time

ROUNDING = 1e-6
"""Tolerance for rounding errors, as a fraction of a period. Without it, a call could be repeated
immediately."""


class Periodic:
    """A function that a `Ticker` calls periodically."""

    def __init__(self, ticker: Ticker, period_s: float, callback: Callable[[], object]) -> None:
        self._ticker = ticker
        self.period_s = period_s
        self.callback = callback
        self.due_s = 0.0

    @property
    def is_running(self) -> bool:
        """False after `cancel`."""
        return self.callback is not _do_nothing

    def cancel(self) -> None:
        """End the periodic calls. A call that is already running is not awaited."""
        self._ticker.remove(self)
        self.callback = _do_nothing  # break a reference cycle

    def change_period(self, period_s: float) -> None:
        """Change the period [s]. The next call follows within one new period."""
        if period_s != self.period_s:
            self._ticker.change_period(self, period_s)


class Ticker:
    """Calls functions periodically on one thread, according to the monotonic clock.

    An exception of a callback ends its periodic calls and is passed to `threading.excepthook`,
    which prints it; the other periodic calls continue. Missed calls are skipped.

    Each function is called at multiples of its period since the creation of the ticker. Calls with
    different periods are thus often made in one wake-up of the thread, which takes more time than
    most callbacks. The first call follows half a period to one and a half periods after `every`.

    Parameters
    ----------
    name : str
        Name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._began_s = time.monotonic()
        self._changed = threading.Condition()
        self._calls: list[Periodic] = []
        self._thread: threading.Thread | None = None

    def every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call ``callback`` every ``period_s`` [s] until the returned `Periodic` is cancelled."""
        call = Periodic(self, period_s, callback)
        call.due_s = self._find_due(period_s, time.monotonic() + 0.5 * period_s)
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

    def change_period(self, call: Periodic, period_s: float) -> None:
        """Change the period [s] of a call; see `Periodic.change_period`."""
        with self._changed:
            call.period_s = period_s
            call.due_s = min(call.due_s, self._find_due(period_s, time.monotonic()))
            self._changed.notify()

    def _find_due(self, period_s: float, after_s: float) -> float:
        """Return the first multiple of a period [s] later than a time [s]."""
        periods = math.floor((after_s - self._began_s) / period_s + ROUNDING) + 1
        return self._began_s + periods * period_s

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
                call.due_s = self._find_due(call.period_s, max(call.due_s, now_s))
            try:
                call.callback()
            except Exception:
                call.cancel()
                threading.excepthook(
                    threading.ExceptHookArgs((*sys.exc_info(), threading.current_thread()))
                )
            del call  # so that a cancelled callback is not kept alive until the next call


def _do_nothing() -> None: ...


SLOW_CALLS = Ticker('periodic calls')
"""Ticker that all nodes of a process share for diagnostics, heartbeats and similar checks. Its
callbacks must return within milliseconds."""
