# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which client reads the sensor that a configuration names."""

from __future__ import annotations

from tendon_sensor_driver.client_base import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.lines.line_client import TendonSensorClient
from tendon_sensor_driver.records import TendonSensorConfig


def make_sensor(config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> SensorClient:
    """Return the client for ``config.sensor``, not opened yet.

    Parameters
    ----------
    config : TendonSensorConfig
    on_block : callable
        ``on_block(block)``; called on a thread of the client.
    now_ns : callable
        The present ROS time [ns].

    Raises
    ------
    TendonSensorError
        When a Net F/T is wanted and pynetft is not installed; for a topic, which needs a node.
    """
    if config.sensor == 'topic':
        raise TendonSensorError('a topic is read by the node tendon_sensor_node alone; run that')
    if config.sensor == 'net_ft':
        try:
            from tendon_sensor_driver.ati.net_ft import NetFtClient
        except ModuleNotFoundError as error:
            if error.name != 'pynetft':
                raise
            raise TendonSensorError(
                'a Net F/T needs pynetft, which is not installed: pip install pynetft'
            ) from error
        return NetFtClient(config, on_block, now_ns)
    return TendonSensorClient(config, on_block, now_ns)
