# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""How much later than usual the samples of a stream arrive, by their stamps."""

from __future__ import annotations

HALF_WINDOW_NS = 5_000_000_000
"""The minimum is that of the last 5 to 10 s."""


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

        Parameters
        ----------
        stamp_ns : int
            By the clock of the sensor [ns].
        arrived_at_ns : int
            Monotonic time of arrival [ns].
        is_step : bool
            The sensor says that its clock was set.
        """
        lag_ns = arrived_at_ns - stamp_ns
        elapsed_ns = arrived_at_ns - self._since_ns
        if is_step or (self._stamp_ns is not None and stamp_ns <= self._stamp_ns):
            self._present_ns = self._before_ns = None
            self._since_ns = arrived_at_ns
        elif elapsed_ns >= HALF_WINDOW_NS:
            self._before_ns = self._present_ns if elapsed_ns < 2 * HALF_WINDOW_NS else None
            self._present_ns, self._since_ns = None, arrived_at_ns
        self._stamp_ns = stamp_ns
        self._present_ns = lag_ns if self._present_ns is None else min(self._present_ns, lag_ns)
        lowest_ns = self._present_ns
        if self._before_ns is not None:
            lowest_ns = min(lowest_ns, self._before_ns)
        return lag_ns - lowest_ns
