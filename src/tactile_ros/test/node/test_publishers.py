# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import dataclass
from functools import partial

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data, ReliabilityPolicy
from std_msgs.msg import Empty

from tactile_ros.health.heartbeat import HeartbeatPublisher
from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.qos import STREAM
from tactile_testing.waiting import wait_until


@dataclass(frozen=True)
class Nothing:
    pass


@pytest.fixture
def make_node(context):
    nodes = []

    def make(**overrides):
        parameters = [Parameter(k, value=v) for k, v in overrides.items()]
        nodes.append(
            TactileNode('beating', Nothing, context=context, parameter_overrides=parameters)
        )
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def test_the_quality_of_a_stream_can_be_overridden_and_that_of_others_stays(make_node):
    node = make_node(**{'qos_overrides./beating/one.publisher.reliability': 'best_effort'})
    for topic in ('~/one', '~/two'):
        node.create_stream_publisher(Empty, topic)
    reliability = {
        topic: node.get_publishers_info_by_topic(f'/beating/{topic}')[0].qos_profile.reliability
        for topic in ('one', 'two')
    }
    assert reliability['one'] == ReliabilityPolicy.BEST_EFFORT
    assert reliability['two'] == ReliabilityPolicy.RELIABLE
    assert STREAM.reliability == ReliabilityPolicy.RELIABLE


def test_a_heart_beats_while_its_node_is_well_and_until_it_is_closed(make_node, context):
    node = make_node()
    listener = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    for each in (node, listener):
        executor.add_node(each)
    beats = []
    listener.create_subscription(Empty, 'beating/heartbeat', beats.append, qos_profile_sensor_data)
    well, not_well = [True], []

    def is_well():
        if not well[0]:
            not_well.append(True)
        return well[0]

    heart = HeartbeatPublisher(node, is_well)
    spin = partial(executor.spin_once, timeout_sec=0.02)
    wait_until(lambda: len(beats) >= 3, step=spin)
    well[0] = False
    wait_until(lambda: len(not_well) >= 5, step=spin)  # what was under way arrives
    count = len(beats)
    wait_until(lambda: len(not_well) >= 15, step=spin)
    assert len(beats) == count
    heart.close()
    assert node.count_publishers('/beating/heartbeat') == 0
    executor.shutdown()
    listener.destroy_node()
