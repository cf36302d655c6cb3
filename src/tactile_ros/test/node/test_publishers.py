# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import dataclass

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from tactile_ros.lifecycle import TactileNode
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_testing.waiting import wait_until

BEST_EFFORT = QoSProfile(depth=9, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=9)
LATCHED = QoSProfile(depth=9, durability=DurabilityPolicy.TRANSIENT_LOCAL)


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
        node.create_stream_publisher(String, topic)
    reliability = {
        topic: node.get_publishers_info_by_topic(f'/beating/{topic}')[0].qos_profile.reliability
        for topic in ('one', 'two')
    }
    assert reliability['one'] == ReliabilityPolicy.BEST_EFFORT
    assert reliability['two'] == ReliabilityPolicy.RELIABLE
    assert STREAM.reliability == ReliabilityPolicy.RELIABLE


@pytest.fixture
def two_nodes(context, make_node):
    """Return a node of ours, somebody's node, what ours warned of, and a turn of both."""
    ours, other = make_node(), Node('somebody', context=context)
    warned = []
    ours.get_logger = lambda: type('Log', (), {'warning': staticmethod(warned.append)})
    executor = SingleThreadedExecutor(context=context)
    for node in (ours, other):
        executor.add_node(node)
    yield ours, other, warned, lambda: executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    other.destroy_node()


@pytest.mark.parametrize(
    ('offered', 'asked', 'outcome'),
    [
        (RESULTS, BEST_EFFORT, 'new'),
        (RESULTS, RELIABLE, 'new'),
        (RESULTS, LATCHED, 'subscribe with durability volatile'),
        (EVENTS, BEST_EFFORT, 'new'),
        (EVENTS, RELIABLE, 'new'),
        (EVENTS, LATCHED, 'old new'),
        (BEST_EFFORT, RELIABLE, 'subscribe with reliability best effort'),
    ],
)
def test_each_subscriber_gets_what_it_expects_or_a_warning_with_the_cure(
    two_nodes, offered, asked, outcome
):
    ours, other, warned, turn = two_nodes
    publisher = ours.create_publisher(String, '~/results', offered)
    publisher.publish(String(data='old'))
    heard = []
    other.create_subscription(
        String, '/beating/results', lambda message: heard.append(message.data), asked
    )

    def is_over():
        turn()
        if not warned:
            publisher.publish(String(data='new'))
        return warned or 'new' in heard

    wait_until(is_over)
    assert outcome in warned[0] if warned else ' '.join(dict.fromkeys(heard)) == outcome
    assert all(line.startswith('a subscriber of /beating/results gets') for line in warned)


def test_a_publisher_that_is_not_heard_is_told_with_the_cure(two_nodes):
    ours, other, warned, turn = two_nodes
    ours.create_subscription(String, 'samples', print, RELIABLE)
    other.create_publisher(String, 'samples', BEST_EFFORT)

    def is_warned():
        turn()
        return warned

    wait_until(is_warned)
    assert 'a publisher of /samples is not heard' in warned[0]
    assert 'publish with reliability reliable' in warned[0]
