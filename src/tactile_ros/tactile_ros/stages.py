# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stages of the data path: their publishers, and the nodes that host them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from tactile_ros.errors import MessageError
from tactile_ros.lifecycle import TactileNode
from tactile_ros.polling import PollingNode


class RecordPublisher:
    """Publishes records as messages while its node is active and there are subscribers.

    Parameters
    ----------
    node : TactileNode
        The node.
    message_type
        Class of the messages.
    topic : str
        Name of the topic.
    to_message : callable
        Converts a record to a message.
    profile : QoSProfile
        QoS, which parameters can override. It must be volatile, because messages without
        subscribers are not created and so could not be latched.
    """

    def __init__(
        self,
        node: TactileNode,
        message_type: Any,
        topic: str,
        to_message: Callable[[Any], Any],
        profile: QoSProfile,
    ) -> None:
        assert profile.durability == DurabilityPolicy.VOLATILE
        self._node = node
        self._to_message = to_message
        self._publisher = node.create_stream_publisher(message_type, topic, profile)
        self._handle = self._publisher.handle

    def publish(self, record: Any) -> None:
        """Publish a record, unless the node is inactive or there are no subscribers."""
        # The count of the handle is faster, which matters for every record.
        if self._handle.get_subscription_count() and self._publisher.is_activated:
            self._publisher.publish(self._to_message(record))

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_lifecycle_publisher(self._publisher)


def ignore(_: object) -> None:
    """Discard an output; the default of ``emit``."""


class Stage:
    """A part of the data path between configure and cleanup."""

    def stop(self) -> None:
        """Emit unfinished outputs, because the node becomes inactive."""

    def close(self) -> None:
        """Release topics and devices. No samples arrive after that."""


class StageNode(PollingNode):
    """A `PollingNode` that hosts a stage.

    Attributes
    ----------
    stage : Stage or None
        The stage, created by `make_stage`; None while the node is not configured.
    is_fed_by_calls : bool
        Another node in the process calls the stage directly. Must be set before the node is
        configured.
    """

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.stage: Any = None
        self.is_fed_by_calls = False
        super().__init__(name, config_class, **node_options)

    def make_stage(self, config: Any) -> Stage:
        """Return the stage for a configuration; an exception refuses the transition."""
        raise NotImplementedError

    def input(self, topic: str, call: Callable[[Any, Any], object]) -> Callable[[Any], None]:
        """Return a function that takes the output of another node's stage.

        The function calls ``call(stage, record)`` with the lock held, unless the node is not
        configured. If ``call`` raises `MessageError`, the record is refused like a message on
        ``topic``. Other exceptions end the node's executor.
        """

        def take(record: Any) -> None:
            with self.lock:
                if self.stage is None:
                    return
                try:
                    call(self.stage, record)
                except MessageError as error:
                    self.message_guard.refuse(topic, error)
                except Exception as error:  # like an exception in a callback of this node
                    self._fail(error)

        return take

    def listen(
        self, message_type: Any, topic: str, take: Callable[[Any], object], profile: QoSProfile
    ) -> None:
        """Poll a topic of samples until cleanup, unless another node calls the stage."""
        if not self.is_fed_by_calls:
            self.poll(message_type, topic, lambda message, _: take(message), profile)

    def set_up(self, config: Any) -> None:
        stage = self.make_stage(config)  # without the lock, because it may read files or devices
        with self.lock:
            self.stage = stage

    def stop(self) -> None:
        with self.lock:
            if self.stage is not None:
                self.stage.stop()

    def tear_down(self) -> None:
        with self.lock:
            stage, self.stage = self.stage, None
            self.unpoll_all()
        if stage is not None:
            stage.close()
