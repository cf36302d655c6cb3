# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor as a ROS node."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import Trigger

from tactile_msgs.msg import StrainBlock, Tare
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordPublisher
from tactile_ros.bus.worker import Periodic
from tactile_ros.health import diagnostics
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import LATEST, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord
from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.client_base import SensorClient
from tendon_sensor_driver.conversions import (
    assess_health,
    describe_restart,
    LEVEL_OK,
    to_strain_msg,
    to_tare_msg,
    to_values,
    to_wrench_msg,
)
from tendon_sensor_driver.records import Health, TendonSensorConfig
from tendon_sensor_driver.sensors import make_sensor
from tendon_sensor_driver.stream import tare

WATCH_PERIOD_S = 0.1
_NEWS_PERIODS = 10  # what was counted in the last second is news


class TendonSensorNode(DataNode):
    """Publishes the tension on one tendon as ``~/strain`` and ``~/wrench``.

    configure opens the link, activate lets the samples out, deactivate holds them back
    while the link stays open, cleanup closes it. ``~/tare`` and ``~/clear_tare`` set what is
    taken off, which is latched on ``~/tare_state``. The link is looked at ten times a second:
    what changes for better or worse is on ``/diagnostics`` at once.
    """

    def __init__(self, node_name: str = 'tendon_sensor', **node_options: Any) -> None:
        super().__init__(node_name, TendonSensorConfig, **node_options)
        self._client: SensorClient | None = None
        self._diagnostics: diagnostics.Diagnostics | None = None
        self._entities: list[tuple[Any, Any]] = []  # what to destroy, and with what
        self._drift_n: float | None = None

    def set_up(self, config: TendonSensorConfig) -> None:
        self._zero = tare.Tare(config)
        self._drift_n = None
        self._strain = self._add_stream(
            StrainBlock, '~/strain', lambda block: to_strain_msg(block, config.frame_id)
        )
        self._wrench = self._add_stream(
            WrenchStamped,
            '~/wrench',
            lambda block: to_wrench_msg(block, config.frame_id, config.axis, config.scale),
        )
        # Not held back while inactive: it is a state, and a recorder wants it from the start.
        self._tare_state = self._add(
            self.create_publisher(Tare, '~/tare_state', LATEST), self.destroy_publisher
        )
        self._publish_tare(self._zero.clear(self._now_ns()))
        client = self._make_client(config)
        client.open()
        self._client = client
        self._past: deque[Health] = deque([client.health()], maxlen=_NEWS_PERIODS)
        self._shown: tuple[object, ...] = ()
        self._diagnostics = diagnostics.Diagnostics(
            self,
            lambda: client.identity or (config.host if config.sensor == 'net_ft' else config.port),
            self._assess,
        )
        self._add(self.call_every(WATCH_PERIOD_S, self._watch), Periodic.cancel)
        for name, callback in (('~/tare', self._on_tare), ('~/clear_tare', self._on_clear_tare)):
            self._add(self.create_service(Trigger, name, callback), self.destroy_service)

    def tear_down(self) -> None:
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._client is not None:  # before the publishers, which its thread uses
            self._client.close()
            self._client = None
        while self._entities:
            entity, destroy = self._entities.pop()
            destroy(entity)

    def _make_client(self, config: TendonSensorConfig) -> SensorClient:
        if config.sensor == 'topic':
            from tendon_sensor_driver.topics.topic_client import TopicClient

            return TopicClient(self, config, self._publish, self._now_ns)
        return make_sensor(config, self._publish, self._now_ns)

    def _add_stream(
        self, kind: type, topic: str, to_message: Callable[[StrainRecord], Any]
    ) -> Any:
        publisher = self.publish_records(kind, topic, to_message, STREAM)
        return self._add(publisher, RecordPublisher.close)

    def _add(self, entity: Any, destroy: Any) -> Any:
        self._entities.append((entity, destroy))
        return entity

    def _now_ns(self) -> int:
        clock = self.get_clock()
        if clock.ros_time_is_active:
            return int(clock.now().nanoseconds)
        return time.time_ns()  # the same, without objects of rclpy

    # -- on the client's thread --------------------------------------------------------

    def _publish(self, block: StrainRecord) -> None:
        """Send one block, unless deactivated."""
        if block.stamp_ns < 0:
            return  # /clock has told no time yet: rclpy's Time raises at a negative stamp
        if block.status and block.status & StrainStatus.RESTARTED:
            self._forget_after_restart()
        block = self._zero.apply(block)
        if self.config.simulated:
            block = replace(block, status=block.status | StrainStatus.SIMULATED)
        self._strain.publish(block)
        self._wrench.publish(block)

    def _forget_after_restart(self) -> None:
        if self._zero.note_restart(self._now_ns()):
            self.get_logger().warning(
                f'{describe_restart(self.config)}; the tare is gone, tare again'
            )
            self._drift_n = None
            self._publish_tare(self._zero.bias)

    # -- on the executor's and the worker's thread -------------------------------------

    def _on_tare(self, _: Any, response: Any) -> Any:
        try:
            bias = self._zero.measure(self._now_ns())
        except tare.TareError as error:
            response.message = f'no tare: {error}'
            self.get_logger().warning(response.message)
            return response
        self._drift_n = None
        self._publish_tare(bias)
        response.success = True
        response.message = (
            f'{bias.bias_n:.3f} N are taken off from now on, the mean of {bias.samples} samples '
            f'with a spread of {bias.spread_n:.3f} N'
        )
        self.get_logger().info(response.message)
        return response

    def _on_clear_tare(self, _: Any, response: Any) -> Any:
        self._drift_n = None
        self._publish_tare(self._zero.clear(self._now_ns()))
        response.success = True
        response.message = 'nothing is taken off from now on'
        return response

    def _publish_tare(self, bias: tare.Bias) -> None:
        self._tare_state.publish(to_tare_msg(bias, self.config.frame_id))

    def _watch(self) -> None:
        """Look at the link; tell at once when what there is to say is of another kind."""
        if self._client is None or self._diagnostics is None:
            return
        health = self._client.health()
        self._past.append(health)
        level, sentence = self._judge(health)
        shown = (level, health.is_connected, health.status, health.device_status)
        if shown == self._shown:
            return
        if level > LEVEL_OK:
            self.get_logger().warning(sentence)
        self._shown = shown
        self._diagnostics.publish()

    def _judge(self, health: Health) -> tuple[int, str]:
        return assess_health(health, self._past[0], self.config, self._now_ns())

    def _assess(self) -> diagnostics.Health:
        assert self._client is not None
        health = self._client.health()
        level, sentence = self._judge(health)
        bias = self._zero.bias
        drift_n = self._zero.compute_drift(self._now_ns())
        self._drift_n = drift_n if drift_n is not None else self._drift_n
        values = {
            **to_values(health),
            'tare_n': bias.bias_n if bias.samples else 'none',
            'tare_drift_n': 'not known' if self._drift_n is None else f'{self._drift_n:.4f}',
        }
        return diagnostics.Health(bytes([level]), sentence, values)


def main() -> int:
    """Run the node until it is told to stop."""
    return run_node(TendonSensorNode)
