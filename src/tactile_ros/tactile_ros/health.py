# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Diagnostics, readiness and heartbeats of nodes. Heartbeats use the liveliness QoS of DDS."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import itertools
import threading
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.event_handler import (
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import Empty

from tactile_msgs.msg import Readiness
from tactile_ros.errors import TactileError
from tactile_ros.lifecycle import TactileNode
from tactile_ros.periodic import SLOW_CALLS
from tactile_ros.qos import LATEST
from tactile_ros.rclpy_internals import NotOnExecutor, SubscriptionStatus
from tactile_ros.refusal import Refusal

PERIOD_S = 1.0

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR


class Health(NamedTuple):
    """Contents of one ``diagnostic_msgs/DiagnosticStatus``."""

    level: bytes
    message: str
    values: Mapping[str, object]  # key-value pairs


class Diagnostics:
    """Publishes the health of a node on ``/diagnostics`` once a second.

    The values of the node's `MessageGuard` are added. For some time after a refused message, the
    level is at least a warning.

    Parameters
    ----------
    node : Node
        The node.
    hardware_id : callable
        Returns an identifier of the hardware.
    provider : callable
        Returns the present `Health`. It is called by `publish`, on the thread of periodic calls
        or on the caller's thread. It must not acquire the lock of a `StageNode`: a thread that
        holds this lock may wait in `close`.
    """

    def __init__(
        self, node: Node, hardware_id: Callable[[], str], provider: Callable[[], Health]
    ) -> None:
        self._node = node
        self._hardware_id = hardware_id
        self._provider = provider
        self._lock = threading.Lock()
        self._is_closed = False
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        call_every = node.call_every if isinstance(node, TactileNode) else SLOW_CALLS.every
        self._calls = call_every(PERIOD_S, self.publish)

    def publish(self) -> None:
        """Publish the present health immediately."""
        with self._lock:
            if self._is_closed or not self._node.context.ok():
                return
            health = self._provider()  # also without subscribers, because it may count events
            if self._publisher.get_subscription_count():
                self._publisher.publish(self._to_message(health))

    def _to_message(self, health: Health) -> DiagnosticArray:
        level, sentence, values = health
        if (guard := getattr(self._node, 'message_guard', None)) is not None:
            values = {**values, **guard.values}
            if warning := guard.warning:
                level, sentence = max(level, WARN), f'{sentence}; {warning}'
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                level=level,
                name=self._node.get_fully_qualified_name().lstrip('/'),
                message=sentence,
                hardware_id=self._hardware_id(),
                values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
            )
        ]
        return message

    def close(self) -> None:
        """Stop publishing; idempotent."""
        self._calls.cancel()
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                del self._provider, self._hardware_id  # break reference cycles
                self._node.destroy_publisher(self._publisher)


READY_PERIOD_S = 0.2


class ReadinessPublisher:
    """Publishes ``~/ready`` at the start and at each change.

    Parameters
    ----------
    node : TactileNode
        The node.
    find_missing : callable
        Returns a sentence for each condition that the node still waits for. It is called five
        times a second on the thread of periodic calls, and by `update`, until `close` returns.

    Attributes
    ----------
    missing : list of str or None
        The sentences that were published last; None before the first message.
    """

    def __init__(self, node: TactileNode, find_missing: Callable[[], Sequence[str]]) -> None:
        self._node, self._find_missing = node, find_missing
        self._lock = threading.Lock()  # keeps the order of published states
        self._is_closed = False
        self.missing: list[str] | None = None
        self._publisher = node.create_publisher(Readiness, '~/ready', LATEST)
        self._calls = node.call_every(READY_PERIOD_S, self.update)

    def update(self) -> None:
        """Publish the readiness if the sentences of ``find_missing`` have changed."""
        with self._lock:
            if self._is_closed:
                return
            missing = list(self._find_missing())
            if missing == self.missing:
                return
            self.missing = missing
            message = Readiness(ready=not missing, missing=missing)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(message)

    def close(self) -> None:
        """Stop publishing; idempotent."""
        self._calls.cancel()
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                self._node.destroy_publisher(self._publisher)


LEASE_S = 0.15
"""Liveliness lease duration that a heartbeat publisher offers [s]. A subscription can request
this duration or a longer one."""

BEAT_PERIOD_S = 0.03
"""Shortest time between two heartbeats [s]. In motion, workers run every 17 or 20 ms and publish
about four heartbeats within `LEASE_S`; at rest, they run every 50 ms and publish three."""


_watch_numbers = itertools.count(1)
"""Nanoseconds that each `HeartbeatWatch` adds to its lease duration, so that all durations differ.
In Fast DDS, readers with the same participant, topic and lease share one state, of which only
changes are reported. A second such reader would never learn that the writer is alive."""


def heartbeat_qos(lease_s: float = LEASE_S, extra_ns: int = 0) -> QoSProfile:
    """Return the QoS of a heartbeat topic.

    The liveliness lease duration is ``lease_s`` [s] plus ``extra_ns`` [ns].
    """
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=lease_s, nanoseconds=extra_ns),
    )


class Heartbeat:
    """Publishes a heartbeat: empty messages that show that the worker of a node is running.

    Parameters
    ----------
    node : Node
        The node.
    is_healthy : callable
        Called before each beat; if it returns False, the beat is skipped.
    topic : str
        Name of the topic.
    lease_s : float
        Liveliness lease duration that the publisher offers [s].
    """

    def __init__(
        self,
        node: Node,
        is_healthy: Callable[[], bool],
        topic: str = '~/heartbeat',
        lease_s: float = LEASE_S,
    ) -> None:
        self._node, self._is_healthy = node, is_healthy
        self._publisher = node.create_publisher(Empty, topic, heartbeat_qos(lease_s))
        self._lock = threading.Lock()
        self._due_s = 0.0
        self._is_closed = False

    def beat(self) -> None:
        """Publish a message if the node is healthy and the last message is `BEAT_PERIOD_S` old.

        Must be called in each cycle of the thread that does the work. A separate thread would
        continue to publish when the work hangs.
        """
        now_s = time.monotonic()
        if now_s < self._due_s or not self._is_healthy():
            return
        with self._lock:
            if not self._is_closed and self._node.context.ok():
                self._due_s = now_s + BEAT_PERIOD_S
                self._publisher.publish(Empty())

    def close(self) -> None:
        """Destroy the publisher."""
        with self._lock:
            self._is_closed = True
            self._node.destroy_publisher(self._publisher)


class HeartbeatWatch:
    """Checks that exactly one publisher of a heartbeat topic is alive; thread-safe.

    Two live publishers mean that two rigs share one ROS domain, so that they would answer each
    other's goals. A killed publisher is listed in the ROS graph for many seconds, but it is no
    longer counted as alive after ``timeout_s``.

    Parameters
    ----------
    node : Node
        The node.
    topic : str
        Name of the heartbeat topic.
    timeout_s : float
        Time without a heartbeat after which a publisher is no longer alive [s]. It must not be
        shorter than the lease duration that the publisher offers.
    rivals_only : bool
        `find_loss` reports only a second publisher, and not the absence of publishers.

    Raises
    ------
    TactileError
        If the middleware does not support liveliness.
    """

    def __init__(
        self, node: Node, topic: str, timeout_s: float = LEASE_S, *, rivals_only: bool = False
    ) -> None:
        self._node, self._timeout_s, self._rivals_only = node, timeout_s, rivals_only
        self._subscription = node.create_subscription(
            Empty,
            topic,
            _ignore,
            heartbeat_qos(timeout_s, next(_watch_numbers)),
            callback_group=NotOnExecutor(),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._topic = topic.replace('~', node.get_name())
        kinds = QoSSubscriptionEventType
        try:
            self._liveliness = SubscriptionStatus(
                self._subscription, kinds.RCL_SUBSCRIPTION_LIVELINESS_CHANGED
            )
            self._misfits = SubscriptionStatus(
                self._subscription, kinds.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS
            )
        except UnsupportedEventTypeError:
            node.destroy_subscription(self._subscription)
            raise TactileError(
                f'{get_rmw_implementation_identifier()} does not report the liveliness of '
                'publishers; set RMW_IMPLEMENTATION=rmw_fastrtps_cpp'
            ) from None
        self._lock = threading.Lock()
        self._alive = 0
        self._was_heard = self._is_closed = False

    @property
    def was_heard(self) -> bool:
        """True once a publisher was alive; always True with ``rivals_only``."""
        return self._count_alive() > 0 or self._was_heard or self._rivals_only

    def find_loss(self, now_ns: int = 0) -> Refusal | None:
        """Return why motion is not allowed; None while exactly one publisher is alive.

        With ``rivals_only``, the result is also None while no publisher is alive. ``now_ns`` is
        unused, because the middleware measures time with its own monotonic clock.
        """
        alive = self._count_alive()
        if alive > 1:
            return self._describe_rivals(alive)
        if alive or self._rivals_only:
            return None
        if self._was_heard:
            return Refusal(
                f'No message has arrived on {self._topic} for {self._timeout_s:g} s',
                'check that its node is running and active',
            )
        if self._has_misfit:
            return Refusal(
                f'The publisher of {self._topic} has an incompatible QoS',
                f'it must offer the liveliness MANUAL_BY_TOPIC with a lease of '
                f'{self._timeout_s:g} s or less',
            )
        return Refusal(f'No message has arrived on {self._topic} yet', 'start its node')

    def close(self) -> None:
        """Destroy the subscription."""
        with self._lock:
            self._is_closed = True
            self._liveliness.destroy()
            self._misfits.destroy()
            self._node.destroy_subscription(self._subscription)

    def _count_alive(self) -> int:
        with self._lock:
            status = None if self._is_closed else self._liveliness.take()
            if status is not None:
                self._alive = status.alive_count
                self._was_heard = self._was_heard or self._alive > 0
            return self._alive

    @property
    def _has_misfit(self) -> bool:
        with self._lock:
            status = None if self._is_closed else self._misfits.take()
            return status is not None and status.total_count > 0

    def _describe_rivals(self, alive: int) -> Refusal:
        """Return a refusal that names all publishers in the ROS graph, also killed ones."""
        known = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        names = [f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in known]
        return Refusal(
            f'{alive} nodes are alive on {self._topic} ({", ".join(sorted(names))}): '
            'two rigs share this ROS domain',
            'stop one, or start it with another ROS_DOMAIN_ID or namespace',
        )


PRESENCE_LEASE_S, PRESENCE_PERIOD_S = 1.0, 0.3
"""Liveliness lease duration [s] and period [s] of the heartbeat of a `Presence`."""


class Presence:
    """Publishes a heartbeat on ``~/presence``, and detects a second node with the same name.

    A node with action servers needs this heartbeat, because ``~/heartbeat`` stops while its device
    is not usable, but the node still receives goals. If two nodes had the same name, a client
    could receive the answer of the wrong node.

    Attributes
    ----------
    rivals : HeartbeatWatch
        Its `find_loss` returns a refusal while two nodes with this name are running.
    """

    def __init__(self, node: TactileNode) -> None:
        topic = '~/presence'
        self.rivals = HeartbeatWatch(node, topic, PRESENCE_LEASE_S, rivals_only=True)
        self._beats = Heartbeat(node, lambda: True, topic, PRESENCE_LEASE_S)
        self._calls = node.call_every(PRESENCE_PERIOD_S, self._beats.beat)

    def close(self) -> None:
        """Destroy the publisher and the subscription."""
        self._calls.cancel()
        self._beats.close()
        self.rivals.close()


def watch_rivals(node: Node, name: str) -> HeartbeatWatch:
    """Return a watch whose `find_loss` reports two running nodes with the name ``name``."""
    return HeartbeatWatch(node, f'{name}/presence', PRESENCE_LEASE_S, rivals_only=True)


def _ignore(_: Empty) -> None: ...
