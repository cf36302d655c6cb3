# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The quality of service of every topic, in one place.

Publishers are reliable, which best-effort subscribers (REP-2003 sensor data)
can read too: a lost sample is a gap in a window, so nobody loses one by default.
"""

from collections.abc import Callable
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
    warn = _warner(node, topic, 'a subscriber of {} gets nothing: {}', _OF_SUBSCRIBERS)
    return PublisherEventCallbacks(incompatible_qos=warn)


def subscription_warnings(node: Any, topic: str) -> SubscriptionEventCallbacks:
    """Return callbacks that warn, with the cure, of publishers that are not heard."""
    warn = _warner(node, topic, 'a publisher of {} is not heard: {}', _OF_PUBLISHERS)
    return SubscriptionEventCallbacks(incompatible_qos=warn)


def _warner(node: Any, topic: str, sentence: str, cures: dict[str, str]) -> Callable[[Any], None]:
    def warn(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        name = node.resolve_topic_name(topic)
        other = f'the two differ in {policy}: `ros2 topic info --verbose {name}` shows both'
        node.get_logger().warning(sentence.format(name, cures.get(policy, other)))

    return warn
