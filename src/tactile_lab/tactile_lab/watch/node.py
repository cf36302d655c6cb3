# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node of the live page, which finds fingers by their topics."""

from __future__ import annotations

from collections.abc import Callable
import functools
import threading
from typing import Any

from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from linear_guide_driver.motion_node import STATES
from tactile_classifier.conversions import classification_from_msg, model_infos_from_msg
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    strain_block_from_msg,
)
from tactile_lab.watch.finger import Finger
from tactile_lab.watch.state import MOST_FINGERS, WatchState
from tactile_msgs.msg import (
    Classification,
    ModelInfos,
    Readiness,
    StopState,
    StrainBlock,
    TactileFeatures,
    TrialEvent,
)
from tactile_ros.errors import MessageError
from tactile_ros.lifecycle import MessageGuard
from tactile_ros.periodic import Ticker
from tactile_ros.polling import PolledSubscription
from tactile_ros.qos import EVENTS, LATEST, RESULTS, STREAM

LOOK_PERIOD_S = 0.5
"""Period with which new topics and services are searched [s]."""

POLL_S = 0.04
"""Period with which topics are polled [s]; it is shorter than the period of frames for pages."""

ANSWERS_POLL_S = 0.1
"""Period with which topics are polled if predictions are only printed [s]."""

SESSION_STOP = 'operator/stop'
CANCEL = 'trial_runner/run_trial/_action/cancel_goal'
TARE = 'tendon_sensor/tare'
HOME = 'linear_guide/home/_action/send_goal'
TRIAL = 'trial_runner/run_trial/_action/send_goal'
STOPS = (
    SESSION_STOP,
    'linear_guide/stop',
    'tendon_actuator/stop',
    'trial_runner/stop',
    CANCEL,
)
RELEASES = ('tendon_actuator/release',)
RESETS = ('linear_guide/reset', 'tendon_actuator/reset', 'trial_runner/reset')
ASKED = (*STOPS, *RELEASES, *RESETS, TARE)
CONTROLS = {'tare': TARE, 'home': HOME, 'trial': TRIAL}

TYPES = {Trigger: 'std_srvs/srv/Trigger', CancelGoal: 'action_msgs/srv/CancelGoal'}

MOST_SUBSCRIPTIONS = 20 * MOST_FINGERS

PROFILES = {
    StrainBlock: STREAM,
    TactileFeatures: RESULTS,
    Classification: RESULTS,
    TrialEvent: EVENTS,
    ModelInfos: LATEST,
    Readiness: LATEST,
    StopState: STATES,
}

KINDS: dict[str, type] = {
    f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}': kind for kind in PROFILES
}


class WatchNode(Node):  # type: ignore[misc]
    """Subscribes to the topics of all fingers in any namespace, for a `WatchState`.

    The node polls its topics in a thread. It has no parameters and no lifecycle. Errors are only
    logged, because an error of the live page must not end the rig in the same process. If
    ``answers_only`` is True, the node subscribes only to events, models and predictions.
    """

    is_quiet = True

    def __init__(self, state: WatchState, context: Context, *, answers_only: bool = False) -> None:
        super().__init__(
            'watch', context=context, start_parameter_services=False, enable_rosout=False
        )
        self.message_guard = MessageGuard(self)
        self.state = state
        self._ticker = Ticker('live page')
        self._lock = threading.Lock()
        self._polled: tuple[PolledSubscription, ...] = ()
        self._topics: set[str] = set()
        self._service_clients: dict[str, Any] = {}
        self._heard: set[str] = set()  # services that have had a server
        self._looking = threading.Lock()
        if not answers_only:
            self._listen_to(
                DiagnosticArray, '/diagnostics', self._on_diagnostics, QoSProfile(depth=100)
            )
        self._answers_only = answers_only
        self._calls = [
            self._ticker.every(LOOK_PERIOD_S, lambda: self._guarded(self._look)),
            self._ticker.every(
                ANSWERS_POLL_S if answers_only else POLL_S, lambda: self._guarded(self._poll)
            ),
        ]
        self._guarded(self._look)

    def destroy_node(self) -> None:
        for call in self._calls:
            call.cancel()
        with self._lock:
            for subscription in self._polled:
                subscription.close()
            self._polled = ()
        super().destroy_node()

    def _guarded(self, call: Callable[[], None]) -> None:
        try:
            with self._lock:
                call()
        except Exception as error:
            if self.context.ok():
                self.get_logger().error(
                    f'an error of the live page, which may lack data: {error!r}',
                    throttle_duration_sec=10.0,
                )

    def _poll(self) -> None:
        for subscription in self._polled:
            subscription.poll()

    # -- discovery ---------------------------------------------------------------------

    def _look(self) -> None:
        """Subscribe to new topics, and find the services of each finger."""
        if not self.context.ok():
            return
        for topic, types in self.get_topic_names_and_types():
            kind = next((KINDS[name] for name in types if name in KINDS), None)
            if self._answers_only and kind not in (TrialEvent, Classification, ModelInfos):
                continue
            if kind is None or topic in self._topics or len(self._topics) >= MOST_SUBSCRIPTIONS:
                continue
            # Without a publisher, the topic exists only because others subscribe.
            if self.count_publishers(topic):
                self._topics.add(topic)
                self._listen(topic, kind)
        if not self._answers_only:
            services = self._look_for_services()
            ends = tuple(f'/{name}' for name in RELEASES)
            self.state.set_can_release(any(path.endswith(ends) for path in services))
            for finger in self.state.fingers:
                can = [
                    do for do, name in CONTROLS.items() if place_of(finger.name, name) in services
                ]
                self.state.set_controls(finger.name, can)

    def _look_for_services(self) -> dict[str, list[str]]:
        """Create clients for new services; return the types of all known services."""
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
        """Return the client of a finger's service, or None if there is no such service."""
        self._look_for_services()
        return self._service_clients.get(path)

    def stop_clients(self) -> dict[str, Any]:
        """Return clients of the services that stop the nodes; the keys are full service names."""
        return self.clients_of(STOPS)

    def clients_of(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return clients of the services with these names, for all fingers.

        The keys are full service names. A service may have no server: if another page has a client
        for it, its name is listed, too.
        """
        self._look_for_services()
        ends = tuple(f'/{name}' for name in names)
        return {p: c for p, c in self._service_clients.items() if p.endswith(ends)}

    def must_confirm(self, path: str) -> bool:
        """Return True if Stop is only confirmed once this service has responded.

        Each driver that was ever seen must respond: if a driver has crashed, its device may still
        move. A session of trials need not respond, because it starts no trial after its end.
        """
        return path in self._heard and not path.endswith(f'/{SESSION_STOP}')

    # -- input -----------------------------------------------------------------------------

    def _listen_to(
        self, kind: type, topic: str, callback: Callable[[Any], None], profile: QoSProfile
    ) -> None:
        def take(message: Any, _: Any) -> None:
            try:
                callback(message)
            except Exception as error:  # invalid messages are logged at a limited rate
                reason = error if isinstance(error, MessageError) else repr(error)
                self.message_guard.refuse(topic, reason)

        subscription = PolledSubscription(self, kind, topic, take, profile)
        self._polled = (*self._polled, subscription)

    def _listen(self, topic: str, kind: type) -> None:
        """Subscribe to a topic. Its name contains the finger and the node of the messages."""
        state, (finger, source) = self.state, _split(topic)
        update = functools.partial(state.update, finger)
        device = f'{finger}/{source}' if finger else source
        takes: dict[type, Callable[[Any], None]] = {
            StrainBlock: lambda m: update(Finger.take_block, strain_block_from_msg(m)),
            TactileFeatures: lambda m: update(Finger.take_window, feature_window_from_msg(m)),
            Classification: lambda m: state.take_answer(finger, classification_from_msg(m)),
            ModelInfos: lambda m: update(Finger.take_models, model_infos_from_msg(m).models),
            TrialEvent: lambda m: update(Finger.take_event, event_from_msg(m)),
            StopState: lambda m: state.take_stop(topic.strip('/').rpartition('/')[0], m.reason),
            Readiness: lambda m: state.take_readiness(device, list(m.missing)),
        }
        self._listen_to(kind, topic, takes[kind], PROFILES[kind])

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values[:64]}
            self.state.take_health(status.name, status.level[0], status.message, values)


def _split(topic: str) -> tuple[str, str]:
    """Return namespace of the finger and name of the node from the full name of a topic."""
    parts = topic.strip('/').split('/')
    return '/'.join(parts[:-2]), parts[-2] if len(parts) > 1 else ''


def place_of(finger: str, name: str) -> str:
    """Return the full name of a topic or service of a finger."""
    return f'/{finger}/{name}' if finger else f'/{name}'
