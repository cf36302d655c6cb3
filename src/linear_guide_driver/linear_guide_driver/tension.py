# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tension on the tendon: what it is, how old it is, and whether it can be relied on."""

from __future__ import annotations

from collections.abc import Sequence
import math

__all__ = ['SampleLag', 'TensionLevel']

_HALF_WINDOW_NS = 5_000_000_000
"""The minimum of the samples' lag is that of the last 5 to 10 s."""


class TensionLevel:
    """Latest block of valid samples; no lock. Those older than ``timeout_s`` do not count [s].

    ``latest_n`` is the last tension [N]: infinite when saturated, None before the first sample.
    ``worst_n`` is the largest magnitude in the latest block [N]: the limit holds for both signs,
    since a sensor may be mounted the other way round.
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
        """Take a block as `TendonSafety.add_samples` does; return whether it counts."""
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

    def format_silence(self, now_ns: int) -> str:
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

    def format_above(self, limit_n: float) -> str:
        """Return a sentence that says that the limit is exceeded [N]."""
        return f'The tension, {self.worst_n:.2f} N, is above the limit, {limit_n} N'

    def is_below(self, limit_n: float, now_ns: int) -> bool:
        """Return whether live samples are below a limit [N, ns]."""
        return self.is_live(now_ns) and self.worst_n < limit_n


class SampleLag:
    """Compares a sample's lag, arrival minus stamp, with the minimum of the last seconds.

    Stamps and arrivals need no common clock: only differences of lags count, and a stamp can only
    make a sample older. A stamp that is not later than the one before it tells that the clock was
    set back, or stands: then the minimum begins anew with this sample. After a step that no stamp
    shows, as one during a silence, it is right again after 10 s at the latest.
    """

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._since_ns = 0
        self._present_ns: int | None = None  # minimum since then
        self._before_ns: int | None = None  # minimum of the half window before

    def add(self, stamp_ns: int, arrived_at_ns: int, *, is_step: bool = False) -> int:
        """Take a sample; return how much its lag is above the recent minimum [ns].

        ``stamp_ns`` is by the clock of the sensor, ``arrived_at_ns`` by the monotonic one [ns].
        ``is_step``: the sensor says that its clock was set.
        """
        lag_ns = arrived_at_ns - stamp_ns
        if is_step or (self._stamp_ns is not None and stamp_ns <= self._stamp_ns):
            self._present_ns = self._before_ns = None
            self._since_ns = arrived_at_ns
        elif arrived_at_ns - self._since_ns >= _HALF_WINDOW_NS:
            # However long none came: those of a queue that nobody emptied are old.
            self._before_ns = self._present_ns
            self._present_ns, self._since_ns = None, arrived_at_ns
        self._stamp_ns = stamp_ns
        self._present_ns = lag_ns if self._present_ns is None else min(self._present_ns, lag_ns)
        lowest_ns = self._present_ns
        if self._before_ns is not None:
            lowest_ns = min(lowest_ns, self._before_ns)
        return lag_ns - lowest_ns
