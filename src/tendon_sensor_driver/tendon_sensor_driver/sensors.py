# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Factory of the client for the configured kind of sensor."""

from __future__ import annotations

from tendon_sensor_driver.client import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.line_sensor import TendonSensorClient


def make_sensor(config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> SensorClient:
    """Return a client for ``config.sensor`` that is not opened yet.

    Parameters
    ----------
    config : TendonSensorConfig
        Kind and parameters of the sensor.
    on_block, now_ns
        See `SensorClient`.

    Raises
    ------
    TendonSensorError
        If ``config.sensor`` is ``topic``, because only a node can subscribe to a topic.
    """
    if config.sensor == 'topic':
        raise TendonSensorError(
            'a sensor on a topic can only be read by a ROS node; run tendon_sensor_node'
        )
    if config.sensor == 'net_ft':
        from tendon_sensor_driver.net_ft import NetFtClient

        return NetFtClient(config, on_block, now_ns)
    return TendonSensorClient(config, on_block, now_ns)
