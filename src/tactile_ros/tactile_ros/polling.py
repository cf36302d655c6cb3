# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions that are asked for their messages: each wake-up of an executor costs more."""

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
    """The messages of one topic that have come since it was asked last.

    `poll` calls ``take(message, info)`` for each, in order; ``info`` is rclpy's dictionary of
    ``received_timestamp``, ``source_timestamp`` and sequence numbers. The depth of the profile
    bounds the messages that wait. ``raw``: as bytes. ``overridable``: by parameters
    ``qos_overrides…``. ``together``: ``take`` gets a list of all messages that wait, and the
    information of the newest.
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
        self._warned: set[str] = set()
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
        """Return the number of publishers whose quality of service fits."""
        return int(self._subscription.get_publisher_count())

    def waiting(self) -> list[tuple[Any, Any]]:
        """Return message and information of each that waits, at most as many as a queue holds.

        A message that is not of its type ends the list and is logged; the next call goes on.
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
        except Exception as error:  # of the middleware; other topics must go on
            if not self._node.context.ok():
                return taken
            self._node.get_logger().error(
                f'a message on {self.topic_name} is unusable: {error}', throttle_duration_sec=10.0
            )
        return taken

    def poll(self) -> None:
        """Hand on what waits."""
        waiting = self.waiting()
        if self._together and waiting:
            waiting = [([message for message, _ in waiting], waiting[-1][1])]
        for message, info in waiting:
            if self._subscription is None:  # the callback before has closed it
                return
            self._take(message, info)

    def warn_of_misfits(self) -> None:
        """Log each publisher whose quality of service does not fit, once."""
        if self._subscription is None:
            return
        for info in self._node.get_publishers_info_by_topic(self.topic_name):
            level, reason = qos_check_compatible(info.qos_profile, self.qos_profile)
            publisher = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            if level == QoSCompatibility.ERROR and publisher not in self._warned:
                self._warned.add(publisher)
                self._node.get_logger().warning(
                    f'nothing comes from {publisher} on {self.topic_name}: its quality of service '
                    f'does not fit: {reason}'
                )

    def close(self) -> None:
        """Unsubscribe. Harmless when called twice."""
        subscription, self._subscription = self._subscription, None
        self._take = _ignore  # a circle would keep what it holds until Python collects it
        if subscription is not None:
            self._node.destroy_subscription(subscription)


def _ignore(message: Any, info: Any) -> None: ...


POLL_S = 0.005
"""Default period of asking; samples of another process arrive so much later at most."""

MISFITS_S = 2.0
"""Period of looking for publishers whose quality of service does not fit."""


class PollingNode(TactileNode):
    """A `TactileNode` with polled subscriptions, whose callbacks hold its lock.

    An exception of a callback, but for `MessageError`, ends the node's executor and so its
    process. Every callback of a subscription holds ``lock``. ``poll_s`` is the period of asking
    [s]; None: only `poll_now` asks. See `poll_every`.
    """

    is_quiet = True
    poll_s: float | None = POLL_S

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.lock = threading.RLock()
        self._poller = Ticker(f'topics of {name}')
        self._polled: tuple[PolledSubscription, ...] = ()
        self._polling: list[Periodic] = []
        self._asking: Periodic | None = None  # the one of them that polls
        super().__init__(name, config_class, **node_options)

    def poll(
        self,
        message_type: Any,
        topic: str,
        take: Take,
        profile: QoSProfile,
        **options: bool,
    ) -> PolledSubscription:
        """Subscribe to what comes often; ``take(message, info)`` runs on the polling thread.

        And on that of `poll_now`. The options are those of `PolledSubscription`.
        """
        guarded = self.message_guard.wrap(topic, take)
        subscription = PolledSubscription(self, message_type, topic, guarded, profile, **options)
        with self.lock:
            self._polled = (*self._polled, subscription)
            if not self._polling:
                self._polling = [self.call_every(MISFITS_S, self._warn_of_misfits)]
                if self.poll_s is not None:
                    self._asking = self._call_on(self._poller, self.poll_s, self.poll_now)
                    self._polling.append(self._asking)
        return subscription

    def poll_every(self, period_s: float) -> None:
        """Ask with another period from now on [s]; on another thread, after the next time."""
        self.poll_s = period_s
        if self._asking is not None:
            self._asking.change_period(period_s)

    def poll_now(self) -> None:
        """Hand on what has come on all polled topics, on this thread."""
        for subscription in self._polled:
            with self.lock:
                subscription.poll()

    def unpoll(self, subscription: PolledSubscription) -> None:
        """Close a subscription. Harmless when called twice."""
        with self.lock:
            self._polled = tuple(s for s in self._polled if s is not subscription)
            subscription.close()
            if not self._polled:
                while self._polling:
                    self._polling.pop().cancel()

    def unpoll_all(self) -> None:
        """Close all subscriptions."""
        for subscription in self._polled:
            self.unpoll(subscription)

    def create_subscription(
        self, message_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **opts: Any
    ) -> Any:
        """Subscribe to what comes seldom; the callback runs on the executor."""

        @functools.wraps(callback)  # rclpy looks at the signature
        def locked(*arguments: Any) -> None:
            with self.lock:
                callback(*arguments)

        return super().create_subscription(message_type, topic, locked, *args, **opts)

    def destroy_node(self) -> None:
        self.unpoll_all()
        super().destroy_node()

    def _warn_of_misfits(self) -> None:
        for subscription in self._polled:
            with self.lock:
                subscription.warn_of_misfits()
