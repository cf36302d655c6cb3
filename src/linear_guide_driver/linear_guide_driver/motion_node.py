# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of both nodes: goals, watched topics, joint states, signs of life."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import time
from typing import Any, TypeVar

from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from linear_guide_driver.errors import LinearGuideDriverError
from linear_guide_driver.safety import find_loss, Watch
from tactile_ros.goals import Goal, GoalAborted
from tactile_ros.health import (
    Diagnostics,
    ERROR,
    Health,
    Heartbeat,
    HeartbeatWatch,
    ReadinessPublisher,
)
from tactile_ros.polling import PollingNode

FEEDBACK_PERIOD_S = 0.1
WAIT_STEP_S = 0.02

State = TypeVar('State')
Result = TypeVar('Result')


class MotionNode(PollingNode):
    """A node that moves one device through a blocking client.

    Topics ``~/joint_states``, ``~/ready`` and ``~/heartbeat`` (while active and well), health on
    ``/diagnostics``. A subclass connects ``_client`` in its `set_up`, then calls `offer`. The
    thread of the client that polls the device calls `beat`.
    """

    device = 'device'
    """Name of the device in sentences."""

    is_quiet = False  # its requests may wait for the device, so it shares no executor

    def __init__(self, node_name: str, config_class: type, **node_options: Any) -> None:
        super().__init__(node_name, config_class, **node_options)
        self._client: Any = None
        self._watches: tuple[Watch, ...] = ()
        self._joint_states: Any = None
        self._diagnostics: Diagnostics | None = None
        self._readiness: ReadinessPublisher | None = None
        self._heartbeat: Heartbeat | None = None
        self._loss = ''  # why the running goal has been ended
        self._parts = ExitStack()  # takes back what was made, last things first

    def is_well(self) -> bool:
        """Return whether others may rely on the connected device."""
        raise NotImplementedError

    def find_obstacles(self) -> list[str]:
        """Return a sentence for each thing that keeps the active device from moving."""
        raise NotImplementedError

    def judge_health(self, state: Any) -> Health:
        """Return the health of the connected device in this state."""
        raise NotImplementedError

    def find_loss(self) -> str:
        """Return why a running motion must end, for a client that does not know it itself."""
        return ''

    def set_up(self, config: Any) -> None:
        self._joint_states = self.create_stream_publisher(JointState, '~/joint_states')
        self._parts.callback(self.destroy_lifecycle_publisher, self._joint_states)
        lease_s = config.heartbeat_timeout_s
        watches = [HeartbeatWatch(self, '~/heartbeat', lease_s, is_own=True)]
        watches += [HeartbeatWatch(self, topic, lease_s) for topic in config.heartbeat_topics]
        for watch in watches:
            self._parts.callback(watch.close)
        self._watches = tuple(watches)

    def offer(self, **services: Callable[[], tuple[bool, str]]) -> None:
        """Offer a ``std_srvs/Trigger`` for each function, and tell how the device is.

        A function returns whether it has succeeded, and a sentence.
        """
        for name, call in services.items():

            def answer(_: Any, response: Any, call: Any = call) -> Any:
                response.success, response.message = call()
                return response

            service = self.create_service(Trigger, f'~/{name}', answer)
            self._parts.callback(self.destroy_service, service)
        self._diagnostics = Diagnostics(self, self._hardware_id, self._health)
        self._heartbeat = Heartbeat(
            self, lambda: self.is_active and self._client is not None and self.is_well()
        )
        self._readiness = ReadinessPublisher(self, self._find_missing)
        self._parts.callback(self._heartbeat.close)

    def beat(self) -> None:
        """Give the node's sign of life; on the thread that polls the device."""
        if self._heartbeat is not None:
            self._heartbeat.beat()

    def on_goal_end(self) -> None:
        if self._readiness is not None:  # whoever hears of the end may send the next goal at once
            self._readiness.update()

    def tear_down(self) -> None:
        for runner in tuple(self.goal_runners):
            runner.close()
        for part in (self._diagnostics, self._readiness):  # other threads ask the client for them
            if part is not None:
                part.close()
        self._diagnostics = self._readiness = None
        if self._client is not None:
            self._client.close()
            self._client = None
        self.unpoll_all()
        self._heartbeat = self._joint_states = None
        self._parts.close()

    def find_peer_loss(self) -> str:
        """Return which node or topic is lost and what to do; empty when none is."""
        return find_loss(self._watches, time.monotonic_ns())

    # -- goals of a subclass -------------------------------------------------------------------

    def wait_for_peers(self, goal: Goal, awaits: Callable[[], bool]) -> None:
        """Wait while ``awaits()`` says that a needed topic was never heard, as after a start.

        The wait ends with the goal, and after ``peer_wait_s``.
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
        """Move the device for a goal; return what the client returns.

        ``move`` takes what is called with each new state, and what tells whether to stop.
        ``to_feedback`` and ``find_rest`` make the fields of a feedback, and those of the result of
        a goal that is aborted.
        """
        due_s = time.monotonic()
        self._loss = ''

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
            raise GoalAborted(f'{self._loss} {error}'.strip(), **find_rest()) from error

    @property
    def is_busy(self) -> bool:
        """True while a goal runs."""
        return any(runner.is_busy for runner in self.goal_runners)

    def accepting(self) -> str:
        """Return why no goal can be taken now; empty when one can."""
        if not self.is_active:
            return f'The {self.device} is not active; activate its node first.'
        if self.is_busy:
            return f'The {self.device} is busy with another motion; stop it first.'
        return ''

    def end_goals(self) -> None:
        """Make every running goal end early."""
        for runner in self.goal_runners:
            runner.end_goal()

    # -- for the client of a subclass -----------------------------------------------------------

    def now_ns(self) -> int:
        """Return the ROS time [ns]."""
        return int(self.get_clock().now().nanoseconds)

    def publish_joint(self, position_m: float, velocity_m_s: float, stamp_ns: int) -> None:
        """Publish position [m] and velocity [m/s] at a ROS time [ns]."""
        if self._joint_states is None:
            return
        state = JointState(
            name=[self.config.joint_name], position=[position_m], velocity=[velocity_m_s]
        )
        state.header.frame_id = self.config.frame_id
        state.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        self._joint_states.publish(state)

    def tell_trouble(self, reason: str) -> None:
        """Log a fault and publish the health at once: a hold cannot wait for the next second."""
        self.get_logger().error(reason)
        diagnostics = self._diagnostics
        if diagnostics is not None:
            diagnostics.publish()

    # -- inside ----------------------------------------------------------------------------------

    def _find_missing(self) -> list[str]:
        if self._client is None or self._client.state is None:
            return [f'The {self.device} is not connected; see its log.']
        if not self.is_active:
            return [f'The {self.device} is not active; activate its node.']
        return self.find_obstacles()

    def _hardware_id(self) -> str:
        return '' if self._client is None else self._client.identification

    def _health(self) -> Health:
        state = None if self._client is None else self._client.state
        if state is None:
            return Health(ERROR, f'The {self.device} is not connected.', {})
        return self.judge_health(state)
