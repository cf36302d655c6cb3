# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a slack tendon, and the permission of the guide to move."""

import math

import pytest

from linear_guide_driver.interlock import (
    judge_slack,
    REPORT_AGE_S,
    Slack,
    TendonInterlock,
    TendonReport,
)
from linear_guide_driver.safety import SLACK_M, Zero

AGE_NS = round(REPORT_AGE_S * 1e9)


@pytest.mark.parametrize(
    ('displacement_m', 'zero', 'facts', 'slack'),
    [
        (0.0, Zero.KNOWN, {'is_slack': True}, Slack.SLACK),
        (0.004, Zero.KNOWN, {'is_slack': False}, Slack.TAUT),
        (0.0007, Zero.KNOWN, {'is_slack': False}, Slack.TAUT),
        (0.0007, Zero.KNOWN, {'is_slack': False, 'was_slack': True}, Slack.SLACK),
        (0.0011, Zero.KNOWN, {'is_slack': False, 'was_slack': True}, Slack.TAUT),
        # At the start the sensor has not confirmed the zero. If there is no sensor, nothing
        # confirms it.
        (0.0, Zero.UNCONFIRMED, {'is_slack': True}, Slack.UNKNOWN),
        (0.0, Zero.UNCONFIRMED, {'is_slack': True, 'has_sensor': False}, Slack.SLACK),
        (0.004, Zero.UNCONFIRMED, {'is_slack': False}, Slack.TAUT),
        # With an unknown zero, the tendon is slack if it has been slackened by the longest
        # possible pull, or if the sensor reads no tension.
        (-0.02, Zero.UNKNOWN, {'is_slack': True}, Slack.SLACK),
        (0.0, Zero.UNKNOWN, {'is_slack': False}, Slack.UNKNOWN),
        (0.0, Zero.UNKNOWN, {'is_slack': False, 'was_slack': True}, Slack.UNKNOWN),
    ],
)
def test_a_tendon_is_slack_taut_or_unknown(displacement_m, zero, facts, slack):
    report = judge_slack(displacement_m, zero, **facts)
    assert report.slack is slack
    assert bool(report.reason) == (slack is Slack.UNKNOWN)
    assert math.isnan(report.displacement_m) == (zero is Zero.UNKNOWN)


def test_the_guide_may_move_with_a_fresh_report_of_a_slack_tendon_only():
    interlock = TendonInterlock('tendon_actuator/slack', '/hand/tendon_actuator/release')

    def refused(now_ns):
        return str(interlock.find_refusal(now_ns))

    assert 'No message has arrived on tendon_actuator/slack yet' in refused(0)
    assert 'tendon_topic' in refused(0)
    interlock.take(TendonReport(Slack.SLACK, SLACK_M), 0)
    assert interlock.find_refusal(AGE_NS) is None
    assert 'No message has arrived on tendon_actuator/slack for 2 s' in refused(AGE_NS + 1)
    interlock.take(TendonReport(Slack.TAUT, 0.0049), 10 * AGE_NS)
    assert refused(10 * AGE_NS) == (
        'The tendon is taut: tightened by 4.9 mm; slacken it: ros2 service call '
        '/hand/tendon_actuator/release std_srvs/srv/Trigger.'
    )
    interlock.take(TendonReport(Slack.UNKNOWN, reason='the servo is silent'), 11 * AGE_NS)
    assert 'unknown whether the tendon is slack: the servo is silent; ' in refused(11 * AGE_NS)
    assert 'allow_taut: true' in refused(11 * AGE_NS)
    assert interlock.judge(12 * AGE_NS + 1) is Slack.UNKNOWN
