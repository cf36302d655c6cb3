# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS side of the live page: finds fingers by their topics."""

from __future__ import annotations

from collections.abc import Callable
import functools
import threading
from typing import Any, cast

from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_classifier.conversions import classification_from_msg, model_infos_from_msg
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    feature_window_from_record,
    strain_block_from_msg,
    strain_block_from_record,
)
from tactile_features.records import FeatureWindow
from tactile_lab.watch.state import MOST_FINGERS, WatchState
from tactile_msgs.msg import (
    Classification,
    ModelInfos,
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

SESSION_STOP = 'operator/stop'
CANCEL = 'trial_runner/run_trial/_action/cancel_goal'
TARE = 'tendon_sensor/tare'
HOME = 'linear_guide/home/_action/send_goal'
TRIAL = 'trial_runner/run_trial/_action/send_goal'
ASKED = (SESSION_STOP, 'linear_guide/stop', 'tendon_actuator/stop', CANCEL, TARE)
CONTROLS = {'tare': TARE, 'home': HOME, 'trial': TRIAL}

TYPES = {Trigger: 'std_srvs/srv/Trigger', CancelGoal: 'action_msgs/srv/CancelGoal'}

MOST_SUBSCRIPTIONS = 20 * MOST_FINGERS

RECORDS: dict[type, dict[str, Any]] = {
    StrainBlock: {
        'from_message': strain_block_from_msg,
        'from_record': strain_block_from_record,
        'profile': STREAM,
        'poll_s': POLL_S,
    },
    TactileFeatures: {
        'from_message': feature_window_from_msg,
        'from_record': feature_window_from_record,
        'profile': RESULTS,
    },
    Classification: {
        'from_message': classification_from_msg,
        'from_record': lambda answer: answer,
        'profile': RESULTS,
    },
}
"""Kinds that come as records from nodes of this process."""

MESSAGES = {
    TrialEvent: EVENTS,
    ModelInfos: LATEST,
    Readiness: LATEST,
    Slip: RESULTS,
    Tare: LATEST,
}
"""Kinds that come as messages only."""

KINDS: dict[str, type] = {
    f'tactile_msgs/msg/{kind.__name__}': kind for kind in (*RECORDS, *MESSAGES)
}


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
        self._service_clients: dict[str, Any] = {}
        self._heard: set[str] = set()  # services that have had a server
        self._looking = threading.Lock()
        if not answers_only:
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
            kind = next((KINDS[name] for name in types if name in KINDS), None)
            if self._answers_only and kind not in (TrialEvent, Classification, ModelInfos):
                continue
            if kind is None or topic in self._topics or len(self._topics) >= MOST_SUBSCRIPTIONS:
                continue
            if self.count_publishers(topic):  # others listen to what nobody sends
                self._topics.add(topic)
                self._listen(topic, kind)
        if not self._answers_only:
            services = self._look_for_services()
            for finger in self.state.fingers:
                can = [
                    do for do, name in CONTROLS.items() if place_of(finger.name, name) in services
                ]
                self.state.set_controls(finger.name, can)

    def _look_for_services(self) -> dict[str, list[str]]:
        """Make clients of new services, of any namespace; return the types of all by name."""
        services = dict(self.get_service_names_and_types())
        with self._looking:
            for path, types in services.items():
                kind = CancelGoal if path.endswith(f'/{CANCEL}') else Trigger
                is_asked = path.endswith(tuple(f'/{name}' for name in ASKED))
                if is_asked and path not in self._service_clients and TYPES[kind] in types:
                    self._service_clients[path] = self.create_client(kind, path)
            for path, client in self._service_clients.items():
                if client.service_is_ready():
                    self._heard.add(path)
        return services

    def client_of(self, path: str) -> Any:
        """Return the client of a service of a finger; None where there is no such service."""
        self._look_for_services()
        return self._service_clients.get(path)

    def stop_clients(self) -> dict[str, Any]:
        """Return clients by name for all that can move, whether or not it has sent samples.

        Some may have no server: clients of other pages bear the same names.
        """
        self._look_for_services()
        return {p: c for p, c in self._service_clients.items() if not p.endswith(f'/{TARE}')}

    def must_confirm(self, path: str) -> bool:
        """Return whether a stop without this service's answer is not confirmed.

        The device of a driver that is gone may still move. A session that is gone starts no trial.
        """
        return path in self._heard and not path.endswith(f'/{SESSION_STOP}')

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

    def _listen(self, topic: str, kind: type) -> None:
        state, (finger, source) = self.state, _split(topic)

        def take_slip(message: Slip) -> None:
            onset_ns = message.onset.sec * 10**9 + message.onset.nanosec
            state.update(
                finger,
                lambda known: known.take_slip(
                    message.motion, onset_ns, message.statistic, message.tension_n
                ),
            )

        def take_tare(message: Tare) -> None:
            state.update(finger, lambda known: known.take_tare(message.is_set, message.bias_n))

        def take_models(message: ModelInfos) -> None:
            models = model_infos_from_msg(message).models
            state.update(finger, lambda known: known.take_models(models))

        def take_window(window: FeatureWindow) -> None:
            state.update(finger, lambda known: known.take_window(window))

        def take_readiness(message: Readiness) -> None:
            device = f'{finger}/{source}' if finger else source
            state.take_readiness(device, list(message.missing))

        takes: dict[type, Callable[[Any], None]] = {
            StrainBlock: lambda block: state.take_block(finger, block),
            TactileFeatures: take_window,
            Classification: lambda answer: state.take_answer(finger, answer),
            ModelInfos: take_models,
            TrialEvent: lambda message: state.take_event(finger, event_from_msg(message)),
            Readiness: take_readiness,
            Slip: take_slip,
            Tare: take_tare,
        }
        if kind in MESSAGES:
            self.create_subscription(kind, topic, takes[kind], MESSAGES[kind])
            return
        node, take = cast(DataNode, self), self._safe(topic, takes[kind])
        self._closables.append(RecordSubscription(node, kind, topic, take, **RECORDS[kind]))

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
