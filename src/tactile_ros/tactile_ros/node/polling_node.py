# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lifecycle node that asks for its messages, so that only requests wake its executor."""

from __future__ import annotations

from collections.abc import Callable
import functools
import threading
from typing import Any

from rclpy.qos import QoSProfile

from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.node.polled_subscription import PolledSubscription, Take
from tactile_ros.periodic import Periodic, Ticker

POLL_S = 0.005
"""Default period of asking; samples of another process arrive so much later at most."""

MISFITS_S = 2.0
"""Period of looking for publishers whose quality of service does not fit."""


class PollingNode(TactileNode):
    """A `TactileNode` with polled subscriptions, whose callbacks hold its lock.

    An exception of a callback, but for `MessageError`, ends the node's executor and so its
    process.

    Attributes
    ----------
    lock : threading.RLock
        Held by every callback of a subscription.
    poll_s : float or None
        Period of asking; None: only `poll_now` asks. See `poll_every`.
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
        *,
        raw: bool = False,
        overridable: bool = False,
        together: bool = False,
    ) -> PolledSubscription:
        """Subscribe to what comes often; ``take(message, info)`` runs on the polling thread.

        And on that of `poll_now`. The options are those of `PolledSubscription`.
        """
        guarded = self.message_guard.wrap(topic, take)
        options = {'raw': raw, 'overridable': overridable, 'together': together}
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
