# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of any rate as points of a plot, so that no spike is lost."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainBlock

BUCKET_NS = 10_000_000
"""Time that two points stand for, where samples come faster: a pixel of a plot of 10 s."""


class Point(NamedTuple):
    """One point of a plot. Without a tension, the line breaks: samples were lost or no numbers."""

    stamp_ns: int
    tension_n: float | None


class Decimator:
    """Turns blocks of samples into points of a plot.

    Up to two samples in a bucket of time are passed on as they are. Of more samples, the smallest
    and the largest are passed on, each at its own time. Where a bucket begins does not depend on
    how samples are grouped in blocks.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the samples of the bucket that still fills."""
        self._open: list[tuple[int, float]] = []
        self._next_sequence: int | None = None
        self.last_ns: int | None = None

    def add(self, block: StrainBlock) -> list[Point]:
        """Return the points that a block completes, in order of time.

        A block that is older than the samples before it gives none.
        """
        count = len(block.tension_n)
        if not count or (self.last_ns is not None and block.stamp_ns <= self.last_ns):
            return []
        points: list[Point] = []
        if self._next_sequence is not None and block.sequence != self._next_sequence:
            points += self._close()
            points.append(Point(block.stamp_ns - 1, None))
        stamps_ns = block.stamp_ns + np.arange(count, dtype=np.int64) * block.period_ns
        buckets = stamps_ns // BUCKET_NS
        starts = np.flatnonzero(np.diff(buckets, prepend=buckets[0] - 1))
        for start, end in zip(starts, [*starts[1:], count], strict=True):
            if self._open and self._open[0][0] // BUCKET_NS != buckets[start]:
                points += self._close()
            self._take(stamps_ns[start:end], block.tension_n[start:end])
        if block.period_ns * 2 > BUCKET_NS:  # slow: each sample is a point, at once
            points += self._close()
        self._next_sequence = block.sequence + count
        self.last_ns = int(stamps_ns[-1])
        return points

    def _take(self, stamps_ns: NDArray[np.int64], tension_n: NDArray[np.float64]) -> None:
        """Add samples of one bucket; keep two of those that it has, and one that is no number."""
        known = [*self._open, *zip(stamps_ns.tolist(), tension_n.tolist(), strict=True)]
        numbers = [sample for sample in known if math.isfinite(sample[1])]
        breaks = [sample for sample in known if not math.isfinite(sample[1])][:1]
        if len(numbers) > 2:
            smallest = min(numbers, key=lambda sample: sample[1])
            largest = max(numbers, key=lambda sample: sample[1])
            numbers = [*{smallest, largest}]
        self._open = sorted(numbers + breaks)

    def _close(self) -> list[Point]:
        points = [
            Point(stamp_ns, tension_n if math.isfinite(tension_n) else None)
            for stamp_ns, tension_n in self._open
        ]
        self._open = []
        return points
