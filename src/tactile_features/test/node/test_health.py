# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Diagnostics of the node, and the quality of service of its outputs."""

from functools import partial

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy

from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import StrainBlock
from tactile_ros.qos import STREAM
from tactile_testing.waiting import wait_until


@pytest.fixture
def node(context):
    name = 'qos_overrides./tactile_features/features.publisher.reliability'
    node = TactileFeaturesNode(
        context=context, parameter_overrides=[Parameter(name, value='best_effort')]
    )
    assert node.bring_up()
    yield node
    node.take_down()


def test_the_quality_of_the_features_can_be_overridden(node):
    (info,) = node.get_publishers_info_by_topic('/tactile_features/features')
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_diagnostics_tell_whether_samples_come_in(node, context):
    peer = Node('peer', context=context)
    heard = []
    peer.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: heard.append(message.status[0]), 10
    )
    strain = peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    executor = SingleThreadedExecutor(context=context)
    for each in (node, peer):
        executor.add_node(each)

    def spin_until(condition):
        wait_until(condition, step=partial(executor.spin_once, timeout_sec=0.05))

    spin_until(lambda: heard and strain.get_subscription_count())
    assert heard[-1].level == DiagnosticStatus.WARN
    assert 'no samples' in heard[-1].message
    strain.publish(StrainBlock(period_ns=16_666_667, tension_n=[1.0]))
    spin_until(lambda: heard[-1].level == DiagnosticStatus.OK)
    assert {v.key: v.value for v in heard[-1].values}['blocks'] == '1'
    spin_until(lambda: heard[-1].level == DiagnosticStatus.WARN)
    executor.shutdown()
    peer.destroy_node()
