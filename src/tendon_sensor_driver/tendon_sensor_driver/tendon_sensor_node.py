# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sensor as a ROS node."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import WrenchStamped
from tactile_msgs.msg import StrainBlock

from tactile_ros import diagnostics
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import run_node
from tactile_ros.qos import STREAM
from tendon_sensor_driver.client import TendonSensorClient
from tendon_sensor_driver.conversions import (
    LEVEL_OK,
    assess_health,
    to_strain_msg,
    to_values,
    to_wrench_msg,
)
from tendon_sensor_driver.records import Block, TendonSensorConfig


class TendonSensorNode(TactileNode):
    """Publishes the tension on one tendon as ``~/strain`` and ``~/wrench``.

    configure opens the port, activate lets the samples out, deactivate holds them back
    while the link stays open, cleanup closes it.
    """

    def __init__(self, node_name: str = 'tendon_sensor', **node_options: Any) -> None:
        super().__init__(node_name, TendonSensorConfig, **node_options)
        self._client: TendonSensorClient | None = None
        self._level = LEVEL_OK
        self._diagnostics: diagnostics.Diagnostics | None = None
        self._strain: Any = None
        self._wrench: Any = None

    def set_up(self, config: TendonSensorConfig) -> None:
        self._strain = self.create_lifecycle_publisher(StrainBlock, '~/strain', STREAM)
        self._wrench = self.create_lifecycle_publisher(WrenchStamped, '~/wrench', STREAM)
        client = self._client = TendonSensorClient(config, self._publish, self._now_ns)
        client.open()
        self._before = client.health()
        self._diagnostics = diagnostics.Diagnostics(
            self, lambda: config.port, lambda: self._assess(client)
        )

    def tear_down(self) -> None:
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._client is not None:  # before the publishers, which its thread uses
            self._client.close()
            self._client = None
        for publisher in (self._strain, self._wrench):
            if publisher is not None:
                self.destroy_lifecycle_publisher(publisher)
        self._strain = self._wrench = None

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _publish(self, block: Block) -> None:
        """Send one block, unless deactivated; called on the client's thread."""
        frame_id = self.config.frame_id
        self._strain.publish(to_strain_msg(block, frame_id))
        self._wrench.publish(to_wrench_msg(block, frame_id))

    def _assess(self, client: TendonSensorClient) -> diagnostics.Health:
        health = client.health()
        level, sentence = assess_health(health, self._before, self.config, self._now_ns())
        self._before = health
        if level > LEVEL_OK and level != self._level:
            self.get_logger().warning(sentence)
        self._level = level
        return diagnostics.Health(bytes([level]), sentence, to_values(health))


def main() -> int:
    """Run the node until it is told to stop."""
    return run_node(TendonSensorNode)
