# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node's sign of life, for others whose motion must end with it."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Empty

PERIOD_S = 0.04


class HeartbeatPublisher:
    """Publishes ``~/heartbeat`` while the node is well.

    Parameters
    ----------
    node : rclpy.node.Node
    is_well : callable
        Asked before each beat, on the executor's thread.
    """

    def __init__(self, node: Node, is_well: Callable[[], bool]) -> None:
        self._node, self._is_well = node, is_well
        self._publisher = node.create_publisher(Empty, '~/heartbeat', qos_profile_sensor_data)
        # By the clock of the computer, however fast the time of a recording passes.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD_S, self._beat, clock=clock)

    def close(self) -> None:
        """Take timer and publisher away."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def _beat(self) -> None:
        if self._is_well():
            self._publisher.publish(Empty())
