# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whose samples the tendon's driver takes, through the real node over DDS."""

from rclpy.node import Node
from test_tendon_promises import is_slack, pull, pull_taut, start, TAUT_M
from topic_peers import Peers

from tactile_msgs.msg import StrainBlock
from tactile_testing.waiting import wait_until


class Other:
    """What `Peers` needs of a bench: another node that publishes."""

    def __init__(self, context):
        self.peer = Node('other_sensor', context=context)


def test_two_publishers_let_a_taut_tendon_out_and_are_named(bench, servo, peers, context):
    start(bench, servo, slack_after_s=0.2)
    pull_taut(bench, peers)
    other = Other(context)
    try:
        with Peers(other) as second:
            second.beats = False
            wait_until(lambda: is_slack(servo))
            peers.tension_n = 0.0
            wait_until(lambda: '(/other_sensor, /peer)' in ' '.join(bench.node._find_missing()))
            bench.aborts(pull(bench, TAUT_M), 'Two nodes publish tendon_sensor/strain')
    finally:
        other.peer.destroy_node()
    wait_until(lambda: not bench.node._find_missing(), timeout_s=20.0)
    pull_taut(bench, peers)


def test_a_sensor_driver_that_starts_again_is_believed_after_a_still_reading(bench, servo, peers):
    start(bench, servo, slack_after_s=0.2)
    pull_taut(bench, peers)
    peers.published = 0
    wait_until(lambda: is_slack(servo))
    peers.tension_n = -1.9  # the tare is gone
    wait_until(lambda: bench.node._client.safety.tension_n == -1.9)
    bench.aborts(pull(bench, TAUT_M), 'tare the sensor')
    peers.tension_n = 0.0
    wait_until(lambda: not bench.node._find_missing())
    pull_taut(bench, peers)


def test_a_saturated_sensor_that_is_stuck_lets_out_and_stop_does_not_hold(bench, servo, peers):
    start(bench, servo)  # a loss would hold for 30 s
    pull_taut(bench, peers)
    peers.status = StrainBlock.STATUS_SATURATED | StrainBlock.STATUS_STUCK
    wait_until(lambda: bench.node._client.safety.is_alarm)
    assert bench.call('/tendon_actuator/stop').success
    wait_until(lambda: is_slack(servo))
