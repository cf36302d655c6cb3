# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The guide with a taut tendon: with both real drivers, or with reports from the test."""

import pytest

from linear_guide_driver.interlock import REPORT_AGE_S, Slack
from linear_guide_driver.linear_guide_node import LinearGuideNode
from linear_guide_driver.safety import Zero
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import HomeGuide, MoveGuide, PullTendon
from tactile_msgs.msg import Readiness, TendonSlack
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import LATEST
from tactile_testing.waiting import wait_until

TENDON = {'watchdog_s': 1.0, 'unguarded': True, 'speed_m_s': 0.02}


@pytest.fixture
def tendon(bench, servo):
    """Return the driver of a real servo without a sensor."""
    node = bench.make(TendonActuatorNode, port=servo.port, **TENDON)
    assert node.bring_up()
    with NodeGroup([node], context=bench.context):
        yield node


@pytest.fixture
def guide(bench, grbl):
    """Return a bench with a guide that starts goals without waiting for topics."""
    bench.start(LinearGuideNode, port=grbl.port, poll_rate_hz=20.0, peer_wait_s=0.1)
    return bench


@pytest.fixture
def report(guide):
    """Return a function that publishes a report of the tendon and waits until the guide has it."""
    publisher = guide.peer.create_publisher(TendonSlack, 'tendon_actuator/slack', LATEST)

    def publish(slack, displacement_m=0.0, reason=''):
        message = TendonSlack(state=slack.value, displacement_m=displacement_m, reason=reason)

        def is_heard():
            publisher.publish(message)
            guide.node.poll_now()
            last = guide.node._interlock._last
            return last is not None and last[0].slack is slack

        wait_until(is_heard, poll_s=0.02)

    return publish


def home(bench, **fields):
    return bench.send(HomeGuide, '/linear_guide/home', **fields)


def move(bench, position_m, speed_m_s=0.1, **fields):
    fields |= {'position_m': position_m, 'speed_m_s': speed_m_s}
    return bench.send(MoveGuide, '/linear_guide/move', **fields)


def pull(bench, displacement_m):
    fields = {'displacement_m': displacement_m, 'speed_m_s': 0.02, 'contact': 'flexion'}
    return bench.send(PullTendon, '/tendon_actuator/pull', **fields)


def test_with_a_taut_tendon_the_guide_moves_in_a_glide_only(guide, grbl, servo, tendon):
    assert guide.result(home(guide))[0] == 'succeeded'
    assert guide.result(move(guide, 0.01))[0] == 'succeeded'
    assert guide.result(pull(guide, 0.004))[0] == 'succeeded'
    before = grbl.mpos, len(grbl.lines)
    for send_goal in (home, lambda bench: move(bench, 0.05)):
        guide.aborts(send_goal(guide), 'ros2 service call /tendon_actuator/release')
    assert (grbl.mpos, len(grbl.lines)) == before, 'nothing was sent to the controller'
    assert guide.result(move(guide, 0.02, allow_taut=True))[0] == 'succeeded'  # glides on a plate
    assert guide.call('/tendon_actuator/release').success
    wait_until(lambda: servo.position == 2048)
    assert guide.result(move(guide, 0.01))[0] == 'succeeded'
    assert guide.result(home(guide))[0] == 'succeeded'


def test_a_tendon_that_is_tightened_in_an_approach_stops_the_guide(guide, grbl, tendon):
    assert guide.result(home(guide))[0] == 'succeeded'
    handle = move(guide, 0.19, 0.01)
    wait_until(lambda: grbl.is_moving)
    assert guide.result(pull(guide, 0.004))[0] == 'succeeded'
    guide.aborts(handle, 'taut')
    assert guide.node._client.state.position_m is not None
    assert not grbl.is_moving


def test_the_end_of_a_release_is_followed_by_a_move_at_once(guide, tendon):
    assert guide.result(home(guide))[0] == 'succeeded'
    for position_m in (0.01, 0.02, 0.01):
        assert guide.result(pull(guide, 0.003))[0] == 'succeeded'
        assert guide.result(pull(guide, 0.0))[0] == 'succeeded'
        assert guide.result(move(guide, position_m))[0] == 'succeeded'


def test_without_reports_the_guide_moves_by_hand_only(guide, grbl, report):
    readiness = []
    guide.peer.create_subscription(Readiness, '/linear_guide/ready', readiness.append, LATEST)
    message = guide.aborts(home(guide), 'tendon_actuator/slack')
    assert 'allow_taut' in message
    assert guide.result(home(guide, allow_taut=True))[0] == 'succeeded'
    report(Slack.UNKNOWN, reason='the servo is silent')
    guide.aborts(move(guide, 0.01), 'the servo is silent')
    wait_until(lambda: 'the servo is silent' in ' '.join(readiness[-1].missing))
    assert guide.result(move(guide, 0.01, allow_taut=True))[0] == 'succeeded'
    report(Slack.SLACK)
    handle = move(guide, 0.19, 0.01)  # the move takes longer than the allowed silence of reports
    guide.aborts(handle, f'tendon_actuator/slack for {REPORT_AGE_S:g} s')
    assert guide.node._client.state.position_m is not None
    assert not grbl.is_moving


def test_a_homing_ends_when_the_tendon_becomes_taut(guide, grbl, report):
    grbl.home_s = 30.0
    report(Slack.SLACK)
    handle = home(guide)
    wait_until(lambda: grbl.state == 'Home')
    report(Slack.TAUT, 0.004)
    guide.aborts(handle, 'taut')


def test_a_guide_without_a_tendon_needs_no_report(bench, grbl):
    bench.start(LinearGuideNode, port=grbl.port, poll_rate_hz=20.0, tendon_topic='')
    assert bench.result(home(bench))[0] == 'succeeded'
    assert bench.result(move(bench, 0.01))[0] == 'succeeded'


def test_an_unknown_zero_is_no_slack_tendon_until_it_was_slackened(bench, servo):
    bench.start(TendonActuatorNode, port=servo.port, **TENDON)
    heard, client = [], bench.node._client
    bench.peer.create_subscription(TendonSlack, '/tendon_actuator/slack', heard.append, LATEST)
    wait_until(lambda: heard and heard[-1].state == TendonSlack.SLACK)
    client.safety.set_zero(Zero.UNKNOWN, 'it was lost')
    wait_until(lambda: heard[-1].state == TendonSlack.UNKNOWN)
    assert 'zero' in heard[-1].reason
    # Without a sensor, the tendon is slackened by a fixed length, max_displacement_m.
    assert bench.call('/tendon_actuator/release').success
    wait_until(lambda: heard[-1].state == TendonSlack.SLACK)
    assert client.state.displacement_m == pytest.approx(-0.02, abs=0.0006)
    servo.unplug()
    wait_until(lambda: heard[-1].state == TendonSlack.UNKNOWN)
    assert bench.node._client.trouble.reason in heard[-1].reason
