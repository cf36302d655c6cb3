# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import dataclass

import pytest
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Empty

from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.qos import STREAM


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
