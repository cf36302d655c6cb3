# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last seconds of the tension, averaged down to a rate that phases are found at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tactile_features.phases.signal_changes import locate_bend
from tactile_features.windows import Samples

REDUCED_HZ = 60.0
"""Faster streams are averaged down to about this rate."""

MEMORY = 900
"""Fewest of the last samples that are kept."""

SLOPE_STEPS = 5
"""Number of steps over which a slope is computed."""

_BEND_BEFORE = 6  # samples before a place in which the bend near it is looked for
_BEND_AFTER = 6  # and samples behind it


class ReducedSignal:
    """Samples in, means of groups of them kept; the answer does not depend on the blocks.

    Parameters
    ----------
    rate_hz : float
        Of the stream [Hz].

    Attributes
    ----------
    stamp_ns : list of int
        Times of the means [ns], rising.
    tension_n : list of float
        The means [N].
    group : int
        Number of the present group, counted from sequence number 0; negative: none yet.
    """

    def __init__(self, rate_hz: float) -> None:
        self._group_size = max(1, round(rate_hz / REDUCED_HZ))
        self.clear()

    def clear(self) -> None:
        """Forget everything: the next samples have nothing to do with the last ones."""
        self._pending: list[tuple[int, float]] = []
        self.group = -1
        self.forget()

    def forget(self) -> None:
        """Forget the means, but not the group that fills."""
        self.stamp_ns: list[int] = []
        self.tension_n: list[float] = []

    def add(self, samples: Samples) -> Iterator[None]:
        """Take in samples in the order of time; yield after each new mean."""
        groups = samples['sequence'] // np.uint64(self._group_size)
        usable = np.isfinite(samples['tension_n'])
        columns = (samples['stamp_ns'], samples['tension_n'], groups, usable)
        for stamp_ns, tension_n, group, is_usable in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            if group != self.group:
                if self._close_group():
                    yield
                self.group = group
            if is_usable:
                self._pending.append((stamp_ns, tension_n))
                if len(self._pending) == self._group_size and self._close_group():
                    yield

    def _close_group(self) -> bool:
        """Keep the mean of a group as one sample; return whether there is a new one."""
        count = len(self._pending)
        if not count:
            return False
        stamp_ns = sum(stamp for stamp, _ in self._pending) // count
        tension_n = sum(tension for _, tension in self._pending) / count
        self._pending.clear()
        if self.stamp_ns and stamp_ns <= self.stamp_ns[-1]:
            return False  # times of arrival can stand still or step back
        self.stamp_ns.append(stamp_ns)
        self.tension_n.append(tension_n)
        if len(self.stamp_ns) > 2 * MEMORY:
            del self.stamp_ns[:MEMORY], self.tension_n[:MEMORY]
        return True

    def slope(self) -> float:
        """Return the slope over the last samples [N/s]."""
        first = max(-len(self.stamp_ns), -1 - SLOPE_STEPS)
        elapsed_s = (self.stamp_ns[-1] - self.stamp_ns[first]) / 1e9
        return (self.tension_n[-1] - self.tension_n[first]) / elapsed_s

    def slopes(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return where each slope in memory begins [ns], and the slope [N/s]."""
        stamp_ns = np.array(self.stamp_ns)
        tension_n = np.array(self.tension_n)
        first, last = slice(None, -SLOPE_STEPS), slice(SLOPE_STEPS, None)
        slopes = (tension_n[last] - tension_n[first]) / ((stamp_ns[last] - stamp_ns[first]) / 1e9)
        return stamp_ns[first], slopes

    def recent(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the last samples: time before the last one, negative [s], and tension [N]."""
        stamp_ns = np.array(self.stamp_ns[-count:])
        return (stamp_ns - stamp_ns[-1]) / 1e9, np.array(self.tension_n[-count:])

    def locate_bend(self, near: int) -> int:
        """Return the place of the bend near a place."""
        first, last = max(0, near - _BEND_BEFORE), near + _BEND_AFTER + 1
        stamp_ns = np.array(self.stamp_ns[first:last])
        elapsed_s = (stamp_ns - stamp_ns[0]) / 1e9
        return first + locate_bend(elapsed_s, np.array(self.tension_n[first:last]))
