# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base class of the nodes of guide and tendon: goals, joint states, heartbeat and Stop."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import threading
import time
from typing import Any, TypeVar
import uuid

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from linear_guide_driver.errors import LinearGuideDriverError
from linear_guide_driver.safety import find_loss, Watch
from linear_guide_driver.stop_latch import EmergencyInput, StopLatch, StopState
from tactile_msgs.msg import StopState as StopStateMsg
from tactile_ros.goals import Goal, GoalAborted
from tactile_ros.health import (
    Diagnostics,
    ERROR,
    Health,
    Heartbeat,
    HeartbeatWatch,
    Presence,
    ReadinessPublisher,
)
from tactile_ros.polling import PollingNode
from tactile_ros.qos import LATEST
from tactile_ros.refusal import Refusal

FEEDBACK_PERIOD_S = 0.1
WAIT_STEP_S = 0.02

STOP_TOPIC = 'stop_state'

STATES = QoSProfile(
    depth=16, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""QoS of subscriptions to `STOP_TOPIC`, deep enough for the latest state of each node."""

EMERGENCY = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)
"""QoS of the emergency stop. It is compatible with every publisher, and deep enough that a short
press is not lost."""

State = TypeVar('State')
Result = TypeVar('Result')


def stop_state_from_msg(message: StopStateMsg) -> StopState:
    """Return the state in a message on `STOP_TOPIC`."""
    return StopState(message.number, message.stopped, message.reason)


class RigStop:
    """Connects a node's `StopLatch` to ROS.

    Provides the services ``~/stop`` and ``~/reset``, exchanges states on `STOP_TOPIC`, and listens
    to ``emergency_stop_topic``. `find_refusal` must be called periodically.

    Parameters
    ----------
    node : PollingNode
        Node whose configuration has the parameters of the emergency stop.
    latch : StopLatch
        The node's copy of the stopped state.
    stop : callable
        Brings the device to rest after a call of ``~/stop``. Returns whether this succeeded, and
        a message.
    on_change : callable
        Called after each change of the latch, on any thread.
    """

    def __init__(
        self,
        node: PollingNode,
        latch: StopLatch,
        stop: Callable[[], tuple[bool, str]],
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self._node, self._latch, self._stop, self._on_change = node, latch, stop, on_change
        self._name = node.get_fully_qualified_name()
        self._sender = f'{self._name} {uuid.uuid4().hex[:8]}'
        self._lock = threading.Lock()  # keeps the order of published states
        self._is_closed = False
        topic, timeout_s = node.config.emergency_stop_topic, node.config.emergency_stop_timeout_s
        latch.emergency = EmergencyInput(topic, timeout_s) if topic else None
        self._publisher = node.create_publisher(StopStateMsg, STOP_TOPIC, LATEST)
        states = node.poll(StopStateMsg, STOP_TOPIC, self._on_state, STATES)
        self._polled = [states]
        if topic:
            self._polled.append(node.poll(Bool, topic, self._on_emergency, EMERGENCY))
        self._services = [
            node.create_service(Trigger, '~/stop', self._on_stop),
            node.create_service(Trigger, '~/reset', self._on_reset),
        ]
        latch.join(self._on_latch, states.get_publisher_count)
        self._publish()

    def close(self) -> None:
        """Destroy topics and services. The latch keeps its state."""
        self._latch.leave()
        for subscription in self._polled:
            self._node.unpoll(subscription)
        for service in self._services:
            self._node.destroy_service(service)
        with self._lock:
            self._is_closed = True
            self._node.destroy_publisher(self._publisher)

    def find_refusal(self) -> Refusal | None:
        """Handle waiting messages; return why motion is not allowed, or None."""
        self._node.poll_now()
        now_ns = time.monotonic_ns()
        self._latch.check(now_ns)
        return self._latch.find_loss(now_ns)

    # -- inside --------------------------------------------------------------------------------

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._node.poll_now()  # take over earlier resets, so that this stop has a higher number
        self._latch.stop(f'Stop was pressed on {self._name}')
        response.success, response.message = self._stop()
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._node.poll_now()
        refusal = self._latch.reset(time.monotonic_ns())
        response.success = refusal is None
        response.message = 'The rig is reset.' if refusal is None else str(refusal)
        return response

    def _on_state(self, message: StopStateMsg, _: Any) -> None:
        self._latch.take(stop_state_from_msg(message), message.sender)

    def _on_emergency(self, message: Bool, _: Any) -> None:
        self._latch.hear_emergency(message.data, time.monotonic_ns())

    def _on_latch(self) -> None:
        state = self._latch.state
        text = f'the rig is stopped: {state.reason}' if state.is_stopped else 'the rig is reset'
        self._node.get_logger().warning(text)
        self._on_change()  # the device is stopped before the other nodes are informed
        self._publish()

    def _publish(self) -> None:
        with self._lock:
            if not self._is_closed and self._node.context.ok():
                number, stopped, reason = self._latch.state
                message = StopStateMsg(
                    number=number, stopped=stopped, reason=reason, sender=self._sender
                )
                message.header.stamp = self._node.get_clock().now().to_msg()
                self._publisher.publish(message)


class _Activity:
    """Watch of the driver's own node: motion is not allowed while the node is not active."""

    was_heard = True

    def __init__(self, node: MotionNode) -> None:
        self._node = node

    def find_loss(self, now_ns: int) -> Refusal | None:
        if self._node.is_active:
            return None
        return Refusal(f'The {self._node.device} is not active', 'activate its node')


class MotionNode(PollingNode):
    """Base class of a node that moves one device through a blocking client.

    Publishes ``~/joint_states``, ``~/ready``, ``~/heartbeat`` (while the node is active and the
    device is usable) and ``/diagnostics``, and provides the services ``~/stop`` and ``~/reset``.
    A subclass connects ``_client`` in `set_up` and then calls `offer`. The client's thread that
    polls the device calls `beat`.
    """

    device = 'device'
    """Name of the device in messages."""

    is_quiet = False  # callbacks may wait for the device, so the node needs its own executor

    def __init__(self, node_name: str, config_class: type, **node_options: Any) -> None:
        super().__init__(node_name, config_class, **node_options)
        self._client: Any = None
        self._watches: tuple[Watch, ...] = ()
        self._latch = StopLatch()
        self._rig_stop: RigStop | None = None
        self._joint_states: Any = None
        self._diagnostics: Diagnostics | None = None
        self._readiness: ReadinessPublisher | None = None
        self._heartbeat: Heartbeat | None = None
        self._presence: Presence | None = None
        self._loss: Refusal | None = None  # why the running goal has been ended
        self._parts = ExitStack()  # destroys topics, services and timers in reverse order

    def is_usable(self) -> bool:
        """Return True if the connected device can be used by other nodes."""
        raise NotImplementedError

    def find_obstacles(self) -> list[str]:
        """Return a sentence for each reason why the active device cannot move."""
        raise NotImplementedError

    def judge_health(self, state: Any) -> Health:
        """Return the health of the connected device from its present state."""
        raise NotImplementedError

    def stop_device(self) -> tuple[bool, str]:
        """Bring the device to rest after Stop; return whether this succeeded, and a message."""
        raise NotImplementedError

    def on_stop_change(self) -> None:
        """Handle a change of the rig's stopped state. May be called on any thread."""

    def find_loss(self) -> Refusal | None:
        """Return why a running motion must end, except for faults of the device; or None."""
        return None

    def set_up(self, config: Any) -> None:
        self._joint_states = self.create_stream_publisher(JointState, '~/joint_states')
        self._parts.callback(self.destroy_lifecycle_publisher, self._joint_states)
        # Created before the heartbeat: a node that receives the heartbeat then also receives the
        # stopped state.
        self._rig_stop = RigStop(self, self._latch, self.stop_device, self.on_stop_change)
        self._parts.callback(self._rig_stop.close)
        lease_s = config.heartbeat_timeout_s
        presence = self._presence = Presence(self)
        self._parts.callback(presence.close)
        watches = [HeartbeatWatch(self, topic, lease_s) for topic in config.heartbeat_topics]
        for watch in watches:
            self._parts.callback(watch.close)
        self._watches = (self._latch, _Activity(self), presence.rivals, *watches)

    def offer(self, **services: Callable[[], tuple[bool, str]]) -> None:
        """Create heartbeat, readiness, diagnostics, and a service for each function.

        The services have the type ``std_srvs/Trigger``. Each function returns whether it
        succeeded, and a message.
        """
        for name, call in services.items():

            def answer(_: Any, response: Any, call: Any = call) -> Any:
                response.success, response.message = call()
                return response

            service = self.create_service(Trigger, f'~/{name}', answer)
            self._parts.callback(self.destroy_service, service)
        self._diagnostics = Diagnostics(self, self._hardware_id, self._health)
        self._heartbeat = Heartbeat(
            self, lambda: self.is_active and self._client is not None and self.is_usable()
        )
        self._readiness = ReadinessPublisher(self, self._find_missing)
        self._parts.callback(self._heartbeat.close)

    def beat(self) -> None:
        """Publish the heartbeat. Called on the thread that polls the device."""
        if self._heartbeat is not None:
            self._heartbeat.beat()

    def on_goal_end(self) -> None:
        if self._readiness is not None:  # the next goal must not wait for the next report
            self._readiness.update()

    def tear_down(self) -> None:
        for runner in tuple(self.goal_runners):
            runner.close()
        for part in (self._diagnostics, self._readiness):  # they use the client on other threads
            if part is not None:
                part.close()
        self._diagnostics = self._readiness = None
        if self._client is not None:
            self._client.close()
            self._client = None
        self.unpoll_all()
        self._heartbeat = self._joint_states = self._rig_stop = None
        self._parts.close()

    def find_peer_loss(self) -> Refusal | None:
        """Return which needed node or topic is lost, or None."""
        return find_loss(self._watches, time.monotonic_ns())

    # -- goals of a subclass -------------------------------------------------------------------

    def refuse_rivals(self) -> None:
        """Abort the goal if there is a second node with the name of this one.

        Both nodes receive each goal, and the client gets the first answer. This check must
        therefore precede all others, so that the answer names both nodes.
        """
        presence = self._presence
        if presence is not None and (rivals := presence.rivals.find_loss()):
            raise GoalAborted(str(rivals))

    def wait_for_peers(self, goal: Goal, awaits: Callable[[], bool]) -> None:
        """Wait while ``awaits()`` is True, for example until each needed topic has been heard.

        The wait ends at the latest when the goal ends or ``peer_wait_s`` has passed.
        """
        deadline_s = time.monotonic() + self.config.peer_wait_s
        while awaits() and time.monotonic() < deadline_s:
            if goal.wait(WAIT_STEP_S):
                return

    def carry_out(
        self,
        goal: Goal,
        move: Callable[[Callable[[State], None], Callable[[], bool]], Result],
        to_feedback: Callable[[State], dict[str, float]],
        find_rest: Callable[[], dict[str, Any]] = dict,
    ) -> Result:
        """Move the device for a goal; return the result of ``move``.

        Parameters
        ----------
        goal : Goal
            The running goal.
        move : callable
            Moves the device. Takes two callables: the first is called with each new state, the
            second returns True if the motion must stop.
        to_feedback : callable
            Returns the fields of the feedback for a state.
        find_rest : callable
            Returns the fields of the result of an aborted goal.

        Raises
        ------
        GoalAborted
            If the motion fails or is stopped.
        """
        due_s = time.monotonic()
        self._loss = None

        def on_state(state: State) -> None:
            nonlocal due_s
            now_s = time.monotonic()
            if now_s >= due_s and (fields := to_feedback(state)):
                due_s = now_s + FEEDBACK_PERIOD_S
                goal.feedback(**fields)

        def should_stop() -> bool:
            if not goal.end_requested and (loss := self.find_loss()):
                self._loss = loss
                self.get_logger().error(f'{loss} The {self.device} brakes.')
                goal.request_end()
            return goal.end_requested

        try:
            return move(on_state, should_stop)
        except LinearGuideDriverError as error:
            sentence = f'{self._loss} {error}' if self._loss else str(error)
            raise GoalAborted(sentence, **find_rest()) from error

    @property
    def is_busy(self) -> bool:
        """True while a goal runs."""
        return any(runner.is_busy for runner in self.goal_runners)

    def find_goal_refusal(self) -> Refusal | None:
        """Return why no goal can be accepted now, or None."""
        if not self.is_active:
            return Refusal(f'The {self.device} is not active', 'activate its node first')
        if self.is_busy:
            return Refusal(f'The {self.device} is busy with another motion', 'stop it first')
        return None

    def end_goals(self) -> None:
        """Request the end of every running goal."""
        for runner in self.goal_runners:
            runner.end_goal()

    # -- for the client of a subclass -----------------------------------------------------------

    def now_ns(self) -> int:
        """Return the present ROS time [ns]."""
        return int(self.get_clock().now().nanoseconds)

    def publish_joint(self, position_m: float, velocity_m_s: float, stamp_ns: int) -> None:
        """Publish position [m] and velocity [m/s] with a stamp in ROS time [ns]."""
        if self._joint_states is None:
            return
        state = JointState(
            name=[self.config.joint_name], position=[position_m], velocity=[velocity_m_s]
        )
        state.header.frame_id = self.config.frame_id
        state.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        self._joint_states.publish(state)

    def report_trouble(self, reason: str) -> None:
        """Log a fault and publish the diagnostics immediately."""
        self.get_logger().error(reason)
        diagnostics = self._diagnostics
        if diagnostics is not None:
            diagnostics.publish()

    # -- inside ----------------------------------------------------------------------------------

    def _find_missing(self) -> list[str]:
        refusal = None if self._rig_stop is None else self._rig_stop.find_refusal()
        stop = [] if refusal is None else [str(refusal)]
        if self._client is None or self._client.state is None:
            return [*stop, f'The {self.device} is not connected; see its log.']
        if not self.is_active:
            return [*stop, f'The {self.device} is not active; activate its node.']
        return list(dict.fromkeys([*stop, *self.find_obstacles()]))

    def _hardware_id(self) -> str:
        return '' if self._client is None else self._client.identification

    def _health(self) -> Health:
        state = None if self._client is None else self._client.state
        if state is None:
            return Health(ERROR, f'The {self.device} is not connected.', {})
        return self.judge_health(state)
