# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A force that another node publishes: the client, and what is amiss."""

from __future__ import annotations

from collections import deque
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
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.records import Health, TendonSensorConfig
from tendon_sensor_driver.topic_stream import READERS, ReadingError, TopicStream

RATE_TOLERANCE = 0.02
"""Windows of a rate further off are refused."""

LARGEST_DELAY_S = 0.02
"""From there on, the shortest window of the texture protocol may be refused."""


class Publisher(NamedTuple):
    """One publisher of a topic, as the graph shows it."""

    node: str  # its name, with namespace
    type_name: str  # such as ``std_msgs/msg/Float64``
    # Why it cannot reach the subscription, by quality of service; empty: it can
    objection: str = ''


def choose_type(publishers: Sequence[Publisher], present: str = '') -> str:
    """Return the type to subscribe to; empty when no publisher has one that is known.

    The type of the present subscription stays while somebody publishes it.
    """
    types = [publisher.type_name for publisher in publishers if publisher.type_name in READERS]
    return present if present in types else next(iter(types), '')


def format_publishers(topic: str, publishers: Sequence[Publisher], type_name: str) -> str:
    """Return why nothing can come from the publishers of a topic; empty when something can.

    ``type_name`` is that of the subscription; empty: there is none yet.
    """
    if not publishers:
        return (
            f'nobody publishes {topic}; start its publisher, or set "topic" to a name of '
            '"ros2 topic list -t"'
        )
    fitting = [publisher for publisher in publishers if publisher.type_name == type_name]
    if not fitting and choose_type(publishers):
        return f'{topic} was found just now and is not subscribed to yet; listen longer'
    if not fitting:
        types = ', '.join(sorted({publisher.type_name for publisher in publishers}))
        known = ', '.join(READERS)
        return f'{topic} is {types}, which holds no tension; it must be one of {known}'
    if all(publisher.objection for publisher in fitting):
        return (
            f'{fitting[0].node} publishes {topic} with another quality of service: '
            f'{fitting[0].objection}; change the publisher or the qos_overrides of this node'
        )
    return ''


def format_stream(
    topic: str,
    stream: TopicStream,
    publishers: Sequence[Publisher],
    *,
    is_silent: bool,
    new_duplicates: int = 0,
    new_samples: int = 0,
) -> str:
    """Return what is wrong with what comes, with the remedy; empty when nothing is.

    Of the last while are ``new_duplicates``, readings with the stamp of the one before, and
    ``new_samples``, readings that count.
    """
    nodes = ', '.join(sorted({publisher.node for publisher in publishers}))
    if is_silent:
        return (
            f'{nodes} has the publisher of {topic} and sends nothing: see whether its controller '
            'is active'
        )
    if len(publishers) > 1:
        return (
            f'{topic} has {len(publishers)} publishers ({nodes}), whose samples mix; end all but '
            'one, or name a topic of its own'
        )
    if new_duplicates and not new_samples:
        return (
            'each message has the stamp of the one before; set topic_stamps to arrival, or have '
            'the publisher stamp them'
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
            f'{topic} comes at {measured_hz:.2f} Hz and rate_hz is {rate_hz:g}; set rate_hz of '
            f'this node to {measured_hz:.4g}, or to 0 to have it measured'
        )
    return ''


LOOK_PERIOD_S = 0.1
_LOOKS = 10  # of which what was counted is news
_LARGEST_WAIT_NS = 10_000_000_000

BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Reliable publishers fit, too. The depth is a second at 1 kHz."""


class TopicClient(SensorClient):
    """Takes the force of a topic and hands out blocks until it is closed.

    The publisher may come later, go and come back: ten times a second the graph is looked at,
    and the subscription made that fits the publisher's type. Messages come on the thread that
    polls the node's subscriptions, under the node's lock.
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
        self._type_name = ''
        self._subscription: PolledSubscription | None = None
        self._looks: Periodic | None = None
        self._publishers: list[Publisher] = []
        self._has_met = False
        self._rejected = 0
        self._last_rejected = ''
        self._refusal = ''  # of the subscription
        self._past: deque[tuple[int, int]] = deque(maxlen=_LOOKS)  # duplicates, samples

    def open(self) -> None:
        """Look for the publisher from now on; TendonSensorError: it is this node itself."""
        self._check_is_new(self._looks is not None)
        own = [self._node.resolve_topic_name(name) for name in ('~/wrench', '~/strain')]
        if self.identity in own:
            raise TendonSensorError(
                f'{self.identity} is published by this node itself; set "topic" to that of the '
                'force'
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

    def health(self) -> Health:
        stream = self._stream
        error = {}
        if not self._is_connected:
            error['last_error'] = self._refusal or format_publishers(
                self.identity, self._publishers, self._type_name
            )
        return self._make_health(
            stream.samples,
            lines=stream.readings + self._rejected,
            readings=stream.readings,
            rejected_lines=self._rejected,
            device_status='' if stream.is_value_finite else 'the value is not a finite number',
            rate_hz=stream.meter.rate_hz,
            last_rejected=self._last_rejected,
            advice=self._advise(),
            **error,
        )

    def _advise(self) -> str:
        if not self._is_connected:
            return ''
        now = (self._count_duplicates(), self._stream.readings)
        before = self._past[0] if self._past else now
        duplicates = now[0] - before[0]
        return format_stream(
            self.identity,
            self._stream,
            self._publishers,
            is_silent=self._measure_silence_s() > self._config.silence_s,
            new_duplicates=duplicates,
            new_samples=now[1] - before[1] - duplicates,
        )

    def _count_duplicates(self) -> int:
        samples = self._stream.samples
        return 0 if samples is None else samples.clock.duplicates

    def _measure_silence_s(self) -> float:
        return (time.monotonic_ns() - self._heard_monotonic_ns) / 1e9

    # -- under the node's lock -------------------------------------------------------------

    def _look(self) -> None:
        """Look who publishes; subscribe to what fits, and flush when nothing comes."""
        with self._node.lock:
            if not self._stop.is_set():
                self._look_around()

    def _look_around(self) -> None:
        self._publishers = self._list_publishers()
        wanted = choose_type(self._publishers, self._type_name)
        if wanted and wanted != self._type_name:
            self._subscribe(wanted)
        is_there = not format_publishers(self.identity, self._publishers, self._type_name)
        if is_there and not self._is_connected:
            self._note_heard()
            if self._has_met:
                self._reconnects += 1
                self._stream.note_reconnection()
            self._has_met = True
        self._is_connected = is_there
        self._past.append((self._count_duplicates(), self._stream.readings))
        if not is_there or self._measure_silence_s() > self._config.silence_s:
            self._deliver(self._stream.flush())

    def _list_publishers(self) -> list[Publisher]:
        profile = self._subscription.qos_profile if self._subscription else BEST_EFFORT
        found = []
        for info in self._node.get_publishers_info_by_topic(self.identity):
            level, reason = qos_check_compatible(info.qos_profile, profile)
            objection = reason if level == QoSCompatibility.ERROR else ''
            node = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            found.append(Publisher(node, info.topic_type, objection))
        return found

    def _subscribe(self, type_name: str) -> None:
        self._unsubscribe()
        read = READERS[type_name]
        stream = self._stream

        def on_message(message: Any, info: Any) -> None:
            if self._stop.is_set() or type_name != self._type_name:
                return
            # In this order a pause of the thread makes the arrival later, which does no harm. An
            # arrival that seems too early makes the sample an outlier, which is dropped.
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
                    f'{self.identity} comes at {stream.rate_hz:.3f} Hz, which is taken as rate_hz'
                )
            self._deliver(blocks)

        try:
            self._subscription = self._node.poll(
                message_class(type_name),
                self._config.topic,
                on_message,
                copy.copy(BEST_EFFORT),  # rclpy writes the overrides into it
                overridable=True,
            )
        except RCLError as error:  # a topic has one type within a process
            self._type_name = ''
            self._refusal = f'cannot subscribe to {self.identity} as {type_name}: {error}'
        else:
            self._type_name, self._refusal = type_name, ''

    def _unsubscribe(self) -> None:
        subscription, self._subscription = self._subscription, None
        if subscription is not None:
            self._node.unpoll(subscription)


def _measure_wait_ns(info: Any) -> int:
    """Return how long a message lay in the middleware before it was taken [ns]."""
    received_ns = info.get('received_timestamp') or 0
    wait_ns = time.time_ns() - received_ns
    return wait_ns if 0 < wait_ns < _LARGEST_WAIT_NS else 0
