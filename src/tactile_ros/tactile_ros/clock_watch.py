# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of times in which this process did not run.

A process that is stopped (``SIGSTOP``) and continued, that gets no core, or whose computer was
suspended goes on in the middle of what it did. Requests that arrived meanwhile are still queued,
and a suspend does not even advance the monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import NamedTuple

MOST_S = 1.0
"""Longest pause between two looks that counts as running [s]."""

LOOK_S = 0.25
"""Period at which a process is to call `ClockWatch.look` [s]."""


def boot_time_s() -> float:
    """Return the time since the computer was booted, suspends included [s].

    Where the system has no such clock, the monotonic clock is used and suspends are not seen.
    """
    clock = getattr(time, 'CLOCK_BOOTTIME', None)  # Linux
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class Standstill(NamedTuple):
    """A time in which the process did not run."""

    duration_s: float
    end_s: float
    """When it ended, on the clock of the `ClockWatch` [s]."""


class ClockWatch:
    """Detects that the process stood still; thread-safe.

    Parameters
    ----------
    most_s : float
        Longest pause between two calls of `look` that counts as running [s].
    read_s : callable
        The clock [s]. It must advance while the computer is suspended.
    """

    def __init__(self, most_s: float = MOST_S, read_s: Callable[[], float] = boot_time_s) -> None:
        self._most_s = most_s
        self._lock = threading.Lock()
        self._last: Standstill | None = None
        self.read_s = read_s
        self._looked_s = read_s()

    def look(self) -> Standstill | None:
        """Note that the process runs now; return its last standstill, or None.

        Must be called every `LOOK_S`; any thread may call it at any other time as well, and is the
        first to hear of a standstill then.
        """
        with self._lock:
            now_s = self.read_s()
            if now_s - self._looked_s > self._most_s:
                self._last = Standstill(now_s - self._looked_s, now_s)
            self._looked_s = now_s
            return self._last
