# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records the topics of one or more fingers into an MCAP bag, as raw bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tactile_bringup.bags import BagWriter, RecordedTopic, recorded_topics
from tactile_bringup.records import RecorderConfig
from tactile_ros.lifecycle import TactileNode
from tactile_ros.message_classes import message_class
from tactile_ros.node_group import run_node
from tactile_ros.qos import EVENTS, STREAM


class BagRecorderNode(TactileNode):
    """Records while active; the bag is complete once the node is cleaned up.

    Messages are written as they arrived on the wire, so that a replay sends the
    very same bytes.
    """

    def __init__(self, node_name: str = 'bag_recorder', **node_options: Any) -> None:
        super().__init__(node_name, RecorderConfig, **node_options)
        self._writer: BagWriter | None = None
        self._topics: dict[str, RecordedTopic] = {}
        self._recording: list[Any] = []
        self.message_count = 0

    def set_up(self, config: RecorderConfig) -> None:
        if not config.bag:
            raise ValueError('parameter bag is empty; name the folder of the bag to write')
        self._writer = BagWriter(Path(config.bag), json.loads(config.facts))
        for namespace in config.namespaces:
            for topic in recorded_topics(config.classifiers):
                self._topics[self._writer.add_topic(topic, namespace)] = topic

    def start(self) -> None:
        # Subscribed only now: what a latched topic holds must come while it can be written.
        self._recording = [self._record(name, topic) for name, topic in self._topics.items()]

    def _record(self, name: str, topic: RecordedTopic) -> Any:
        assert self._writer is not None
        writer = self._writer

        def on_message(data: bytes) -> None:
            writer.write_raw(name, self.get_clock().now().nanoseconds, data)
            self.message_count += 1

        return self.create_subscription(
            message_class(topic.type_name),
            name,
            on_message,
            EVENTS if topic.latched else STREAM,
            raw=True,
        )

    def stop(self) -> None:
        for subscription in self._recording:
            self.destroy_subscription(subscription)
        self._recording = []

    def unmatched_topics(self) -> list[str]:
        """Return the topics that have no publisher yet: a recording would lack them."""
        return [name for name in self._topics if not self.count_publishers(name)]

    def tear_down(self) -> None:
        self.stop()
        self._topics = {}
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(BagRecorderNode)
