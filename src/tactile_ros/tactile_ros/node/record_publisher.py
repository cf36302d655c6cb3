# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A publisher that builds a message only where somebody listens."""

from __future__ import annotations

from collections.abc import Callable
import copy
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions


class RecordPublisher:
    """Publishes records as messages, while its node is active and somebody subscribes.

    Parameters
    ----------
    node : rclpy.lifecycle.LifecycleNode
    message_type : type
    topic : str
    to_message : callable
        Returns the message of a record.
    profile : QoSProfile
        Can be overridden by parameters. Volatile: a late subscriber of a latched topic would miss
        what was not built.
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
        self._node = node
        self._to_message = to_message
        self._publisher = node.create_lifecycle_publisher(
            message_type,
            topic,
            copy.copy(profile),  # rclpy writes the overrides into it
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def publish(self, record: Any) -> None:
        """Publish a record, unless the node is inactive or nobody subscribes."""
        publisher = self._publisher
        if publisher.is_activated and publisher.get_subscription_count():
            publisher.publish(self._to_message(record))

    def close(self) -> None:
        """Take the publisher away."""
        self._node.destroy_lifecycle_publisher(self._publisher)
