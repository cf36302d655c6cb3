# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publishers of a stage, and the node that hosts one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from tactile_ros.errors import MessageError
from tactile_ros.lifecycle import TactileNode
from tactile_ros.polling import PollingNode


class RecordPublisher:
    """Publishes records as messages, while its node is active and somebody subscribes.

    ``to_message`` returns the message of a record. The profile can be overridden by parameters. It
    is volatile: a late subscriber of a latched topic would miss what was not built.
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
        """Publish a record, unless the node is inactive or nobody subscribes."""
        # The handle's own count, since it is asked for every record.
        if self._handle.get_subscription_count() and self._publisher.is_activated:
            self._publisher.publish(self._to_message(record))

    def close(self) -> None:
        """Take the publisher away."""
        self._node.destroy_lifecycle_publisher(self._publisher)


def ignore(_: object) -> None:
    """Take an output that nobody wants."""


class Stage:
    """A part of the data path between configure and cleanup."""

    def stop(self) -> None:
        """Give out what is left: the node becomes inactive."""

    def close(self) -> None:
        """Give topics and devices back; samples come no more."""


class StageNode(PollingNode):
    """A `PollingNode` around one ``stage``, which a subclass makes; None while not configured.

    ``is_fed_by_calls``: another node of the process calls it. Set before the node is configured.
    """

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.stage: Any = None
        self.is_fed_by_calls = False
        super().__init__(name, config_class, **node_options)

    def make_stage(self, config: Any) -> Stage:
        """Return the stage of a configuration; an exception refuses the transition."""
        raise NotImplementedError

    def input(self, topic: str, call: Callable[[Any, Any], object]) -> Callable[[Any], None]:
        """Return an input for another node's output: ``call(stage, record)``, under the lock.

        A record for which it raises `MessageError` is refused, as its message on ``topic`` would
        be; another exception ends the node's executor. Nothing is called while the node is not
        configured.
        """

        def take(record: Any) -> None:
            with self.lock:
                if self.stage is None:
                    return
                try:
                    call(self.stage, record)
                except MessageError as error:
                    self.message_guard.refuse(topic, error)
                except Exception as error:  # as in a callback of its own
                    self._fail(error)

        return take

    def listen(
        self, message_type: Any, topic: str, take: Callable[[Any], object], profile: QoSProfile
    ) -> None:
        """Poll a topic of samples until cleanup, unless another node calls the stage."""
        if not self.is_fed_by_calls:
            self.poll(message_type, topic, lambda message, _: take(message), profile)

    def set_up(self, config: Any) -> None:
        stage = self.make_stage(config)  # without the lock: it may read files, or open a device
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
