# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The samples of one trial, counted."""

from __future__ import annotations

from tactile_bags.auditing.host_clock import SpanCounts, Unstepped
from tactile_bags.auditing.stream_counts import SampleRun


class TrialCounts:
    """A trial under way, or one that waits for its samples; counts those that it is given.

    All times are in stream time.
    """

    def __init__(self, trial_id: str, stamp_ns: int) -> None:
        self.trial_id = trial_id
        self.start_ns = self.end_ns = stamp_ns
        self.is_over = self.is_too_late = False
        self.span = SpanCounts()
        self._before: SampleRun | None = None
        self._has_begun = self._has_ended = False

    def add(self, unstepped: Unstepped) -> None:
        """Take in the next run of the stream, wherever it lies."""
        run = unstepped.run
        begin = run.up_to(self.start_ns - 1)
        end = run.up_to(self.end_ns) if self.is_over else run.size
        if begin and not self._has_begun:
            self._before = run.part(begin - 1, begin)
        if begin < end:
            if not self._has_begun and self._before is not None:
                self.span.counts.follow(self._before)
            self._has_begun = True
            self.span.add(unstepped._replace(run=run.part(begin, end)))
        if end < run.size and not self._has_ended:
            self._has_ended = True
            self._after = run.part(end, end + 1)

    def finish(self) -> SpanCounts:
        """Return what was counted; no more runs come."""
        if self._has_ended:
            self.span.counts.stop_before(self._after)
        return self.span
