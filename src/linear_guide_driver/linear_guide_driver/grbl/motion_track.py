# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One commanded motion as its position reports show it: when it began, how fast and steady it was.

A report that comes ``delay`` late makes the motion look as if it had begun ``delay`` later, and
never earlier. So the earliest start that any report suggests is the best one, and a lag is
real only if all later reports share it.
"""

from __future__ import annotations

from typing import NamedTuple

MOVED_M = 0.0002
"""Displacement that counts as motion: above the resolution and the jitter of both axes."""

CRUISE_SHARE = 0.05
"""Share of the path at each end in which an axis may still speed up or brake [1]."""

START_REPORTS = 2
"""Reports in motion that say when it began, unless it ends before."""

LEAST_REPORTS = 3
"""Reports at full speed without which a motion cannot be judged."""


class MotionSummary(NamedTuple):
    """Speed and lag of a motion.

    ``mean_speed_m_s`` is the slope of a line through the reports at full speed [m/s]. ``lag_s``
    is the longest time by which it fell behind a motion of the commanded speed: the sum of its
    pauses and of what it was too slow [s].
    """

    mean_speed_m_s: float
    lag_s: float


class MotionTrack:
    """Position reports of one motion at a commanded speed; add in one thread, read in any."""

    def __init__(self, start_m: float, target_m: float, speed_m_s: float) -> None:
        self._start_m = start_m
        self._path_m = abs(target_m - start_m)
        self._sign = 1.0 if target_m >= start_m else -1.0
        self._speed_m_s = speed_m_s
        self._moving: list[tuple[int, float]] = []  # stamp [ns], path covered [m]
        self._is_over = False

    @property
    def is_motion(self) -> bool:
        """True when there is a path to move along."""
        return self._path_m > 2 * MOVED_M

    def add(self, stamp_ns: int, position_m: float) -> None:
        """Take in one report: its stamp [ns] and the position [m]."""
        covered_m = self._sign * (position_m - self._start_m)
        if self._moving and stamp_ns == self._moving[-1][0]:
            return  # the same report again
        if covered_m > self._path_m - MOVED_M:
            self._is_over = True
        elif covered_m > MOVED_M and not self._is_over:
            self._moving.append((stamp_ns, covered_m))

    @property
    def start_ns(self) -> int | None:
        """When the motion began [ns]; None while not enough of it has been reported.

        It is extrapolated backwards from the first reports at the commanded speed. An axis that
        needs the time ``t`` to reach its speed seems to begin up to ``t / 2`` after its
        first step.
        """
        first = self._starts(self._moving[:START_REPORTS])
        return min(first) if len(first) == START_REPORTS or (first and self._is_over) else None

    @property
    def end_ns(self) -> int | None:
        """When the motion was at its target [ns], extrapolated from the last cruising reports."""
        last = self._starts(self._cruise()[-LEAST_REPORTS:])
        return min(last) + round(self._path_m / self._speed_m_s * 1e9) if last else None

    def summarise(self, least_lag_s: float = 0.0) -> MotionSummary | None:
        """Return how it went; None when fewer than `LEAST_REPORTS` came at full speed.

        ``least_lag_s`` is a lag that is known otherwise [s].
        """
        cruise = self._cruise()
        if len(cruise) < LEAST_REPORTS:
            return None
        starts = self._starts(cruise)
        # The last report alone cannot tell a lag from its own delay.
        lags_ns = [
            min(starts[index:]) - min(starts[: index + 1]) for index in range(len(starts) - 1)
        ]
        return MotionSummary(_fit_slope(cruise), max(least_lag_s, max(lags_ns) / 1e9))

    def _cruise(self) -> list[tuple[int, float]]:
        margin_m = max(MOVED_M, CRUISE_SHARE * self._path_m)
        return [r for r in list(self._moving) if margin_m <= r[1] <= self._path_m - margin_m]

    def _starts(self, reports: list[tuple[int, float]]) -> list[int]:
        """Return when the motion began by each report, had it the commanded speed [ns]."""
        return [stamp - round(path_m / self._speed_m_s * 1e9) for stamp, path_m in reports]


def _fit_slope(reports: list[tuple[int, float]]) -> float:
    """Return the slope of the least-squares line [m/s]; 0 when the stamps stand still."""
    times_s = [(stamp - reports[0][0]) / 1e9 for stamp, _ in reports]
    mean_s = sum(times_s) / len(times_s)
    mean_m = sum(path_m for _, path_m in reports) / len(reports)
    spread = sum((t - mean_s) ** 2 for t in times_s)
    product = sum((t - mean_s) * (r[1] - mean_m) for t, r in zip(times_s, reports, strict=True))
    return product / spread if spread else 0.0
