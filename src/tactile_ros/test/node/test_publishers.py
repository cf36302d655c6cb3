# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import make_dataclass

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


def test_the_quality_of_a_stream_can_be_overridden_and_that_of_others_stays(context):
    name = 'qos_overrides./beating/one.publisher.reliability'
    node = TactileNode(
        'beating',
        make_dataclass('Nothing', []),
        context=context,
        parameter_overrides=[Parameter(name, value='best_effort')],
    )
    for _ in range(2):  # a node that is configured again creates its publishers again
        made = [node.create_stream_publisher(String, topic) for topic in ('~/one', '~/two')]
        reliability = [
            node.get_publishers_info_by_topic(publisher.topic_name)[0].qos_profile.reliability
            for publisher in made
        ]
        assert reliability == [ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE]
        for publisher in made:
            node.destroy_lifecycle_publisher(publisher)
    assert STREAM.reliability == ReliabilityPolicy.RELIABLE
    node.destroy_node()


def test_each_subscriber_gets_what_it_expects(context, spun):
    ours, other, heard = Node('ours', context=context), Node('other', context=context), {}

    def listen(topic, asked):
        heard[topic, id(asked)] = values = []
        other.create_subscription(String, topic, lambda m: values.append(m.data), asked)

    publishers = [ours.create_publisher(String, t, q) for t, q in (('r', RESULTS), ('e', EVENTS))]
    for publisher in publishers:
        publisher.publish(String(data='old'))
    for asked in (BEST_EFFORT, RELIABLE):
        for topic in ('r', 'e'):
            listen(topic, asked)
    listen('e', LATCHED)
    spun(other)
    wait_until(lambda: [p.get_subscription_count() for p in publishers] == [2, 3])
    wait_until(lambda: heard['e', id(LATCHED)])  # before the next message replaces the latched one

    def have_all_heard():
        for publisher in publishers:
            publisher.publish(String(data='new'))
        return all('new' in values for values in heard.values())

    wait_until(have_all_heard)
    latched = heard.pop(('e', id(LATCHED)))
    assert latched[0] == 'old'
    assert {'new'} == set(latched[1:]).union(*heard.values())
    ours.destroy_node()
