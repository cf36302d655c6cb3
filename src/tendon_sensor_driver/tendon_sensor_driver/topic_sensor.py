# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of a sensor whose force another node publishes, and diagnosis of its topic."""

from __future__ import annotations

from collections.abc import Sequence
import copy
import time
from typing import Any, NamedTuple

from rclpy.qos import (
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
)

from tactile_ros.message_classes import message_class
from tactile_ros.periodic import Periodic
from tactile_ros.polling import PolledSubscription
from tactile_ros.rclpy_internals import RCLError
from tactile_ros.stages import StageNode
from tendon_sensor_driver.client import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.topic_stream import READERS, ReadingError, TopicStream
from tendon_sensor_driver.types import SensorHealth

RATE_TOLERANCE = 0.02
"""Largest accepted deviation of the measured rate from ``rate_hz``, relative to ``rate_hz``."""

_UNKNOWN = '_NODE_NAME_UNKNOWN_'

LARGEST_DELAY_S = 0.02
"""Largest accepted delay from stamp to arrival [s], as an absolute value."""


SAME_STAMPS = 10
"""If so many messages in a row have the same stamp, the publisher does not stamp them."""


class Publisher(NamedTuple):
    """One publisher of a topic, as listed in the ROS graph."""

    node: str  # name of the publishing node, with namespace
    type_name: str  # message type, such as ``std_msgs/msg/Float64``
    qos_conflict: str | None = None  # reason why its QoS is incompatible, or None


def choose_type(publishers: Sequence[Publisher], present: str | None = None) -> str | None:
    """Return the message type to subscribe to, or None if no publisher has a supported type.

    ``present`` is the type of the existing subscription, which is kept as long as a publisher has
    this type.
    """
    types = [publisher.type_name for publisher in publishers if publisher.type_name in READERS]
    return present if present in types else next(iter(types), None)


def find_publisher_problem(
    topic: str, publishers: Sequence[Publisher], type_name: str | None
) -> str | None:
    """Return the reason why messages on a topic cannot be received, with a remedy, or None.

    ``type_name`` is the type of the existing subscription, if there is one.
    """
    if not publishers:
        return (
            f'{topic} has no publisher; start its publisher, or set "topic" to a topic from '
            '"ros2 topic list -t" or "tactile devices --topics"'
        )
    fitting = [publisher for publisher in publishers if publisher.type_name == type_name]
    if not fitting and choose_type(publishers):
        return f'{topic} has only just been discovered and is not subscribed yet; listen longer'
    if not fitting:
        types = ', '.join(sorted({publisher.type_name for publisher in publishers}))
        known = ', '.join(READERS)
        return f'{topic} has the type {types}; a supported type is needed: {known}'
    if all(publisher.qos_conflict for publisher in fitting):
        return (
            f'{fitting[0].node} publishes {topic} with an incompatible QoS: '
            f'{fitting[0].qos_conflict}; change the publisher or the qos_overrides of this node'
        )
    return None


def find_stream_problem(
    topic: str,
    stream: TopicStream,
    publishers: Sequence[Publisher],
    *,
    is_silent: bool,
) -> str | None:
    """Return a problem of the received messages, with a remedy, or None.

    Parameters
    ----------
    topic : str
        Name of the topic.
    stream : TopicStream
        Stream of the messages on the topic.
    publishers : sequence of Publisher
        Publishers of the topic.
    is_silent : bool
        True if no message has arrived for a while.
    """
    nodes = ', '.join(sorted({publisher.node for publisher in publishers}))
    if is_silent:
        return (
            f'{nodes} has a publisher of {topic} but sends nothing; check that its controller is '
            'active'
        )
    if len(publishers) > 1:
        return (
            f'{topic} has {len(publishers)} publishers ({nodes}), whose samples are mixed; stop '
            'all but one, or set "topic" to a topic with one publisher'
        )
    if stream.clock is not None and stream.clock.repeats >= SAME_STAMPS:
        return (
            'all messages have the same stamp; set topic_stamps to arrival, or let the publisher '
            'stamp each message'
        )
    if stream.clock is not None and stream.clock.least_delay_ns is not None:
        delay_s = stream.clock.least_delay_ns / 1e9
        if abs(delay_s) > LARGEST_DELAY_S:
            way = 'behind' if delay_s > 0 else 'ahead of'
            return (
                f'the stamps are {abs(delay_s):.3f} s {way} the time of this node; synchronise '
                'the clocks of the computers, set use_sim_time as the publisher does, or set '
                'topic_stamps to arrival'
            )
    rate_hz, measured_hz = stream.rate_hz, stream.meter.rate_hz
    if rate_hz and measured_hz and abs(measured_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
        return (
            f'{topic} is published at {measured_hz:.2f} Hz, but rate_hz is {rate_hz:g}; set '
            f'rate_hz of this node to {measured_hz:.4g}, or to 0 to measure it'
        )
    return None


LOOK_PERIOD_S = 0.1
_LARGEST_WAIT_NS = 10_000_000_000

BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""QoS of the subscription, which is also compatible with reliable publishers.

The queue holds the messages of one second at 1 kHz.
"""


class TopicClient(SensorClient):
    """Client of a sensor whose force another node publishes on a topic.

    The publisher can start after the client, and can stop and start again. Ten times a second, the
    client checks which publishers the topic has, and subscribes with their message type.
    Messages are processed on the thread that polls the subscriptions of the node, under the lock
    of the node. See `SensorClient` for the parameters.
    """

    def __init__(
        self,
        node: StageNode,
        config: TendonSensorConfig,
        on_block: OnBlock,
        now_ns: NowNs,
    ) -> None:
        super().__init__(config, on_block, now_ns)
        self._node = node
        self._stream = TopicStream(config)
        self.identity = str(node.resolve_topic_name(config.topic))
        self._type_name: str | None = None
        self._subscription: PolledSubscription | None = None
        self._looks: Periodic | None = None
        self._publishers: list[Publisher] = []
        self._has_met = False
        self._rejected = 0
        self._last_rejected = ''
        self._refusal: str | None = None  # reason why the subscription failed, or None

    def open(self) -> None:
        """Start to look for the publisher.

        Raises
        ------
        TendonSensorError
            If this node itself publishes the topic.
        """
        self._check_is_new(self._looks is not None)
        own = [self._node.resolve_topic_name(name) for name in ('~/wrench', '~/strain')]
        if self.identity in own:
            raise TendonSensorError(
                f'{self.identity} is published by this node itself; set "topic" to the topic of '
                'the force'
            )
        self._note_heard()
        self._look()
        self._looks = self._node.call_every(LOOK_PERIOD_S, self._look)

    def close(self) -> None:
        self._stop.set()
        if self._looks is not None:
            self._looks.cancel()
            self._looks = None
        with self._node.lock:
            self._unsubscribe()
            self._is_connected = False
            self._deliver(self._stream.flush())

    def set_at_rest(self, is_at_rest: bool) -> None:
        if (samples := self._stream.samples) is not None:
            samples.set_at_rest(is_at_rest)

    def health(self) -> SensorHealth:
        stream = self._stream
        error = {}
        if not self._is_connected:
            error['last_error'] = self._refusal or find_publisher_problem(
                self.identity, self._publishers, self._type_name
            )
        return self._make_health(
            stream.samples,
            lines=stream.readings + self._rejected,
            readings=stream.readings,
            rejected_lines=self._rejected,
            device_status=None if stream.is_value_finite else 'the value is not a finite number',
            rate_hz=stream.meter.rate_hz,
            irregular_stamps=0 if stream.clock is None else stream.clock.irregular_stamps,
            last_rejected=self._last_rejected,
            advice=self._find_problem(),
            **error,
        )

    def _find_problem(self) -> str | None:
        if not self._is_connected:
            return None
        is_silent = self._measure_silence_s() > self._config.silence_s
        return find_stream_problem(
            self.identity, self._stream, self._publishers, is_silent=is_silent
        )

    def _measure_silence_s(self) -> float:
        return (time.monotonic_ns() - self._heard_monotonic_ns) / 1e9

    # -- under the node's lock -------------------------------------------------------------

    def _look(self) -> None:
        """Check the publishers, subscribe if possible, and end the block during a silence."""
        with self._node.lock:
            if not self._stop.is_set():
                self._check_publishers()

    def _check_publishers(self) -> None:
        self._publishers = self._list_publishers()
        wanted = choose_type(self._publishers, self._type_name)
        if wanted and wanted != self._type_name:
            self._subscribe(wanted)
        is_there = not find_publisher_problem(self.identity, self._publishers, self._type_name)
        if is_there and not self._is_connected:
            self._note_heard()
            if self._has_met:
                self._reconnects += 1
                self._stream.note_reconnection()
            self._has_met = True
        self._is_connected = is_there
        if not is_there or self._measure_silence_s() > self._config.silence_s:
            self._deliver(self._stream.flush())

    def _list_publishers(self) -> list[Publisher]:
        profile = self._subscription.qos_profile if self._subscription else BEST_EFFORT
        found = []
        for info in self._node.get_publishers_info_by_topic(self.identity):
            level, reason = qos_check_compatible(info.qos_profile, profile)
            conflict = reason if level == QoSCompatibility.ERROR else None
            node = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            # ROS 2 discovers a publisher before the name of its node is known.
            node = 'another node' if _UNKNOWN in node else node
            found.append(Publisher(node, info.topic_type, conflict))
        return found

    def _subscribe(self, type_name: str) -> None:
        self._unsubscribe()
        read = READERS[type_name]
        stream = self._stream

        def on_message(message: Any, info: Any) -> None:
            if self._stop.is_set() or type_name != self._type_name:
                return
            # If the thread is paused between these two lines, the time of arrival is too late,
            # which is harmless. In the reverse order, it would be too early, and the sample would
            # be dropped as an outlier.
            wait_ns = _measure_wait_ns(info)
            received_at_ns = self._arrivals.now_ns() - wait_ns
            if self._arrivals.step_ns:
                stream.note_clock_step(self._arrivals.take_step_ns())
            try:
                reading = read(message, self._config)
            except ReadingError as error:
                self._rejected += 1
                self._last_rejected = str(error)
                return
            self._note_heard()
            rate_hz = stream.rate_hz
            blocks = stream.add(reading, received_at_ns, info.get('publication_sequence_number'))
            if stream.rate_hz != rate_hz:
                self._node.get_logger().info(
                    f'{self.identity} is published at {stream.rate_hz:.3f} Hz, which is used as '
                    'rate_hz'
                )
            self._deliver(blocks)

        try:
            self._subscription = self._node.poll(
                message_class(type_name),
                self._config.topic,
                on_message,
                copy.copy(BEST_EFFORT),  # a copy, because rclpy writes overrides into the profile
                overridable=True,
            )
        except RCLError as error:  # raised if this process uses the topic with another type
            self._type_name = None
            self._refusal = f'cannot subscribe to {self.identity} as {type_name}: {error}'
        else:
            self._type_name, self._refusal = type_name, None

    def _unsubscribe(self) -> None:
        subscription, self._subscription = self._subscription, None
        if subscription is not None:
            self._node.unpoll(subscription)


def _measure_wait_ns(info: Any) -> int:
    """Return how long a message waited in the middleware before it was taken [ns]."""
    received_ns = info.get('received_timestamp') or 0
    wait_ns = time.time_ns() - received_ns
    return wait_ns if 0 < wait_ns < _LARGEST_WAIT_NS else 0
