# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publisher of a node's readiness for goals, on its latched topic ``~/ready``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from tactile_msgs.msg import Readiness
from tactile_ros.qos import LATEST

PERIOD_S = 0.1


class ReadinessPublisher:
    """Publishes ``~/ready`` once at the start and then at each change.

    Parameters
    ----------
    node : rclpy.node.Node
    find_missing : callable
        Returns a sentence for each thing that is missing; asked ten times a second on the
        executor's thread.
    """

    def __init__(self, node: Node, find_missing: Callable[[], Sequence[str]]) -> None:
        self._node, self._find_missing = node, find_missing
        self._missing: list[str] | None = None
        self._publisher = node.create_publisher(Readiness, '~/ready', LATEST)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD_S, self.update, clock=clock)

    def update(self) -> None:
        """Publish if something has changed."""
        missing = list(self._find_missing())
        if missing == self._missing:
            return
        self._missing = missing
        message = Readiness(ready=not missing, missing=missing)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def close(self) -> None:
        """Take timer and publisher away."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)
