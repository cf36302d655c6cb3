# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of periods in which this process did not run.

A process may be stopped (``SIGSTOP``) and continued, may not get a core, or its computer may be
suspended. It then continues where it was interrupted, and handles requests that arrived
meanwhile. During a suspend, even the monotonic clock does not advance.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import NamedTuple

MOST_S = 1.0
"""Longest pause between two calls of `ClockWatch.look` that is not a standstill [s]."""

LOOK_S = 0.25
"""Period with which a process must call `ClockWatch.look` [s]."""


def boot_time_s() -> float:
    """Return the time since the computer was booted, including suspends [s].

    On systems without such a clock, return the monotonic time; suspends are then not detected.
    """
    clock = getattr(time, 'CLOCK_BOOTTIME', None)  # exists only on Linux
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class Standstill(NamedTuple):
    """A period in which the process did not run."""

    duration_s: float
    end_s: float  # end of the standstill on the clock of the `ClockWatch` [s]


class ClockWatch:
    """Detects standstills of the process; thread-safe.

    Parameters
    ----------
    most_s : float
        Longest pause between two calls of `look` that is not a standstill [s].
    read_s : callable
        Returns the time [s] of a clock that advances while the computer is suspended.
    """

    def __init__(self, most_s: float = MOST_S, read_s: Callable[[], float] = boot_time_s) -> None:
        self._most_s = most_s
        self._lock = threading.Lock()
        self._last: Standstill | None = None
        self.read_s = read_s
        self._looked_s = read_s()

    def look(self) -> Standstill | None:
        """Check for a standstill since the last call; return the last standstill, or None.

        Must be called every `LOOK_S`. It may also be called at other times, on any thread.
        """
        with self._lock:
            now_s = self.read_s()
            if now_s - self._looked_s > self._most_s:
                self._last = Standstill(now_s - self._looked_s, now_s)
            self._looked_s = now_s
            return self._last
