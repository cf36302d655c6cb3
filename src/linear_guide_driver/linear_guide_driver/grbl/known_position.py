# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of the guide's position: the last report, or why it must be homed."""

from __future__ import annotations

from collections.abc import Callable
import logging
import time

from linear_guide_driver.grbl import protocol as grbl
from linear_guide_driver.grbl.guide_path import mpos_to_m
from linear_guide_driver.records import GuideState

_logger = logging.getLogger(__name__)


class KnownPosition:
    """Turns reports into states; a fault makes the position unknown until the next homing.

    Parameters
    ----------
    travel_m : float
        Of the guide [m].
    clock_ns : callable
        Clock that stamps states [ns].
    on_state : callable
        Called with each `GuideState`, on the reader thread.
    on_trouble : callable
        Called with a reason, on the reader thread, when a fault has lost the position.

    Attributes
    ----------
    trouble : str
        Why the guide must be homed before it can move; empty when it need not.
    direction : int
        Of the running move: 1 or -1; 0 when there is none.
    """

    def __init__(
        self,
        travel_m: float,
        clock_ns: Callable[[], int],
        on_state: Callable[[GuideState], None],
        on_trouble: Callable[[str], None],
    ) -> None:
        self._travel_m, self._clock_ns = travel_m, clock_ns
        self._on_state, self._on_trouble = on_state, on_trouble
        # When it came, by the node's clock and by the monotonic one [ns].
        self._last: tuple[grbl.StatusReport, int, int] | None = None
        self.direction = 0
        self.trouble = ''

    @property
    def last(self) -> tuple[GuideState, int] | None:
        """The last state, and when it came by the monotonic clock [ns]; None before the first."""
        last = self._last
        return None if last is None else (self._to_state(*last[:2]), last[2])

    def lose(self, reason: str) -> None:
        """Note why the position is unknown. The first reason is the cause of the others."""
        self.trouble = self.trouble or reason

    def take_fault(self, reason: str) -> None:
        """Take a fault of the controller or the line."""
        if not self.trouble:
            self.trouble = reason
            self._on_trouble(reason)

    def take_report(self, report: grbl.StatusReport) -> None:
        """Take a report of the controller."""
        if report.state == 'Alarm':
            self.take_fault('the controller is locked in Alarm')
        self._last = (report, self._clock_ns(), time.monotonic_ns())
        try:
            self._on_state(self._to_state(*self._last[:2]))
        except Exception:  # the reader must outlive it: it sees alarms and answers
            _logger.exception('the consumer of the guide states failed')

    def to_state(self, report: grbl.StatusReport) -> GuideState:
        """Return the state that a report tells now."""
        return self._to_state(report, self._clock_ns())

    def _to_state(self, report: grbl.StatusReport, received_at_ns: int) -> GuideState:
        return GuideState(
            position_m=None if self.trouble else mpos_to_m(report, self._travel_m),
            velocity_m_s=self.direction * (report.feed_mm_min or 0.0) / 60e3,
            state=report.state,
            received_at_ns=received_at_ns,
        )
