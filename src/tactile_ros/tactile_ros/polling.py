# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions that are polled, because waking an executor for each message is expensive."""

from __future__ import annotations

from collections.abc import Callable
import functools
import threading
from typing import Any

from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from tactile_ros.lifecycle import TactileNode
from tactile_ros.periodic import Periodic, Ticker
from tactile_ros.rclpy_internals import NotOnExecutor, take_message

Take = Callable[[Any, Any], object]


class PolledSubscription:
    """A subscription whose messages are handled when `poll` is called, without an executor.

    Parameters
    ----------
    node : Node
        The node.
    message_type
        Class of the messages.
    topic : str
        Name of the topic.
    take : callable
        Called as ``take(message, info)`` for each message in order of arrival. ``info`` is
        rclpy's dictionary with ``received_timestamp``, ``source_timestamp`` and sequence numbers.
    profile : QoSProfile
        QoS; its depth limits the number of waiting messages.
    raw : bool
        Pass messages as bytes.
    overridable : bool
        Allow QoS overrides by the parameters ``qos_overrides…``.
    together : bool
        Call ``take`` once per `poll`, with a list of all waiting messages and the ``info`` of the
        newest message.
    """

    def __init__(
        self,
        node: Node,
        message_type: Any,
        topic: str,
        take: Take,
        profile: QoSProfile,
        *,
        raw: bool = False,
        overridable: bool = False,
        together: bool = False,
    ) -> None:
        self._node = node
        self._type = message_type
        self._together = together
        self._take = take
        self._depth = int(profile.depth)
        overriding = QoSOverridingOptions.with_default_policies() if overridable else None
        self._subscription = Node.create_subscription(
            node,
            message_type,
            topic,
            lambda _: None,
            profile,
            callback_group=NotOnExecutor(),
            raw=raw,
            qos_overriding_options=overriding,
        )
        self.topic_name: str = self._subscription.topic_name
        self.qos_profile: QoSProfile = self._subscription.qos_profile

    def get_publisher_count(self) -> int:
        """Return the number of publishers with a compatible QoS."""
        return int(self._subscription.get_publisher_count())

    def waiting(self) -> list[tuple[Any, Any]]:
        """Return the waiting messages, each with its ``info``.

        The number of messages is limited to the depth of the queue. A message that cannot be
        deserialised is logged and ends the list; the next call returns the messages after it.
        """
        taken: list[tuple[Any, Any]] = []
        if self._subscription is None:
            return taken
        try:
            while len(taken) < self._depth:
                one = take_message(self._subscription)
                if one is None:
                    break
                taken.append(one)
        except Exception as error:  # of the middleware; other topics must still be polled
            if not self._node.context.ok():
                return taken
            self._node.get_logger().error(
                f'a message on {self.topic_name} cannot be deserialised: {error}',
                throttle_duration_sec=10.0,
            )
        return taken

    def poll(self) -> None:
        """Call ``take`` with the waiting messages."""
        waiting = self.waiting()
        if self._together and waiting:
            waiting = [([message for message, _ in waiting], waiting[-1][1])]
        for message, info in waiting:
            if self._subscription is None:  # ``take`` has closed the subscription
                return
            self._take(message, info)

    def close(self) -> None:
        """Unsubscribe; idempotent."""
        subscription, self._subscription = self._subscription, None
        self._take = _ignore  # break a reference cycle
        if subscription is not None:
            self._node.destroy_subscription(subscription)


def _ignore(message: Any, info: Any) -> None: ...


class MisfitWarnings:
    """Logs one warning per publisher whose QoS is incompatible with a subscription of a node.

    rclpy's own warning names neither the publisher nor a remedy.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._profiles: dict[int, tuple[str, QoSProfile]] = {}
        self._warned: set[tuple[str, str]] = set()

    def add(self, subscription: Any) -> None:
        """Check the publishers of a subscription's topic from now on."""
        self._profiles[id(subscription)] = (subscription.topic_name, subscription.qos_profile)

    def discard(self, subscription: Any) -> None:
        """Stop the checks for a subscription; idempotent."""
        self._profiles.pop(id(subscription), None)

    def warn(self) -> None:
        """Log each publisher with an incompatible QoS that was not logged before."""
        for topic, profile in tuple(self._profiles.values()):  # threads modify the dict
            for info in self._node.get_publishers_info_by_topic(topic):
                level, reason = qos_check_compatible(info.qos_profile, profile)
                reason = reason.removeprefix('ERROR: ').rstrip(';')
                publisher = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                if level == QoSCompatibility.ERROR and (topic, publisher) not in self._warned:
                    self._warned.add((topic, publisher))
                    self._node.get_logger().warning(
                        f'no messages are received from {publisher} on {topic}, because its '
                        f'QoS is incompatible: {reason}; {format_remedy(profile)}'
                    )


def format_remedy(profile: QoSProfile) -> str:
    """Return an instruction that states the QoS which a publisher must have for a subscription."""
    policies = {'reliability': profile.reliability, 'durability': profile.durability}
    stated = {name: policy.name.lower() for name, policy in policies.items()}
    options = ' '.join(f'--qos-{name} {value}' for name, value in stated.items())
    return (
        f'publish with {" and ".join(" ".join(pair) for pair in stated.items())}, as '
        f'`ros2 topic pub {options}` does'
    )


POLL_S = 0.005
"""Default period of polling [s]. Samples that other processes publish are delayed by up to this
time."""

MISFITS_S = 2.0
"""Time between two checks for publishers with an incompatible QoS [s]."""


class PollingNode(TactileNode):
    """A `TactileNode` with polled subscriptions.

    The callbacks of all subscriptions run one after another, each with ``lock`` acquired. If a
    callback raises another exception than `MessageError`, the node's executor ends, and thus the
    process.

    Attributes
    ----------
    lock : RLock
        Acquired while a callback of a subscription runs.
    poll_s : float or None
        Period of polling [s], which `poll_every` changes. If it is None, messages are handled only
        when `poll_now` is called.
    """

    is_quiet = True
    poll_s: float | None = POLL_S

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.lock = threading.RLock()
        self._poller = Ticker(f'topics of {name}')
        self._polled: tuple[PolledSubscription, ...] = ()
        self._asking: Periodic | None = None  # periodic call of `poll_now`
        self._misfits = MisfitWarnings(self)
        self._warning: Periodic | None = None
        super().__init__(name, config_class, **node_options)

    def poll(
        self,
        message_type: Any,
        topic: str,
        take: Take,
        profile: QoSProfile,
        **options: bool,
    ) -> PolledSubscription:
        """Create a polled subscription, for a topic with a high rate.

        ``take(message, info)`` is called on the thread of periodic polling, or on the thread that
        calls `poll_now`. See `PolledSubscription` for the options.
        """
        guarded = self.message_guard.wrap(topic, take)
        subscription = PolledSubscription(self, message_type, topic, guarded, profile, **options)
        with self.lock:
            self._polled = (*self._polled, subscription)
            self._watch_publishers(subscription)
            if self._asking is None and self.poll_s is not None:
                self._asking = self._call_on(self._poller, self.poll_s, self.poll_now)
        return subscription

    def poll_every(self, period_s: float) -> None:
        """Change the period of polling [s]; may be called on any thread."""
        self.poll_s = period_s
        if self._asking is not None:
            self._asking.change_period(period_s)

    def poll_now(self) -> None:
        """Handle the waiting messages of all polled topics on this thread."""
        for subscription in self._polled:
            with self.lock:
                subscription.poll()

    def unpoll(self, subscription: PolledSubscription) -> None:
        """Close a subscription; idempotent."""
        with self.lock:
            self._polled = tuple(s for s in self._polled if s is not subscription)
            self._misfits.discard(subscription)
            subscription.close()
            if not self._polled and self._asking is not None:
                self._asking.cancel()
                self._asking = None

    def unpoll_all(self) -> None:
        """Close all subscriptions."""
        for subscription in self._polled:
            self.unpoll(subscription)

    def create_subscription(
        self, message_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **opts: Any
    ) -> Any:
        """Create an ordinary subscription, whose callback runs on the executor.

        Because each message wakes the executor, use it only for topics with a low rate.
        """

        @functools.wraps(callback)  # rclpy inspects the signature
        def locked(*arguments: Any) -> None:
            with self.lock:
                callback(*arguments)

        subscription = super().create_subscription(message_type, topic, locked, *args, **opts)
        self._watch_publishers(subscription)
        return subscription

    def destroy_subscription(self, subscription: Any) -> bool:
        self._misfits.discard(subscription)
        return bool(super().destroy_subscription(subscription))

    def destroy_node(self) -> None:
        self.unpoll_all()
        super().destroy_node()

    def _watch_publishers(self, subscription: Any) -> None:
        self._misfits.add(subscription)
        if self._warning is None:
            # The calls do not acquire the lock, because a query of the ROS graph can be slow.
            self._warning = self.call_every(MISFITS_S, self._misfits.warn)
