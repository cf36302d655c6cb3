# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS side of the live page: finds fingers by their topics."""

from __future__ import annotations

from collections.abc import Callable
import functools
from typing import Any, cast

from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_classifier.conversions import classification_from_msg
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    feature_window_from_record,
    strain_block_from_msg,
    strain_block_from_record,
)
from tactile_lab.watch.state import MOST_FINGERS, WatchState
from tactile_msgs.msg import (
    Classification,
    Readiness,
    Slip,
    StrainBlock,
    TactileFeatures,
    Tare,
    TrialEvent,
)
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordSubscription
from tactile_ros.bus.worker import Worker
from tactile_ros.errors import MessageError
from tactile_ros.node.message_guard import MessageGuard
from tactile_ros.qos import EVENTS, LATEST, RESULTS, STREAM

LOOK_PERIOD_S = 0.5
"""How often new topics and services are looked for."""

POLL_S = 0.04
"""How often samples of other processes are taken; a page gets fewer frames a second."""

STOPS = ('linear_guide/stop', 'tendon_actuator/stop')
CANCEL = 'trial_runner/run_trial/_action/cancel_goal'
TARE = 'tendon_sensor/tare'
HOME = 'linear_guide/home/_action/send_goal'
TRIAL = 'trial_runner/run_trial/_action/send_goal'
CONTROLS = {'tare': (TARE,), 'home': (HOME,), 'trial': (TRIAL,), 'stop': (CANCEL, *STOPS)}

MOST_SUBSCRIPTIONS = 20 * MOST_FINGERS


class WatchNode(Node):  # type: ignore[misc]
    """Subscribes to what fingers publish, wherever it is, and passes it on to a `WatchState`.

    It has what `RecordSubscription` needs of a `DataNode`, and no parameters or lifecycle: fewer
    services make its executor cheaper. Whatever goes wrong here is logged: a page must not end
    the rig that it looks at.

    Parameters
    ----------
    state : WatchState
    context : rclpy.context.Context
    answers_only : bool
        Take events and answers alone.
    """

    def __init__(self, state: WatchState, context: Context, *, answers_only: bool = False) -> None:
        super().__init__(
            'watch', context=context, start_parameter_services=False, enable_rosout=False
        )
        self.message_guard = MessageGuard(self)
        self.worker = Worker('worker of watch', self._on_error)
        self.state = state
        self._closables: list[RecordSubscription] = []
        self._topics: set[str] = set()
        self.control_clients: dict[str, Any] = {}
        self._kinds = {
            'tactile_msgs/msg/TrialEvent': self._add_events,
            'tactile_msgs/msg/Classification': self._add_answers,
        }
        if not answers_only:
            self._kinds |= {
                'tactile_msgs/msg/StrainBlock': self._add_strain,
                'tactile_msgs/msg/TactileFeatures': self._add_features,
                'tactile_msgs/msg/Readiness': self._add_readiness,
                'tactile_msgs/msg/Slip': self._add_slip,
                'tactile_msgs/msg/Tare': self._add_tare,
            }
            self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._answers_only = answers_only
        self.worker.every(LOOK_PERIOD_S, self._look)
        self.worker.submit(self._look)
        self.worker.start()

    def destroy_node(self) -> None:
        self.worker.stop()
        for subscription in self._closables:
            subscription.close()
        super().destroy_node()

    def _on_error(self, error: Exception) -> None:
        self.get_logger().error(f'the live page lacks data from now on: {error!r}')

    # -- what is there -----------------------------------------------------------------

    def _look(self) -> None:
        """Subscribe to topics that are new; find what can be asked of each finger."""
        if not self.context.ok():
            return
        for topic, types in self.get_topic_names_and_types():
            add = next((self._kinds[t] for t in types if t in self._kinds), None)
            if add is None or topic in self._topics or len(self._topics) >= MOST_SUBSCRIPTIONS:
                continue
            if self.count_publishers(topic):  # others listen to what nobody sends
                self._topics.add(topic)
                add(topic, *_split(topic))
        if not self._answers_only:
            self._look_for_services()

    def _look_for_services(self) -> None:
        services = {name for name, _ in self.get_service_names_and_types()}
        for finger in self.state.fingers:
            place = f'/{finger.name}' if finger.name else ''
            for name in (*STOPS, CANCEL, TARE):
                path = f'{place}/{name}'
                if path in services and path not in self.control_clients:
                    kind = CancelGoal if name == CANCEL else Trigger
                    self.control_clients[path] = self.create_client(kind, path)
            controls = [
                action
                for action, names in CONTROLS.items()
                if any(f'{place}/{name}' in services for name in names)
            ]
            self.state.set_controls(finger.name, controls)

    # -- what comes ------------------------------------------------------------------------

    def create_subscription(
        self,
        message_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        *args: Any,
        **options: Any,
    ) -> Any:
        """Subscribe; the callback raises nothing."""
        safe = self._safe(topic, callback)
        return super().create_subscription(message_type, topic, safe, *args, **options)

    def _listen_records(
        self, kind: type, topic: str, callback: Callable[[Any], None], **options: Any
    ) -> None:
        node = cast(DataNode, self)
        callback = self._safe(topic, callback)
        self._closables.append(RecordSubscription(node, kind, topic, callback, **options))

    def _safe(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback that raises nothing: what it cannot take is logged now and then."""

        @functools.wraps(callback)
        def safe(message: Any) -> None:
            try:
                callback(message)
            except Exception as error:
                reason = error if isinstance(error, MessageError) else repr(error)
                self.message_guard.refuse(topic, reason)

        return safe

    def _add_strain(self, topic: str, finger: str, source: str) -> None:
        self._listen_records(
            StrainBlock,
            topic,
            lambda block: self.state.take_block(finger, block),
            from_message=strain_block_from_msg,
            from_record=strain_block_from_record,
            profile=STREAM,
            poll_s=POLL_S,
        )

    def _add_features(self, topic: str, finger: str, source: str) -> None:
        self._listen_records(
            TactileFeatures,
            topic,
            lambda window: self.state.take_window(finger, window),
            from_message=feature_window_from_msg,
            from_record=feature_window_from_record,
            profile=RESULTS,
        )

    def _add_answers(self, topic: str, finger: str, source: str) -> None:
        self._listen_records(
            Classification,
            topic,
            lambda answer: self.state.take_answer(finger, source, answer),
            from_message=classification_from_msg,
            from_record=lambda answer: answer,
            profile=RESULTS,
        )

    def _add_events(self, topic: str, finger: str, source: str) -> None:
        def take(message: Any) -> None:
            self.state.take_event(finger, event_from_msg(message))

        self.create_subscription(TrialEvent, topic, take, EVENTS)

    def _add_readiness(self, topic: str, finger: str, source: str) -> None:
        name = f'{finger}/{source}' if finger else source

        def take(message: Any) -> None:
            self.state.take_readiness(name, [str(m) for m in message.missing])

        self.create_subscription(Readiness, topic, take, LATEST)

    def _add_slip(self, topic: str, finger: str, source: str) -> None:
        def take(message: Any) -> None:
            known = self.state.finger(finger)
            if known is not None:
                onset_ns = message.onset.sec * 10**9 + message.onset.nanosec
                known.take_slip(message.motion, onset_ns, message.statistic, message.tension_n)

        self.create_subscription(Slip, topic, take, RESULTS)

    def _add_tare(self, topic: str, finger: str, source: str) -> None:
        def take(message: Any) -> None:
            known = self.state.finger(finger)
            if known is not None:
                known.take_tare(bool(message.is_set), float(message.bias_n))

        self.create_subscription(Tare, topic, take, LATEST)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values[:64]}
            self.state.take_health(status.name, status.level[0], status.message, values)


def _split(topic: str) -> tuple[str, str]:
    """Return the finger's namespace and the node's name in a topic's name."""
    parts = topic.strip('/').split('/')
    return '/'.join(parts[:-2]), parts[-2] if len(parts) > 1 else ''


def place_of(finger: str, name: str) -> str:
    """Return the absolute name of a topic or service of a finger."""
    return f'/{finger}/{name}' if finger else f'/{name}'
