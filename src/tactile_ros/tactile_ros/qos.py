# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The quality of service of every topic, in one place.

Publishers are reliable, which best-effort subscribers (REP-2003 sensor data)
can read too: a lost sample is a gap in a window, so nobody loses one by default.
"""

from functools import partial
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    qos_policy_name_from_kind,
    QoSProfile,
    ReliabilityPolicy,
)

_reliable = partial(
    QoSProfile, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)

STREAM = _reliable(depth=1000, durability=DurabilityPolicy.VOLATILE)
"""Samples: strain blocks, wrenches, joint states."""

NEWEST = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)
"""For who wants to know that samples come, and not each of them."""

RESULTS = _reliable(depth=100, durability=DurabilityPolicy.VOLATILE)
"""Features and classifications: a few a trial, each of them wanted."""

EVENTS = _reliable(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Trial events, latched: the depth holds all the events of one trial."""

CLOCK = _reliable(depth=1, durability=DurabilityPolicy.VOLATILE)
"""Time on ``/clock``: nobody wants what it was before; best-effort listeners fit, too."""

LATEST = _reliable(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A state, latched: a late subscriber receives the present one."""

_OF_SUBSCRIBERS = {
    'DURABILITY': 'it asks for transient local, and this topic keeps nothing for late '
    'subscribers: subscribe with durability volatile',
    'RELIABILITY': 'it asks for reliable, and a parameter qos_overrides made this topic best '
    'effort: subscribe with reliability best effort, or take the parameter away',
}
_OF_PUBLISHERS = {
    'DURABILITY': 'it is volatile, and this node needs what came before: publish with '
    'durability transient local',
    'RELIABILITY': 'it is best effort, and this node needs each message: publish with '
    'reliability reliable',
}


def publisher_warnings(node: Any, topic: str) -> PublisherEventCallbacks:
    """Return callbacks that warn, with the cure, of subscribers that get nothing."""

    def warn(event: Any) -> None:
        node.get_logger().warning(
            f'a subscriber of {node.resolve_topic_name(topic)} gets nothing: '
            + _format_cure(event, _OF_SUBSCRIBERS, node.resolve_topic_name(topic))
        )

    return PublisherEventCallbacks(incompatible_qos=warn)


def subscription_warnings(node: Any, topic: str) -> SubscriptionEventCallbacks:
    """Return callbacks that warn, with the cure, of publishers that are not heard."""

    def warn(event: Any) -> None:
        node.get_logger().warning(
            f'a publisher of {node.resolve_topic_name(topic)} is not heard: '
            + _format_cure(event, _OF_PUBLISHERS, node.resolve_topic_name(topic))
        )

    return SubscriptionEventCallbacks(incompatible_qos=warn)


def _format_cure(event: Any, cures: dict[str, str], topic: str) -> str:
    policy = qos_policy_name_from_kind(event.last_policy_kind)
    other = f'the two differ in {policy}: `ros2 topic info --verbose {topic}` shows both'
    return cures.get(policy, other)
