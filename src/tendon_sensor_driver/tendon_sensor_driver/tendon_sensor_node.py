# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node of the sensor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
import threading
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import Trigger

from tactile_msgs.msg import StrainBlock, Tare, TendonSlack, TrialEvent
from tactile_ros import health as diagnostics
from tactile_ros.node_group import run_node
from tactile_ros.periodic import Periodic
from tactile_ros.polling import PolledSubscription
from tactile_ros.qos import EVENTS, LATEST, STREAM
from tactile_ros.refusal import Refusal
from tactile_ros.stages import ignore, RecordPublisher, Stage, StageNode
from tactile_ros.strain import StrainBlock as StrainRecord
from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import tare
from tendon_sensor_driver.client import SensorClient
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.conversions import (
    assess_health,
    format_restart,
    LEVEL_OK,
    to_strain_msg,
    to_tare_msg,
    to_values,
    to_wrench_msg,
)
from tendon_sensor_driver.sensors import make_sensor
from tendon_sensor_driver.types import SensorHealth

WATCH_PERIOD_S = 0.2
_PAST_PERIODS = 5  # diagnostics report counters that increased in so many periods (1 s)


class LastMessage:
    """Subscription that takes the last message from the middleware only in `get`; thread-safe."""

    def __init__(self, node: TendonSensorNode, kind: Any, topic: str, profile: Any) -> None:
        self._message: Any = None
        self._lock = threading.Lock()  # so that no older message replaces a newer one
        self._is_closed = False
        self._subscription = PolledSubscription(node, kind, topic, self._take, profile)

    def get(self) -> Any:
        """Return the last message, or None if there is no message or no publisher any more.

        After `close`, the result is None.
        """
        with self._lock:
            if self._is_closed:
                return None
            self._subscription.poll()
            return self._message if self._subscription.get_publisher_count() else None

    def close(self) -> None:
        """Unsubscribe; idempotent."""
        with self._lock:
            self._is_closed = True
            self._subscription.close()

    def _take(self, message: Any, _: Any) -> None:
        self._message = message


class TendonUse:
    """Use of the tendon, as other nodes report it on topics.

    During use, the tare must not change, because this would shift the force limits.
    """

    def __init__(self, node: TendonSensorNode, config: TendonSensorConfig) -> None:
        self._slack = self._event = None
        if config.tendon_topic:
            self._slack = LastMessage(node, TendonSlack, config.tendon_topic, LATEST)
        if config.trial_topic:
            self._event = LastMessage(node, TrialEvent, config.trial_topic, EVENTS)

    @property
    def is_at_rest(self) -> bool:
        """True while a tendon actuator reports that its tendon is slack and at rest."""
        slack = self._slack.get() if self._slack else None
        return slack is not None and bool(slack.at_rest)

    def find_refusal(self) -> Refusal | None:
        """Return the reason why the tare must not be changed now, or None."""
        slack = self._slack.get() if self._slack else None
        if slack is not None and slack.state == TendonSlack.TAUT:
            return Refusal(
                f'the tendon is tightened by {slack.displacement_m * 1e3:.1f} mm',
                'slacken it: ros2 service call /tendon_actuator/release std_srvs/srv/Trigger',
            )
        event = self._event.get() if self._event else None
        ends = (TrialEvent.PHASE_DONE, TrialEvent.PHASE_ABORTED)
        if event is not None and event.phase not in ends:
            return Refusal(f'trial {event.trial_id} is running', 'wait for it to end or cancel it')
        return None

    def close(self) -> None:
        """Unsubscribe; idempotent."""
        for last in (self._slack, self._event):
            if last is not None:
                last.close()


class SensorStage(Stage):
    """Reads the sensor, subtracts the tare, and publishes strain, wrench and tare.

    Parameters
    ----------
    node : TendonSensorNode
        Owner of the topics and services.
    config : TendonSensorConfig
        Parameters of the sensor.
    emit : callable
        Called with each block on the sensor's thread while the node is active.

    Raises
    ------
    TendonSensorError
        If the sensor cannot be found or does not accept its settings.
    """

    def __init__(
        self,
        node: TendonSensorNode,
        config: TendonSensorConfig,
        emit: Callable[[StrainRecord], object],
    ) -> None:
        self._node = node
        self._config = config
        self._emit = emit
        self._tare = tare.Tare(config)
        self._drift_n: float | None = None
        self._strain = RecordPublisher(
            node,
            StrainBlock,
            '~/strain',
            lambda block: to_strain_msg(block, config.frame_id),
            STREAM,
        )
        self._wrench = RecordPublisher(
            node,
            WrenchStamped,
            '~/wrench',
            lambda block: to_wrench_msg(block, config.frame_id, config.axis, config.scale),
            STREAM,
        )
        # The latched tare is also published while the node is inactive, for recordings.
        self._tare_state = node.create_publisher(Tare, '~/tare_state', LATEST)
        self._publish_tare(self._tare.clear(self._node.now_ns()))
        self._use = TendonUse(node, config)
        self._is_at_rest = False  # True if the blocks have the size for a tendon at rest
        self._rest_lock = threading.Lock()  # the size is chosen on two threads
        self._services = [
            node.create_service(Trigger, name, callback)
            for name, callback in (
                ('~/tare', self._on_tare),
                ('~/clear_tare', self._on_clear_tare),
            )
        ]
        self._diagnostics: diagnostics.Diagnostics | None = None
        self._watching: Periodic | None = None
        self._client: SensorClient | None = None
        try:
            client = self._open(config)
        except Exception:
            self.close()
            raise
        self._client = client
        self._past: deque[SensorHealth] = deque([client.health()], maxlen=_PAST_PERIODS)
        self._shown: tuple[object, ...] = ()
        self._diagnostics = diagnostics.Diagnostics(
            node,
            lambda: client.identity or (config.host if config.sensor == 'net_ft' else config.port),
            lambda: self._assess(client),
        )
        self._watching = node.call_every(WATCH_PERIOD_S, lambda: self._watch(client))

    def close(self) -> None:
        """Close the sensor, and then the publishers and services of this stage."""
        if self._watching is not None:
            self._watching.cancel()
        if self._diagnostics is not None:
            self._diagnostics.close()
        if self._client is not None:
            self._client.close()
            self._client = None
        while self._services:
            self._node.destroy_service(self._services.pop())
        self._use.close()
        self._node.destroy_publisher(self._tare_state)
        self._strain.close()
        self._wrench.close()

    def _open(self, config: TendonSensorConfig) -> SensorClient:
        client: SensorClient
        if config.sensor == 'topic':
            from tendon_sensor_driver.topic_sensor import TopicClient

            client = TopicClient(self._node, config, self._on_block, self._node.now_ns)
        else:
            client = make_sensor(config, self._on_block, self._node.now_ns)
        client.open()
        return client

    # -- on the sensor's thread ----------------------------------------------------------

    def _on_block(self, block: StrainRecord) -> None:
        """Subtract the tare from a block, and publish it while the node is active."""
        if block.stamp_ns < 0:
            return  # before the first message on /clock; rclpy accepts no negative stamps
        if block.status and block.status & StrainStatus.RESTARTED:
            self._forget_after_restart()
        block = self._tare.apply(block)
        if self._config.simulated:
            block = replace(block, status=block.status | StrainStatus.SIMULATED)
        if not self._node.is_active:
            return
        self._strain.publish(block)
        self._wrench.publish(block)
        self._emit(block)
        if self._is_at_rest:
            self._choose_blocks()

    def _choose_blocks(self) -> None:
        """Adapt the size of the blocks to whether the tendon is at rest.

        This is called five times a second, and at rest after each block.
        """
        with self._rest_lock:
            client, self._is_at_rest = self._client, self._use.is_at_rest
            if client is not None:
                client.set_at_rest(self._is_at_rest)

    def _forget_after_restart(self) -> None:
        if self._tare.note_restart(self._node.now_ns()):
            self._node.get_logger().warning(
                f'{format_restart(self._config)}; the tare was cleared, tare again'
            )
            self._drift_n = None
            self._publish_tare(self._tare.value)

    # -- on the executor -----------------------------------------------------------------

    def _on_tare(self, _: Any, response: Any) -> Any:
        if refusal := self._use.find_refusal():
            response.message = f'tare refused: {refusal}'
            self._node.get_logger().warning(response.message)
            return response
        try:
            value = self._tare.measure(self._node.now_ns())
        except tare.TareError as error:
            response.message = f'tare refused: {error}'
            self._node.get_logger().warning(response.message)
            return response
        self._drift_n = None
        self._publish_tare(value)
        response.success = True
        response.message = (
            f'tare set to {value.tare_n:.3f} N, the mean of {value.samples} samples with a '
            f'standard deviation of {value.spread_n:.3f} N'
        )
        self._node.get_logger().info(response.message)
        return response

    def _on_clear_tare(self, _: Any, response: Any) -> Any:
        if refusal := self._use.find_refusal():
            response.message = f'the tare was not cleared: {refusal}'
            return response
        self._drift_n = None
        self._publish_tare(self._tare.clear(self._node.now_ns()))
        response.success = True
        response.message = 'tare cleared'
        return response

    def _publish_tare(self, value: tare.TareValue) -> None:
        self._tare_state.publish(to_tare_msg(value, self._config.frame_id))

    # -- on the thread of periodic calls -------------------------------------------------

    def _watch(self, client: SensorClient) -> None:
        """Check the link to the sensor, and publish diagnostics if its state has changed."""
        self._node.check_simulated_time()
        self._choose_blocks()
        health = client.health()
        self._past.append(health)
        level, sentence = self._judge(health)
        shown = (level, health.is_connected, health.status, health.device_status)
        if shown == self._shown or self._diagnostics is None:
            return
        if level > LEVEL_OK:
            self._node.get_logger().warning(sentence)
        self._shown = shown
        self._diagnostics.publish()

    def _judge(self, health: SensorHealth) -> tuple[int, str]:
        return assess_health(health, self._past[0], self._config, self._node.now_ns())

    def _assess(self, client: SensorClient) -> diagnostics.Health:
        health = client.health()
        level, sentence = self._judge(health)
        value = self._tare.value
        drift_n = self._tare.compute_drift(self._node.now_ns())
        self._drift_n = drift_n if drift_n is not None else self._drift_n
        values = {
            **to_values(health),
            'tare_n': value.tare_n if value.samples else 'none',
            'tare_drift_n': 'not known' if self._drift_n is None else f'{self._drift_n:.4f}',
        }
        return diagnostics.Health(bytes([level]), sentence, values)


class TendonSensorNode(StageNode):
    """Publishes the tension on one tendon as ``~/strain`` and ``~/wrench``.

    The transition ``configure`` opens the link, ``activate`` starts publishing, ``deactivate``
    stops publishing while the link stays open, and ``cleanup`` closes the link. The services
    ``~/tare`` and ``~/clear_tare`` set and clear the tare, which is latched on ``~/tare_state``.
    The link is checked five times a second, and every change of its state is published
    immediately on ``/diagnostics``.

    Attributes
    ----------
    emit : callable
        Called with each block on the sensor's thread while the node is active. Must be set
        before the node is configured.
    """

    def __init__(self, node_name: str = 'tendon_sensor', **node_options: Any) -> None:
        self.emit: Callable[[StrainRecord], object] = ignore
        self._is_simulated_time = False
        super().__init__(node_name, TendonSensorConfig, **node_options)

    def now_ns(self) -> int:
        """Return the present ROS time [ns]."""
        if self._is_simulated_time:
            return int(self.get_clock().now().nanoseconds)
        return time.time_ns()  # this is faster than the same time from rclpy

    def check_simulated_time(self) -> None:
        """Store whether ROS time comes from ``/clock``, for fast access in `now_ns`."""
        self._is_simulated_time = self.get_clock().ros_time_is_active

    def make_stage(self, config: TendonSensorConfig) -> SensorStage:
        self.check_simulated_time()
        return SensorStage(self, config, self.emit)


def main() -> int:
    """Run the node until it is stopped."""
    return run_node(TendonSensorNode)
