# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tells whether the topics that motion depends on are still heard.

Only arrival on the monotonic clock counts: ROS time may be simulated, paused or stepped.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import Any


class TopicWatchdog:
    """Liveliness of one topic on the monotonic clock; no IO, thread-safe.

    Parameters
    ----------
    topic : str
        Name of the topic, for sentences.
    timeout_s : float
        The topic counts as silent when nothing was heard for this long [s].
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._lock = threading.Lock()
        self._heard_at_ns: int | None = None

    @property
    def was_heard(self) -> bool:
        """Whether anything was ever heard."""
        return self._heard_at_ns is not None

    def beat(self, now_ns: int) -> None:
        """Note a message at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            self._heard_at_ns = now_ns

    def describe_silence(self, now_ns: int) -> str:
        """Return a sentence with the remedy while the topic is silent, else nothing [ns]."""
        with self._lock:
            if self._heard_at_ns is None:
                return f'Nothing has been heard on {self._topic} yet; start its node.'
            if now_ns - self._heard_at_ns <= self._timeout_ns:
                return ''
            return (
                f'Nothing was heard on {self._topic} for {self._timeout_ns / 1e9:g} s; '
                'look after its node.'
            )


def find_silence(watchdogs: tuple[TopicWatchdog, ...], now_ns: int) -> str:
    """Return the sentence of the first silent topic; empty when all are heard [ns]."""
    for watchdog in watchdogs:
        if silence := watchdog.describe_silence(now_ns):
            return silence
    return ''


class WatchedTopics:
    """Subscriptions of a node that feed a `TopicWatchdog` each.

    The node is passed in, so this module itself knows no ROS.
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
        timeout_s : float
            Longest silence [s].
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
