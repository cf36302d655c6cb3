# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node over DDS: what it publishes is what the core finds."""

from functools import partial

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from tactile_features.conversions import strain_block_from_msg
from tactile_features.slip import SlipConfig, SlipDetector
from tactile_features.slip_detector_node import SlipDetectorNode
from tactile_msgs.msg import Slip, StrainBlock, TrialEvent
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_testing.waiting import wait_until

PERIOD_NS = 16_666_667
START_NS = 1_760_000_000_123_456_789
TENSION_N = 10.0 + np.random.default_rng(0).normal(0.0, 0.004, 600)
TENSION_N[500:] -= 0.05


def header(stamp_ns):
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))


def block(first, count):
    return StrainBlock(
        header=header(START_NS + first * PERIOD_NS),
        sequence=first,
        period_ns=PERIOD_NS,
        tension_n=TENSION_N[first : first + count].tolist(),
        status=StrainBlock.STATUS_SIMULATED,
    )


@pytest.mark.parametrize('teller', ['trial_runner/events', 'tactile_features/detected_events'])
def test_publishes_the_slips_of_the_core_with_the_trial_under_way(context, teller):
    peer = Node('peer', context=context, namespace='finger')
    overrides = [Parameter('frame_id', value='left_cell_link')]
    node = SlipDetectorNode(context=context, namespace='finger', parameter_overrides=overrides)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(peer)
    executor.add_node(node)
    slips = []
    heard = peer.create_subscription(Slip, 'slip_detector/slip', slips.append, RESULTS)
    strain = peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    events = peer.create_publisher(TrialEvent, teller, EVENTS)

    def spin_until(condition):
        wait_until(condition, step=partial(executor.spin_once, timeout_sec=0.05))

    assert node.bring_up()
    spin_until(
        lambda: (
            strain.get_subscription_count() == events.get_subscription_count() == 1
            and peer.count_publishers(heard.topic_name) == 1
            and node.count_subscribers(heard.topic_name) == 1
        )
    )
    events.publish(TrialEvent(header=header(START_NS), trial_id='t7', phase='hold'))
    spin_until(lambda: node.stage.trial_id == 't7')
    for first in range(0, 600, 20):
        strain.publish(block(first, 20))
    spin_until(lambda: slips)
    (found,) = SlipDetector(SlipConfig()).add(strain_block_from_msg(block(0, 600)))
    (slip,) = slips
    assert slip.header.stamp.sec * 10**9 + slip.header.stamp.nanosec == found.stamp_ns
    assert slip.onset.sec * 10**9 + slip.onset.nanosec == found.onset_ns
    assert (slip.statistic, slip.tension_n) == (found.statistic, found.tension_n)
    assert (slip.motion, slip.trial_id) == (Slip.MOTION_SLIDING, 't7')
    assert (slip.simulated, slip.header.frame_id) == (True, 'left_cell_link')
    events.publish(TrialEvent(header=header(START_NS), trial_id='t7', phase='done'))
    spin_until(lambda: node.stage.trial_id == '')
    node.take_down()
    executor.shutdown()
    peer.destroy_node()
