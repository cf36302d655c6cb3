# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stamps of samples and events without the steps of the host's clock."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from tactile_bags.auditing.stream_counts import SampleRun, StreamCounts
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE
from tactile_ros.strain import StrainStatus

EVENT_DELAY_S = 10.0
"""Largest delay of an event behind its samples with which its trial is still audited [s]."""

CLOCK_STEP_S = 1.0
"""A stamp this far before the last one is a clock step, also without its status bit [s]."""

MAX_STEPS = 100
"""Most clock steps within `EVENT_DELAY_S` that are kept for events that come late."""


class Unstepped(NamedTuple):
    """A run of samples in stream time.

    Attributes
    ----------
    run : SampleRun
    shift_ns : int
        Its stamps are those of the run plus this [ns].
    step_ns : int
        Clock step between the sample before and its first one [ns]; 0: none.
    """

    run: SampleRun
    shift_ns: int
    step_ns: int


class SpanCounts:
    """Sample counts of a span of the stream, and the clock steps within it."""

    def __init__(self) -> None:
        self.counts = StreamCounts()
        self.steps = self.first_step_ns = 0
        self.start_shift_ns = self.end_shift_ns = 0

    def add(self, unstepped: Unstepped) -> None:
        """Count the next run."""
        if not self.counts.samples:
            self.start_shift_ns = unstepped.shift_ns
        elif unstepped.step_ns:
            self.steps += 1
            self.first_step_ns = self.first_step_ns or unstepped.step_ns
        self.end_shift_ns = unstepped.shift_ns
        self.counts.add(unstepped.run)


class HostClock:
    """Converts stamps to stream time: the host's clock as if it had never been set.

    Only so can samples before and after a clock step be compared and kept in one order.
    """

    def __init__(self) -> None:
        self._shift_ns = 0
        self._last: SampleRun | None = None  # as stamped; late ones left out
        self._past: deque[tuple[int, int]] = deque(maxlen=MAX_STEPS)  # end, shift before it

    def take(self, run: SampleRun) -> Unstepped:
        """Return the next run in stream time."""
        last = self._last
        step_ns = 0
        if last is None or not _is_late(run, last):
            step_ns = _clock_step(run, last) if last is not None else 0
            self._last = run
        if step_ns:
            self._past.append((run.stamp_ns - self._shift_ns - step_ns, self._shift_ns))
            self._shift_ns += step_ns
        stamp_ns = run.stamp_ns - self._shift_ns
        return Unstepped(run._replace(stamp_ns=stamp_ns), self._shift_ns, step_ns)

    def time_of_event(self, stamp_ns: int, latest_ns: int | None) -> int:
        """Return the stamp of an event in stream time.

        Soon after a step, an event may still be stamped by the clock before it. The clock is
        taken that puts the event nearest to the latest sample.
        """
        if latest_ns is None:
            return stamp_ns - self._shift_ns
        while self._past and self._past[0][0] < latest_ns - round(EVENT_DELAY_S * 1e9):
            self._past.popleft()
        shifts_ns = [self._shift_ns, *(shift_ns for _, shift_ns in self._past)]
        return min((stamp_ns - s for s in shifts_ns), key=lambda t: abs(t - latest_ns))


def _is_late(run: SampleRun, last: SampleRun) -> bool:
    """Return whether a run has numbers that have been passed, and the stamps that fit them."""
    if run.sequence >= last.sequence + last.size:
        return False
    elapsed_ns = last.stamp_of(run.sequence - last.sequence) - last.stamp_ns
    error_ns = abs(run.stamp_ns - last.stamp_ns - elapsed_ns)
    return error_ns < CLOCK_STEP_S * 1e9 + RATE_TOLERANCE * abs(elapsed_ns)


def _clock_step(run: SampleRun, last: SampleRun) -> int:
    """Return by how much the host's clock was set between two runs [ns]; 0: it was not."""
    is_marked = run.status & ~last.status & StrainStatus.CLOCK_STEP
    is_behind = run.stamp_ns < last.stamp_of(last.size - 1) - round(CLOCK_STEP_S * 1e9)
    if not is_marked and not is_behind:
        return 0
    # Numbers that began anew do not tell how many samples lie between.
    steps = max(last.size, run.sequence - last.sequence)
    return run.stamp_ns - last.stamp_of(steps)
