# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon actuator as a ROS 2 node: actions to pull and to home, guarded by the tension."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from linear_guide_driver.conversions import joint_state_to_msg
from linear_guide_driver.dynamixel.tendon_client import TendonActuatorClient
from linear_guide_driver.errors import LinearGuideDriverError, MotionStoppedError
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.safety.states import Ending, Zero
from linear_guide_driver.safety.watched_topics import wait_first, WatchedTopics
from linear_guide_driver.throttle import Throttle
from tactile_msgs.action import HomeTendon, PullTendon
from tactile_msgs.msg import StrainBlock
from tactile_ros.errors import MessageError
from tactile_ros.health.diagnostics import Diagnostics, ERROR, Health, OK, WARN
from tactile_ros.health.heartbeat import HeartbeatPublisher
from tactile_ros.health.readiness import ReadinessPublisher
from tactile_ros.node.goals import Goal, GoalAborted, GoalCanceled, GoalRunner
from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import STREAM
from tactile_ros.strain import NOT_LIVE, StrainStatus

FEEDBACK_PERIOD_S = 0.1
WARM_C = 10.0
FULL_CURRENT = 0.95


class TendonActuatorNode(TactileNode):
    """Drives the tendon actuator.

    Actions ``~/pull`` and ``~/home``, services ``~/stop`` and ``~/release``, topics
    ``~/joint_states``, ``~/ready`` and ``~/heartbeat`` (while active and sound), health on
    ``/diagnostics``. Feeds ``tendon_sensor/strain`` and the heartbeat topics to
    `linear_guide_driver.safety`, which every motion has to pass.
    """

    def __init__(self, node_name: str = 'tendon_actuator', **node_options: Any) -> None:
        super().__init__(node_name, TendonActuatorConfig, **node_options)
        self._client: TendonActuatorClient | None = None
        self._parts: list[Any] = []  # that have a `close`
        self._triggers: list[Any] = []
        self._joint_states: Any = None
        self._strain: Any = None
        self._diagnostics: Diagnostics | None = None

    def set_up(self, config: TendonActuatorConfig) -> None:
        self._joint_states = self.create_stream_publisher(JointState, '~/joint_states')
        topics = WatchedTopics(self)
        self._parts.append(topics)
        for topic in config.heartbeat_topics:
            topics.add(Empty, topic, config.heartbeat_timeout_s, qos_profile_sensor_data)
        self._client = TendonActuatorClient(
            config,
            self._on_state,
            lambda: int(self.get_clock().now().nanoseconds),
            self._on_trouble,
            topics.watchdogs,
        )
        self._client.connect()
        self._strain = self.create_subscription(
            StrainBlock, 'tendon_sensor/strain', self._on_strain, STREAM
        )
        GoalRunner(
            self,
            PullTendon,
            '~/pull',
            self._pull,
            accepting=self._accepting,
            preempts=lambda request: not (request.displacement_m or request.target_tension_n),
        )
        GoalRunner(self, HomeTendon, '~/home', self._home, accepting=self._accepting)
        self._triggers = [
            self.create_service(Trigger, '~/stop', self._on_stop),
            self.create_service(Trigger, '~/release', self._on_release),
        ]
        self._diagnostics = Diagnostics(self, self._hardware_id, self._health)
        self._parts += [
            self._diagnostics,
            HeartbeatPublisher(self, self._is_well),
            ReadinessPublisher(self, self._find_missing),
        ]

    def stop(self) -> None:
        self._end_motion()

    def tear_down(self) -> None:
        for runner in tuple(self.goal_runners):
            runner.close()
        if self._client is not None:
            self._client.close()
            self._client = None
        self._diagnostics = None
        for part in self._parts:
            part.close()
        self._parts = []
        for service in self._triggers:
            self.destroy_service(service)
        self._triggers = []
        if self._strain is not None:
            self.destroy_subscription(self._strain)
            self._strain = None
        if self._joint_states is not None:
            self.destroy_lifecycle_publisher(self._joint_states)
            self._joint_states = None

    # -- goals -------------------------------------------------------------------------------

    def _accepting(self) -> str:
        if not self.is_active:
            return 'The actuator is not active; activate its node first.'
        if any(runner.is_busy for runner in self.goal_runners):
            return 'The tendon is busy with another motion; stop it first.'
        return ''

    def _pull(self, goal: Goal) -> PullTendon.Result:
        client, request = self._client, goal.request
        assert client is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)
        started_s = time.monotonic()

        def on_state(state: TendonState) -> None:
            if throttle.is_due():
                goal.feedback(displacement_m=state.displacement_m, current_a=state.current_a)

        def rest() -> dict[str, float]:
            reached_m = 0.0 if client.state is None else client.state.displacement_m
            asks = bool(request.stop_tension_n or request.target_tension_n)
            return {
                'displacement_m': reached_m,
                'duration_s': time.monotonic() - started_s,
                'tension_n': (client.safety.tension_n or 0.0) if asks else 0.0,
            }

        def pull() -> PullTendon.Result:
            if request.target_tension_n:
                client.pull_to_tension(
                    request.target_tension_n,
                    request.displacement_m,
                    request.speed_m_s,
                    on_state,
                    lambda: goal.end_requested,
                    contact=request.contact,
                )
                message = f'The tension is {client.safety.tension_n:.2f} N and is kept.'
                return PullTendon.Result(message=message, **rest())
            state = client.pull_to(
                request.displacement_m,
                request.speed_m_s,
                on_state,
                lambda: goal.end_requested,
                contact=request.contact,
                stop_tension_n=request.stop_tension_n,
            )
            if client.safety.ending is Ending.REACHED:
                reached = f'The tension reached {request.stop_tension_n:.2f} N.'
                message = f'{reached} The tendon is held there.'
                return PullTendon.Result(message=message, stopped_by_tension=True, **rest())
            message = f'The tendon rests at {state.displacement_m:.4f} m.'
            return PullTendon.Result(message=message, **rest())

        if request.displacement_m:
            self._wait_for_peers(goal)
        return self._run(goal, pull, rest)

    def _home(self, goal: Goal) -> HomeTendon.Result:
        client = self._client
        assert client is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)

        def on_state(state: TendonState) -> None:
            if throttle.is_due():
                goal.feedback(
                    displacement_m=state.displacement_m, tension_n=client.safety.tension_n or 0.0
                )

        def home() -> HomeTendon.Result:
            taut_n = goal.request.taut_tension_n or self.config.taut_tension_n
            shift_m = client.home(taut_n, on_state, lambda: goal.end_requested)
            return HomeTendon.Result(
                message='The tendon is just taut at its new zero, '
                f'{shift_m:.4f} m from the old one.',
                shift_m=shift_m,
            )

        self._wait_for_peers(goal)
        return self._run(goal, home)

    @staticmethod
    def _run(
        goal: Goal, work: Callable[[], Any], rest: Callable[[], dict[str, float]] = dict
    ) -> Any:
        """Return what ``work`` returns; end the goal with the reason when it raises."""
        try:
            return work()
        except MotionStoppedError as error:
            end = GoalCanceled if goal.end_requested else GoalAborted
            raise end(str(error), **rest()) from error
        except LinearGuideDriverError as error:
            raise GoalAborted(str(error), **rest()) from error

    def _wait_for_peers(self, goal: Goal) -> None:
        """Give peers that have not been heard yet a moment, as after a start."""
        client = self._client
        assert client is not None
        wait_first(lambda: client.safety.awaits_first, self.config.peer_wait_s, goal.wait)

    # -- the rest ----------------------------------------------------------------------------

    def _on_strain(self, block: StrainBlock) -> None:
        client = self._client
        if client is None or block.status & NOT_LIVE:
            return
        if not block.tension_n:
            raise MessageError('tension_n is empty; a block holds one sample or more')
        is_saturated = bool(block.status & StrainStatus.SATURATED)
        if client.safety.add_samples(block.tension_n, is_saturated, time.monotonic_ns()):
            client.supervise()

    def _end_motion(self, *, release: bool = False) -> str:
        """End the goal, then hold or let out; return what went wrong, or nothing."""
        client = self._client
        try:
            if release and client is not None:
                client.request_release(self._end_goals)
            else:
                self._end_goals()
                if client is not None:
                    client.hold_here()
        except LinearGuideDriverError as error:
            self._end_goals()
            return str(error)
        return ''

    def _end_goals(self) -> None:
        for runner in self.goal_runners:
            runner.end_goal()

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._end_motion()
        response.success = not problem
        response.message = problem or 'The tendon is held where it is.'
        if not problem and self._client is not None and self._client.safety.is_alarm:
            response.message = self._client.safety.reason
        return response

    def _on_release(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._end_motion(release=True)
        response.success = not problem
        response.message = problem or 'The tendon is let out to slack.'
        return response

    def _is_well(self) -> bool:
        return self.is_active and self._client is not None and not self._client.trouble

    def _find_missing(self) -> list[str]:
        client = self._client
        if client is None or client.state is None:
            return ['The actuator is not connected; see its log.']
        if not self.is_active:
            return ['The actuator is not active; activate its node.']
        if client.trouble:
            return [f'{client.trouble}; remove the cause.']
        obstacle = client.safety.find_obstacle(client.state.displacement_m, time.monotonic_ns())
        return [obstacle] if obstacle else []

    def _on_trouble(self, reason: str) -> None:
        self.get_logger().error(reason)
        if self._diagnostics is not None:
            self._diagnostics.publish()  # at once: a hold is not the time to wait for a second

    def _on_state(self, state: TendonState) -> None:
        if self._joint_states is not None:
            self._joint_states.publish(
                joint_state_to_msg(
                    self.config.joint_name,
                    self.config.frame_id,
                    state.displacement_m,
                    state.velocity_m_s,
                    state.received_at_ns,
                )
            )

    def _hardware_id(self) -> str:
        return '' if self._client is None else self._client.identification

    def _health(self) -> Health:
        client = self._client
        state = None if client is None else client.state
        if client is None or state is None:
            return Health(ERROR, 'The tendon actuator is not connected.', {})
        safety = client.safety
        values = {
            'displacement_m': f'{state.displacement_m:.6f}',
            'current_a': f'{state.current_a:.3f}',
            'voltage_v': f'{state.voltage_v:.1f}',
            'temperature_c': f'{state.temperature_c:.0f}',
            'tension_limit_n': safety.limit_n,
            'tension_n': 'unknown' if safety.tension_n is None else f'{safety.tension_n:.3f}',
            'safety': safety.state.value,
            'zero': safety.zero.value,
            'watchdog_recoveries': client.recoveries,
            'port': self.config.port,
        }
        if client.trouble:
            return Health(ERROR, client.trouble, values)
        if safety.is_alarm or safety.zero is Zero.UNKNOWN:
            return Health(WARN, safety.reason or next(iter(self._find_missing()), ''), values)
        if state.temperature_c >= client.temperature_limit_c - WARM_C:
            sentence = f'The servo is hot; it shuts down at {client.temperature_limit_c:.0f} C.'
            return Health(WARN, sentence, values)
        if abs(state.current_a) >= FULL_CURRENT * self.config.current_limit_a:
            return Health(WARN, 'The servo pulls with all the current that it may.', values)
        if safety.tension_n is None:
            return Health(WARN, 'No strain sample yet: the tension is not guarded.', values)
        if safety.live_tension_n(time.monotonic_ns()) is None:
            sentence = 'Valid strain samples have ceased: the tension is not guarded.'
            return Health(WARN, sentence, values)
        return Health(OK, 'The actuator is ready.', values)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run_node(TendonActuatorNode)
