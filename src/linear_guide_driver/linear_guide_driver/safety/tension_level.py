# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The present tension as safety needs it: whether it is live, and its worst recent value."""

from __future__ import annotations

from collections.abc import Sequence
import math


class TensionLevel:
    """Latest block of valid samples. No IO, no clock, no lock.

    Parameters
    ----------
    timeout_s : float
        Samples older than this do not count [s].

    Attributes
    ----------
    latest_n : float or None
        Last tension [N]; infinite when saturated; None before the first sample.
    worst_n : float
        Largest magnitude in the latest block [N]. The limit holds for both signs, since a
        sensor may be mounted the other way round.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_ns = round(timeout_s * 1e9)
        self._arrived_at_ns: int | None = None
        self._age_ns = 0  # at arrival
        self.latest_n: float | None = None
        self.worst_n = 0.0

    def add(
        self, tension_n: Sequence[float], is_saturated: bool, now_ns: int, age_ns: int = 0
    ) -> bool:
        """Take a block; return whether it counts.

        Parameters
        ----------
        tension_n : sequence of float
            Oldest first [N]. A block with a value that is not finite does not count.
        is_saturated : bool
            The sensor is at the end of its range.
        now_ns : int
            Monotonic time of arrival [ns].
        age_ns : int
            How old the last sample is at its arrival, beyond what is usual [ns].
        """
        if not tension_n or not all(map(math.isfinite, tension_n)):
            return False
        self._arrived_at_ns, self._age_ns = now_ns, age_ns
        self.latest_n = math.inf if is_saturated else tension_n[-1]
        self.worst_n = math.inf if is_saturated else max(max(tension_n), -min(tension_n))
        return True

    def forget(self) -> None:
        """Count only samples from now on."""
        self._arrived_at_ns = None

    def is_live(self, now_ns: int) -> bool:
        """Return whether valid samples arrive, and arrive in time [ns]."""
        return self._has_arrived(now_ns + self._age_ns - self._timeout_ns)

    def describe_silence(self, now_ns: int) -> str:
        """Return how the samples fail to be live, within a sentence; empty when they are [ns]."""
        if self.is_live(now_ns):
            return ''
        if 2 * self._age_ns > self._timeout_ns and self._has_arrived(now_ns - self._timeout_ns):
            return f'the strain samples arrive {self._age_ns / 1e9:.2f} s late'
        return 'no valid strain sample arrives'

    def is_above(self, limit_n: float, now_ns: int) -> bool:
        """Return whether samples that arrive are above a limit, late ones, too [N, ns]."""
        return self._has_arrived(now_ns - self._timeout_ns) and self.worst_n > limit_n

    def _has_arrived(self, since_ns: int) -> bool:
        return self._arrived_at_ns is not None and self._arrived_at_ns >= since_ns

    def describe_above(self, limit_n: float) -> str:
        """Return a sentence that says that the limit is exceeded [N]."""
        return f'The tension, {self.worst_n:.2f} N, is above the limit, {limit_n} N'

    def is_below(self, limit_n: float, now_ns: int) -> bool:
        """Return whether live samples are below a limit [N, ns]."""
        return self.is_live(now_ns) and self.worst_n < limit_n
