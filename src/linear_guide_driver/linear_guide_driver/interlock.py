# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interlock that keeps the guide at rest while the tendon is taut.

If the guide moved while the tendon is taut, it would drag the finger along.

The tendon actuator decides whether its tendon is slack (`judge_slack`) and publishes a report.
The guide keeps the last report in a `TendonInterlock`, which refuses motion unless the tendon is
known to be slack. No IO and no clock; all times are monotonic.
"""

from __future__ import annotations

from enum import Enum
import math
from typing import NamedTuple

from linear_guide_driver.config import REST_REPORT_S
from linear_guide_driver.safety import SLACK_M, Zero
from tactile_ros.refusal import Refusal

STAYS_SLACK_M = 2 * SLACK_M
"""Displacement [m] above which a tendon that was slack counts as taut.

It is larger than `SLACK_M`, because the servo's position deviates a little."""

REPORT_AGE_S = 10 * REST_REPORT_S
"""If no report of the tendon arrives for this time [s], the guide may not move.

During this time, the servo cannot tighten unnoticed: if its driver stops polling, the bus watchdog
stops the servo."""

BY_HAND = 'or check that the finger is free and send the goal with allow_taut: true'
"""Remedy if neither the servo nor the sensor can show that the tendon is slack."""


class Slack(Enum):
    """Slackness of the tendon; values as in ``tactile_msgs/TendonSlack``."""

    UNKNOWN = 0
    SLACK = 1
    TAUT = 2


class TendonReport(NamedTuple):
    """Report on the slackness of the tendon; mirrors ``tactile_msgs/TendonSlack``."""

    slack: Slack
    displacement_m: float = math.nan  # displacement from the zero [m]; NaN if the zero is unknown
    reason: str | None = None  # why the slackness is unknown, or None


def judge_slack(
    displacement_m: float,
    zero: Zero,
    *,
    is_slack: bool,
    was_slack: bool = False,
    has_sensor: bool = True,
) -> TendonReport:
    """Return a report on the slackness of the tendon.

    Parameters
    ----------
    displacement_m : float
        Displacement of the tendon [m].
    zero : Zero
        Whether the zero of the displacement is known.
    is_slack : bool
        Value of `TendonSafety.is_slack` at this displacement. If the zero is unknown, it is True
        once the tendon has been slackened by ``max_displacement_m``, or if the sensor reads no
        tension.
    was_slack : bool
        True if the tendon was slack in the last report.
    has_sensor : bool
        True if a sensor must confirm a zero that was taken at the start.
    """
    if zero is Zero.UNKNOWN:
        if is_slack:
            return TendonReport(Slack.SLACK)
        return TendonReport(Slack.UNKNOWN, reason='the zero of the tendon is unknown')
    if zero is Zero.UNCONFIRMED and has_sensor and displacement_m <= SLACK_M:
        reason = 'the sensor has not confirmed the zero of the tendon yet'
        return TendonReport(Slack.UNKNOWN, displacement_m, reason)
    is_slack = is_slack or (was_slack and displacement_m <= STAYS_SLACK_M)
    return TendonReport(Slack.SLACK if is_slack else Slack.TAUT, displacement_m)


class TendonInterlock:
    """Decides from the last report of the tendon actuator whether the guide may move.

    Parameters
    ----------
    topic : str
        Topic of the reports, for messages.
    release : str
        Name of the service that slackens the tendon, for messages.
    """

    def __init__(self, topic: str, release: str) -> None:
        self._topic = topic
        self._slacken = f'slacken it: ros2 service call {release} std_srvs/srv/Trigger'
        self._last: tuple[TendonReport, int] | None = None

    def take(self, report: TendonReport, now_ns: int) -> None:
        """Store a report that has arrived at ``now_ns`` [ns]."""
        self._last = report, now_ns

    def judge(self, now_ns: int) -> Slack:
        """Return the slackness of the tendon at ``now_ns`` [ns]."""
        last = self._last
        if last is None or now_ns - last[1] > REPORT_AGE_S * 1e9:
            return Slack.UNKNOWN
        return last[0].slack

    def find_refusal(self, now_ns: int) -> Refusal | None:
        """Return why the guide may not move at ``now_ns`` [ns], or None if it may."""
        slack, last = self.judge(now_ns), self._last
        if slack is Slack.SLACK:
            return None
        if last is not None and slack is Slack.TAUT:
            millimetres = f'{last[0].displacement_m * 1e3:.1f} mm'
            return Refusal(f'The tendon is taut: tightened by {millimetres}', self._slacken)
        if last is not None and now_ns - last[1] <= REPORT_AGE_S * 1e9:
            reason = f'It is unknown whether the tendon is slack: {last[0].reason}'
            return Refusal(reason, f'{self._slacken}, {BY_HAND}')
        since = 'yet' if last is None else f'for {REPORT_AGE_S:g} s'
        return Refusal(
            f'No message has arrived on {self._topic} {since}, so the tendon may be taut',
            f'start the tendon actuator, {BY_HAND}; a guide without a tendon needs the parameter '
            "tendon_topic:=''",
        )
