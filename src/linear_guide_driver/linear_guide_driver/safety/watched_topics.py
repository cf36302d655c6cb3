# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics that a node must hear while it moves something.

The node is passed in, so this module itself knows no ROS. Only arrival on the monotonic
clock counts: ROS time may be simulated, paused or stepped.
"""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from linear_guide_driver.safety.topic_watchdog import find_silence, TopicWatchdog

WAIT_STEP_S = 0.02


class WatchedTopics:
    """Subscriptions that feed a `TopicWatchdog` each.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._subscriptions: list[Any] = []
        self.watchdogs: tuple[TopicWatchdog, ...] = ()

    def add(
        self,
        message_type: type,
        topic: str,
        timeout_s: float,
        qos: Any,
        is_sign: Callable[[Any], bool] = lambda _: True,
    ) -> None:
        """Watch a topic.

        Parameters
        ----------
        message_type : type
        topic : str
        timeout_s : float
            Longest silence [s].
        qos : rclpy.qos.QoSProfile
        is_sign : callable
            Whether a message counts.
        """
        watchdog = TopicWatchdog(topic, timeout_s)

        def hear(message: Any) -> None:
            if is_sign(message):
                watchdog.beat(time.monotonic_ns())

        self.watchdogs = (*self.watchdogs, watchdog)
        self._subscriptions.append(self._node.create_subscription(message_type, topic, hear, qos))

    def find_silence(self) -> str:
        """Return which topic is silent and what to do; empty when all are heard."""
        return find_silence(self.watchdogs, time.monotonic_ns())

    @property
    def awaits_first(self) -> bool:
        """Whether a topic has not been heard at all yet."""
        return not all(watchdog.was_heard for watchdog in self.watchdogs)

    def close(self) -> None:
        """Take the subscriptions away."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []


def wait_first(
    awaits: Callable[[], bool], timeout_s: float, wait: Callable[[float], bool]
) -> None:
    """Wait until every needed topic was heard once: after a start, peers need a moment.

    Parameters
    ----------
    awaits : callable
        Whether one has not been heard yet.
    timeout_s : float
        Longest wait [s].
    wait : callable
        Sleeps for so long [s]; returns True when the goal is to end early.
    """
    deadline_s = time.monotonic() + timeout_s
    while awaits() and time.monotonic() < deadline_s:
        if wait(WAIT_STEP_S):
            return
