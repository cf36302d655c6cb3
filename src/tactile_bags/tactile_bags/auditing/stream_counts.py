# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Counts what is missing, doubled or late in a stream of blocks, by their numbers."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from tactile_ros.strain import StrainStatus

MAX_GAPS = 10_000
"""Gaps that are remembered, for samples that come late after all."""


class SampleRun(NamedTuple):
    """A block of samples without their values, or a part of one."""

    stamp_ns: int
    period_ns: int
    sequence: int
    size: int
    lost_before: int
    status: int

    def stamp_of(self, i: int) -> int:
        return self.stamp_ns + i * self.period_ns

    def part(self, begin: int, end: int) -> SampleRun:
        """Return the samples from ``begin`` up to but not with ``end``."""
        return self._replace(
            stamp_ns=self.stamp_of(begin),
            sequence=self.sequence + begin,
            size=end - begin,
            lost_before=0 if begin else self.lost_before,
        )

    def up_to(self, stamp_ns: int) -> int:
        """Return how many samples are not later than this."""
        if self.period_ns <= 0:
            return self.size if self.stamp_ns <= stamp_ns else 0
        return min(self.size, max(0, (stamp_ns - self.stamp_ns) // self.period_ns + 1))


class StreamCounts:
    """Goes along a stream of runs and counts what is missing, doubled, late."""

    def __init__(self) -> None:
        self.samples = self.lost = self.gaps = self.duplicates = self.disordered = 0
        self.restarts = self.reconnections = 0
        self.start_ns = self.end_ns = 0
        self.largest_step_ns = 0
        self._next: int | None = None
        self._status = 0
        self._missing: deque[tuple[int, int]] = deque(maxlen=MAX_GAPS)
        self._span_ns = self._steps = 0
        self._segment: tuple[int, int] | None = None

    def follow(self, before: SampleRun) -> None:
        """Begin behind this run, which does not count itself."""
        self._next = before.sequence + before.size
        self._status = before.status
        self.end_ns = before.stamp_of(before.size - 1)

    def stop_before(self, after: SampleRun) -> None:
        """End before this run, which does not count itself."""
        if self._next is not None and after.sequence > self._next:
            self._lose(after.sequence - self._next, after.sequence)

    def _lose(self, count: int, sequence: int) -> None:
        assert self._next is not None
        if count:
            self.gaps += 1
            self.lost += count
        if sequence > self._next:
            self._missing.append((self._next, sequence))

    def add(self, run: SampleRun) -> None:
        if self._next is not None and run.sequence < self._next:
            if run.stamp_ns <= self.end_ns:
                self._take_late(run)
                return
            self.restarts += 1
            self._close_segment()
            self._next = None
        self._take_new(run)

    def _take_late(self, run: SampleRun) -> None:
        """Take a run whose numbers have been passed: late, again, or partly new."""
        assert self._next is not None
        old = min(run.size, self._next - run.sequence)
        late = self._fill(run.sequence, run.sequence + old)
        self.samples += late
        self.disordered += late
        self.duplicates += old - late
        if old < run.size:
            self._take_new(run.part(old, run.size))

    def _fill(self, begin: int, end: int) -> int:
        """Take these numbers out of those that are missing; return how many were."""
        filled, left = 0, []
        for low, high in self._missing:
            inside = min(high, end) - max(low, begin)
            if inside <= 0:
                left.append((low, high))
                continue
            filled += inside
            left += [part for part in ((low, begin), (end, high)) if part[0] < part[1]]
        if filled:
            self.lost -= filled
            self.gaps += len(left) - len(self._missing)
            self._missing = deque(left, maxlen=MAX_GAPS)
        return filled

    def _take_new(self, run: SampleRun) -> None:
        if self._next is not None:
            # What the driver knows of may be more than the numbering shows.
            self._lose(max(run.sequence - self._next, run.lost_before), run.sequence)
            self.largest_step_ns = max(self.largest_step_ns, run.stamp_ns - self.end_ns)
        if run.status & ~self._status & StrainStatus.RECONNECTED:
            self.reconnections += 1
        if not self.samples:
            self.start_ns = run.stamp_ns
        if self._segment is None:
            self._segment = (run.sequence, run.stamp_ns)
        if run.size > 1:
            self.largest_step_ns = max(self.largest_step_ns, run.period_ns)
        self.samples += run.size
        self._next = run.sequence + run.size
        self._status = run.status
        self.end_ns = run.stamp_of(run.size - 1)

    def _close_segment(self) -> None:
        """Take the time and the numbers since the numbering last began anew."""
        steps, span_ns = self._of_segment()
        self._steps += steps
        self._span_ns += span_ns
        self._segment = None

    def _of_segment(self) -> tuple[int, int]:
        if self._segment is None or self._next is None:
            return 0, 0
        sequence, stamp_ns = self._segment
        return self._next - 1 - sequence, self.end_ns - stamp_ns

    @property
    def rate_hz(self) -> float:
        steps, span_ns = self._of_segment()
        steps, span_ns = self._steps + steps, self._span_ns + span_ns
        return steps / span_ns * 1e9 if steps > 0 and span_ns > 0 else 0.0
