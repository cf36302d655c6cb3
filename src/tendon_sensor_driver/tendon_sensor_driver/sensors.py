# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What every sensor looks like to the node, and which one a configuration names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tactile_ros.strain import StrainBlock
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.lines.line_client import TendonSensorClient
from tendon_sensor_driver.records import Health, TendonSensorConfig

OnBlock = Callable[[StrainBlock], None]
NowNs = Callable[[], int]


class SensorClient(Protocol):
    """One sensor, opened once, that hands out blocks on a thread of its own."""

    @property
    def identity(self) -> str:
        """Serial number or the like, empty while it is not known."""
        ...

    def open(self) -> None:
        """Open the link and start to read.

        Raises
        ------
        TendonSensorError
            When there is no such sensor, or it refuses its settings.
        """
        ...

    def close(self) -> None:
        """Hand out what has arrived and close the link. Harmless when called twice."""
        ...

    def health(self) -> Health:
        """Return the state of the link now."""
        ...


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
    if config.sensor == 'digital_ft':
        from tendon_sensor_driver.ati.digital_ft import DigitalFtClient

        return DigitalFtClient(config, on_block, now_ns)
    return TendonSensorClient(config, on_block, now_ns)
