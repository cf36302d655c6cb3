# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes with simulated time: their stamps are taken from /clock."""

import threading

from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from tactile_bringup.launch_config.graph import sensing_graph
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_msgs.msg import StrainBlock
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import CLOCK, STREAM
from tactile_sim.rig_process import SimulatedRig

YEAR_2001_NS = 1_000_000_000 * 10**9
DEADLINE_S = 60.0


def test_samples_have_stamps_of_the_clock_topic(context, tmp_path):
    source = Node('source', context=context)
    publisher = source.create_publisher(Clock, '/clock', CLOCK)
    told = [YEAR_2001_NS]
    stamped = threading.Event()
    stamps = []

    def tell():
        told.append(told[-1] + 10_000_000)
        publisher.publish(Clock(clock=Time(nanoseconds=told[-1]).to_msg()))

    def on_strain(message):
        stamp_ns = Time.from_msg(message.header.stamp).nanoseconds
        if stamp_ns > 10**9:  # before the first message on /clock, the time is zero
            stamps.append(stamp_ns)
        if len(stamps) >= 30:
            stamped.set()

    source.create_timer(0.01, tell)
    source.create_subscription(StrainBlock, 'tendon_sensor/strain', on_strain, STREAM)
    with NodeGroup([source], context=context), SimulatedRig(links=tmp_path / 'rig') as rig:
        timed = {'tendon_sensor': {'use_sim_time': True}}
        graph = sensing_graph(rig.ports.sensor, None, timed, simulated=True)
        with running_graph(graph, context):
            assert stamped.wait(DEADLINE_S), 'no samples with stamps'
    assert all(YEAR_2001_NS - 10**9 < stamp_ns < told[-1] + 10**9 for stamp_ns in stamps)
    assert stamps == sorted(stamps)
