# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Factory of the client for the configured kind of sensor."""

from __future__ import annotations

from tendon_sensor_driver.client import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.line_sensor import TendonSensorClient
from tendon_sensor_driver.records import TendonSensorConfig


def make_sensor(config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> SensorClient:
    """Return the client for ``config.sensor``, not opened yet; see `SensorClient`.

    TendonSensorError: a topic needs a node.
    """
    if config.sensor == 'topic':
        raise TendonSensorError('a topic is read by the node tendon_sensor_node alone; run that')
    if config.sensor == 'net_ft':
        from tendon_sensor_driver.net_ft import NetFtClient

        return NetFtClient(config, on_block, now_ns)
    return TendonSensorClient(config, on_block, now_ns)
