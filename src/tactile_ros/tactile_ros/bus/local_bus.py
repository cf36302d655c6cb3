# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records from node to node within a process, without messages.

A `RecordPublisher` hands each record to the `RecordSubscription` objects of its process on the
same topic. It builds and publishes a message only when somebody else listens. See
docs/decisions/0008-local-bus.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
import copy
import sys
import threading
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from tactile_ros.bus.receiver import NotOnExecutor, receiver_of

LOOK_PERIOD_S = 1.0
"""How often a subscription looks for publishers outside the process."""


class LocalTopic:
    """The publishers and subscriptions of one topic within the process.

    Attributes
    ----------
    inboxes : tuple of Inbox
        Where records go. Replaced as a whole, so that publishers read it without a lock.
    """

    def __init__(self) -> None:
        self.inboxes: tuple[Inbox, ...] = ()
        self.publisher_profiles: tuple[QoSProfile, ...] = ()
        self.observers: tuple[Callable[[], None], ...] = ()


class LocalBus:
    """Keeps the `LocalTopic` of each key in use. One serves the whole process: `BUS`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._topics: dict[Hashable, LocalTopic] = {}

    def add(self, key: Hashable, field: str, entry: Any) -> LocalTopic:
        """Add an entry to a field of a topic; return the topic, which is made if need be."""
        with self._lock:
            topic = self._topics.setdefault(key, LocalTopic())
            setattr(topic, field, (*getattr(topic, field), entry))
            return topic

    def remove(self, key: Hashable, field: str, entry: Any) -> None:
        """Remove an entry, and a topic without entries. Harmless when it is not there."""
        with self._lock:
            topic = self._topics.get(key)
            if topic is None:
                return
            setattr(topic, field, tuple(e for e in getattr(topic, field) if e is not entry))
            if not any(vars(topic).values()):
                del self._topics[key]


BUS = LocalBus()


class Inbox:
    """The newest records for one subscription, at most as many as its queue in DDS would hold.

    Parameters
    ----------
    depth : int
        When it is full, the oldest record is dropped: a gap, as when a queue of DDS is full.
    notify : callable
        Called for each record that is there to be taken.
    """

    def __init__(self, depth: int, notify: Callable[[], None]) -> None:
        self._records: deque[Any] = deque(maxlen=depth)
        self._depth = depth
        self._notify = notify
        self._lock = threading.Lock()

    def put(self, record: Any) -> None:
        """Add a record; returns at once."""
        with self._lock:
            is_full = len(self._records) == self._depth
            self._records.append(record)
        if not is_full:
            self._notify()

    def __len__(self) -> int:
        return len(self._records)

    def take(self) -> Any:
        """Return the oldest record, and remove it."""
        with self._lock:
            return self._records.popleft()


class RecordPublisher:
    """Publishes records: in memory within the process, as messages to everybody else.

    Like a lifecycle publisher it does so only while its node is active.

    Parameters
    ----------
    node : rclpy.lifecycle.LifecycleNode
    message_type : type
    topic : str
    to_message : callable
        Returns the message of a record.
    profile : QoSProfile
        Can be overridden by parameters. Must be volatile.
    """

    def __init__(
        self,
        node: LifecycleNode,
        message_type: Any,
        topic: str,
        to_message: Callable[[Any], Any],
        profile: QoSProfile,
    ) -> None:
        assert profile.durability == DurabilityPolicy.VOLATILE
        profile = copy.copy(profile)  # rclpy writes the overrides into it
        self._node = node
        self._to_message = to_message
        self._publisher = node.create_lifecycle_publisher(
            message_type,
            topic,
            profile,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._key = (node.context, self._publisher.topic_name, message_type)
        self._profile = profile
        self._topic = BUS.add(self._key, 'publisher_profiles', profile)
        self._tell()

    def publish(self, record: Any) -> None:
        """Pass a record on, unless the node is inactive. Nobody may change it afterwards."""
        publisher = self._publisher
        if not publisher.is_activated:
            return
        # Each inbox belongs to a subscription that is matched, too.
        inboxes = self._topic.inboxes
        if publisher.get_subscription_count() > len(inboxes):
            publisher.publish(self._to_message(record))
        for inbox in inboxes:
            inbox.put(record)

    def close(self) -> None:
        """Take the publisher away."""
        BUS.remove(self._key, 'publisher_profiles', self._profile)
        self._node.destroy_lifecycle_publisher(self._publisher)
        self._tell()

    def _tell(self) -> None:
        for choose in self._topic.observers:
            choose()


class RecordSubscription:
    """Takes records of a topic: in memory while all its publishers live here, else as messages.

    The subscription stands in the ROS graph either way. Both ways end in the same callback, and
    a `MessageError` of a conversion refuses a record as it refuses a message.

    Parameters
    ----------
    node : rclpy.node.Node
        A node with a ``worker``, which calls, and a ``message_guard``, as a `DataNode` has.
    message_type : type
    topic : str
    callback : callable
        ``callback(record)``.
    from_message, from_record : callable
        Return what the callback takes, from a message and from the publisher's record. Both must
        return the same for the same data.
    profile : QoSProfile
        Its depth bounds the inbox, too.
    poll_s : float, optional
        The worker looks for messages this often, instead of waking for each. Cheaper
        for a stream that may come late, such as one that is only looked at.

    Attributes
    ----------
    is_local : bool
        Whether records come in memory now.
    """

    def __init__(
        self,
        node: Any,
        message_type: Any,
        topic: str,
        callback: Callable[[Any], object],
        *,
        from_message: Callable[[Any], Any],
        from_record: Callable[[Any], Any],
        profile: QoSProfile,
        poll_s: float | None = None,
    ) -> None:
        self._node = node
        self._profile = profile
        self._is_polled = poll_s is not None
        self._message_type = message_type
        self._name = topic
        self._on_message = node.message_guard.wrap(
            topic, lambda message: callback(from_message(message))
        )
        self._on_record = node.message_guard.wrap(
            topic, lambda record: callback(from_record(record))
        )
        self.is_local = False
        self._is_closed = False
        self._receiver = receiver_of(node.context)
        self._messages = Inbox(profile.depth, lambda: node.worker.submit(self._take_message))
        self._subscribe()
        self._key = (node.context, self._subscription.topic_name, message_type)
        self._inbox = Inbox(profile.depth, lambda: node.worker.submit(self._take))
        self._observer = lambda: node.worker.submit(self._choose)
        self._topic = BUS.add(self._key, 'observers', self._observer)
        self._look = node.worker.every(LOOK_PERIOD_S, self._choose)
        self._poll = node.worker.every(poll_s, self._take_messages) if poll_s else None
        self._choose()

    def close(self) -> None:
        """Take the subscription away; what is in its inbox is dropped."""
        self._is_closed = True
        self._look.cancel()
        if self._poll is not None:
            self._poll.cancel()
        BUS.remove(self._key, 'observers', self._observer)
        BUS.remove(self._key, 'inboxes', self._inbox)
        self._receiver.remove(self._subscription)
        self._node.destroy_subscription(self._subscription)
        # What the callbacks hold must not wait until Python collects this object.
        del self._subscription, self._on_message, self._on_record

    def _subscribe(self) -> None:
        self._subscription = Node.create_subscription(
            self._node,
            self._message_type,
            self._name,
            self._on_message,
            self._profile,
            callback_group=NotOnExecutor(),
        )
        if not self._is_polled:
            self._receiver.add(self._subscription, self._messages.put)

    def _take(self) -> None:
        record = self._inbox.take()
        if not self._is_closed:
            self._on_record(record)

    def _take_message(self) -> None:
        message, _ = self._messages.take()
        if not self._is_closed:
            self._on_message(message)

    def _take_messages(self) -> None:
        """Take the messages that have come."""
        while not (self.is_local or self._is_closed):
            with self._subscription.handle:
                taken = self._subscription.handle.take_message(self._message_type, False)
            if taken is None:
                return
            self._on_message(taken[0])

    def _choose(self) -> None:
        """Take records if all publishers are in this process, and messages if one is not."""
        if self._is_closed:
            return
        profiles = self._topic.publisher_profiles
        wants_records = (
            len(profiles) > 0
            and self._node.count_publishers(self._subscription.topic_name) <= len(profiles)
            and all(_is_compatible(profile, self._profile) for profile in profiles)
        )
        if wants_records == self.is_local:
            return
        if wants_records:
            self._receiver.remove(self._subscription)
            self.is_local = True
            BUS.add(self._key, 'inboxes', self._inbox)
            return
        # Messages that have come meanwhile are known already: begin with an empty queue.
        before = self._subscription
        self._subscribe()
        self._node.destroy_subscription(before)
        BUS.remove(self._key, 'inboxes', self._inbox)
        self.is_local = False


def _is_compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """Return whether DDS would connect the two."""
    return bool(qos_check_compatible(publisher, subscription)[0] != QoSCompatibility.ERROR)


def depth_of(profile: QoSProfile) -> int:
    """Return how many messages a queue of this profile keeps."""
    return int(profile.depth) if profile.history == HistoryPolicy.KEEP_LAST else sys.maxsize
