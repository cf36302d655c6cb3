# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base classes of the stages of the data path, and of the nodes that contain a stage.

A stage passes its output to the next stage through a topic, or by calls in the same process.
"""

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
        QoS, which parameters can override. The durability must be volatile, because a record that
        has no subscribers is not converted to a message, which could be latched.
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
        # The method of the handle is faster than the method of the publisher, and is called often.
        if self._handle.get_subscription_count() and self._publisher.is_activated:
            self._publisher.publish(self._to_message(record))

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_lifecycle_publisher(self._publisher)


def ignore(_: object) -> None:
    """Discard an output of a stage. Stages without a receiver call this function."""


class Stage:
    """A stage of the data path. A node creates it on configure and closes it on cleanup."""

    def stop(self) -> None:
        """Pass on unfinished outputs; called when the node is deactivated."""

    def close(self) -> None:
        """Release topics and devices. The stage receives no samples after this call."""


class StageNode(PollingNode):
    """A `PollingNode` that contains a stage of the data path.

    Attributes
    ----------
    stage : Stage or None
        The stage, created by `make_stage`; None while the node is not configured.
    is_fed_by_calls : bool
        True if another node in the process calls the stage, so that the stage needs no topic. It
        must be set before the node is configured.
    """

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.stage: Any = None
        self.is_fed_by_calls = False
        super().__init__(name, config_class, **node_options)

    def make_stage(self, config: Any) -> Stage:
        """Return the stage for a configuration; an exception refuses the transition."""
        raise NotImplementedError

    def input(self, topic: str, call: Callable[[Any, Any], object]) -> Callable[[Any], None]:
        """Return a function to which the stage of another node can pass its output.

        If the node is configured, the function acquires the lock and calls
        ``call(stage, record)``. If ``call`` raises `MessageError`, the record is refused like a
        message on ``topic``. Other exceptions end the node's executor.
        """

        def take(record: Any) -> None:
            with self.lock:
                if self.stage is None:
                    return
                try:
                    call(self.stage, record)
                except MessageError as error:
                    self.message_guard.refuse(topic, error)
                except Exception as error:  # handled as if a callback of this node had raised it
                    self._fail(error)

        return take

    def listen(
        self, message_type: Any, topic: str, take: Callable[[Any], object], profile: QoSProfile
    ) -> None:
        """Poll a topic of samples until cleanup, unless another node calls the stage."""
        if not self.is_fed_by_calls:
            self.poll(message_type, topic, lambda message, _: take(message), profile)

    def set_up(self, config: Any) -> None:
        stage = self.make_stage(config)  # before the lock is acquired, because this can be slow
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
