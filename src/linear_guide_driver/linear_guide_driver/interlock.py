# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interlock of guide and tendon: with a taut tendon the guide would drag the finger.

The tendon actuator judges whether its tendon is slack (`judge_slack`) and publishes the report.
The guide keeps the last report in a `TendonInterlock`, which refuses to move unless the tendon is
known to be slack. No IO and no clock; all times are monotonic.
"""

from __future__ import annotations

from enum import Enum
import math
from typing import NamedTuple

from linear_guide_driver.records import REST_REPORT_S
from linear_guide_driver.safety import SLACK_M, Zero
from tactile_ros.refusal import Refusal

STAYS_SLACK_M = 2 * SLACK_M
"""A slack tendon with a known zero counts as taut above this: the servo yields a little."""

REPORT_AGE_S = 10 * REST_REPORT_S
"""Longest silence of the tendon's reports with which the guide may move [s].

Without its driver's polls the servo tightens nothing: its bus watchdog stops it before."""

BY_HAND = 'or look at the finger and send the goal with allow_taut: true'
"""The way out where neither servo nor sensor can tell that the tendon is slack."""


class Slack(Enum):
    """Slackness of the tendon; values as in ``tactile_msgs/TendonSlack``."""

    UNKNOWN = 0
    SLACK = 1
    TAUT = 2


class TendonReport(NamedTuple):
    """Judgement of one state of the tendon.

    ``displacement_m`` counts from the zero [m]; NaN while the zero is unknown. ``reason`` says why
    it is unknown whether the tendon is slack; otherwise it is empty.
    """

    slack: Slack
    displacement_m: float = math.nan
    reason: str = ''


def judge_slack(
    displacement_m: float,
    zero: Zero,
    *,
    is_slack: bool,
    was_slack: bool = False,
    has_sensor: bool = True,
) -> TendonReport:
    """Judge whether a tendon is slack at a displacement [m].

    Parameters
    ----------
    displacement_m, zero
        How far the servo has tightened the tendon, and what is known of the zero.
    is_slack : bool
        `TendonSafety.is_slack` at this displacement. Without a known zero it is true once the
        tendon has been slackened by ``max_displacement_m``, or where the sensor reads no tension.
    was_slack : bool
        The last judgement was slack.
    has_sensor : bool
        A sensor must confirm a zero that was taken at the start.
    """
    if zero is Zero.UNKNOWN:
        if is_slack:
            return TendonReport(Slack.SLACK)
        return TendonReport(Slack.UNKNOWN, reason='the zero of the tendon is unknown')
    if zero is Zero.UNCONFIRMED and has_sensor and displacement_m <= SLACK_M:
        reason = 'no sample of the sensor has confirmed the zero of the tendon yet'
        return TendonReport(Slack.UNKNOWN, displacement_m, reason)
    is_slack = is_slack or (was_slack and displacement_m <= STAYS_SLACK_M)
    return TendonReport(Slack.SLACK if is_slack else Slack.TAUT, displacement_m)


class TendonInterlock:
    """Permission of the guide to move, from the last report of the tendon actuator.

    ``topic`` is that of the reports, ``release`` the name of the service that slackens the tendon.
    """

    def __init__(self, topic: str, release: str) -> None:
        self._topic = topic
        self._slacken = f'slacken it: ros2 service call {release} std_srvs/srv/Trigger'
        self._last: tuple[TendonReport, int] | None = None

    def take(self, report: TendonReport, now_ns: int) -> None:
        """Take a report that has arrived now [ns]."""
        self._last = report, now_ns

    def judge(self, now_ns: int) -> Slack:
        """Return what is known of the tendon now [ns]."""
        last = self._last
        if last is None or now_ns - last[1] > REPORT_AGE_S * 1e9:
            return Slack.UNKNOWN
        return last[0].slack

    def find_refusal(self, now_ns: int) -> Refusal | None:
        """Return why the guide may not move now [ns], or None when the tendon is slack."""
        slack, last = self.judge(now_ns), self._last
        if slack is Slack.SLACK:
            return None
        if last is not None and slack is Slack.TAUT:
            millimetres = f'{last[0].displacement_m * 1e3:.1f} mm'
            return Refusal(f'The tendon is taut: tightened by {millimetres}', self._slacken)
        if last is not None and now_ns - last[1] <= REPORT_AGE_S * 1e9:
            reason = f'It is unknown whether the tendon is slack: {last[0].reason}'
            return Refusal(reason, f'{self._slacken}, {BY_HAND}')
        heard = 'yet' if last is None else f'for {REPORT_AGE_S:g} s'
        return Refusal(
            f'Nothing was heard on {self._topic} {heard}, so the tendon may be taut',
            f'start the tendon actuator, {BY_HAND}; a guide without a tendon needs the parameter '
            "tendon_topic:=''",
        )
