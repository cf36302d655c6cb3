# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of a node on ``/diagnostics``, once a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import threading
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from tactile_ros.node.lifecycle import TactileNode

PERIOD_S = 1.0

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR


class Health(NamedTuple):
    """One row of diagnostics: a level, a sentence, and values by name."""

    level: bytes
    message: str
    values: Mapping[str, object]


class Diagnostics:
    """Publishes what ``provider()`` returns, under the node's name, once a second.

    The rejections of the node's `MessageGuard` are added; the level is a warning for a while
    after a message was refused.

    Parameters
    ----------
    node : rclpy.node.Node
        A `TactileNode` asks on the thread of periodic calls, any other on its executor.
    hardware_id : callable
    provider : callable
        Returns a `Health`. It must not take the lock of a stage, which may wait for `close`.
    """

    def __init__(
        self, node: Node, hardware_id: Callable[[], str], provider: Callable[[], Health]
    ) -> None:
        self._node = node
        self._hardware_id = hardware_id
        self._provider = provider
        self._lock = threading.Lock()
        self._is_closed = False
        self._stop_timer: Callable[[], object]
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # Once a second of the computer's time: what is asked about may be why the other stands.
        if isinstance(node, TactileNode):
            self._stop_timer = node.call_every(PERIOD_S, self.publish).cancel
        else:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            timer = node.create_timer(PERIOD_S, self.publish, clock=clock)
            self._stop_timer = lambda: node.destroy_timer(timer)

    def publish(self) -> None:
        """Publish at once."""
        with self._lock:
            if self._is_closed:
                return
            health = self._provider()  # asked in any case: it may count what has come since
            if self._publisher.get_subscription_count():
                self._publisher.publish(self._to_message(health))

    def _to_message(self, health: Health) -> DiagnosticArray:
        health = self._with_refused_messages(health)
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                level=health.level,
                name=self._node.get_fully_qualified_name().lstrip('/'),
                message=health.message,
                hardware_id=self._hardware_id(),
                values=[KeyValue(key=k, value=str(v)) for k, v in health.values.items()],
            )
        ]
        return message

    def _with_refused_messages(self, health: Health) -> Health:
        guard = getattr(self._node, 'message_guard', None)
        if guard is None:
            return health
        level, message = health.level, health.message
        if guard.warning:
            level = max(level, WARN)
            message = f'{message}; {guard.warning}'
        return Health(level, message, {**health.values, **guard.values})

    def close(self) -> None:
        """Publish no more. Harmless when called twice."""
        self._stop_timer()
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                del self._provider, self._hardware_id  # they hold what asked for diagnostics
                self._node.destroy_publisher(self._publisher)
