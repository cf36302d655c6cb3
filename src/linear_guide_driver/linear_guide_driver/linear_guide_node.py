# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The linear guide as a ROS 2 node: actions to home and to move, a service to stop."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from linear_guide_driver.conversions import joint_state_to_msg
from linear_guide_driver.errors import LinearGuideDriverError, MotionStoppedError
from linear_guide_driver.grbl.guide_client import LinearGuideClient
from linear_guide_driver.records import GuideState, LinearGuideConfig
from linear_guide_driver.safety.watched_topics import wait_first, WatchedTopics
from linear_guide_driver.throttle import Throttle
from tactile_msgs.action import HomeGuide, MoveGuide
from tactile_msgs.msg import StrainBlock
from tactile_ros.health.diagnostics import Diagnostics, ERROR, Health, OK, WARN
from tactile_ros.health.heartbeat import HeartbeatPublisher
from tactile_ros.health.readiness import ReadinessPublisher
from tactile_ros.node.goals import Goal, GoalAborted, GoalCanceled, GoalRunner
from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import STREAM
from tactile_ros.strain import NOT_LIVE

FEEDBACK_PERIOD_S = 0.1


class LinearGuideNode(TactileNode):
    """Drives the linear guide.

    Actions ``~/move`` and ``~/home``, service ``~/stop``, topics ``~/joint_states``
    (only while the position is known) and ``~/heartbeat`` (while active and on the
    line) and ``~/ready``, health on ``/diagnostics``. A motion ends, with the reason in its
    result, when a topic that it needs is silent.
    """

    def __init__(self, node_name: str = 'linear_guide', **node_options: Any) -> None:
        super().__init__(node_name, LinearGuideConfig, **node_options)
        self._client: LinearGuideClient | None = None
        self._topics: WatchedTopics | None = None
        self._parts: list[Any] = []  # that have a `close`
        self._joint_states: Any = None
        self._stop_service: Any = None
        self._loss = ''  # why the running motion has been ended
        self._diagnostics: Diagnostics | None = None

    def set_up(self, config: LinearGuideConfig) -> None:
        self._joint_states = self.create_stream_publisher(JointState, '~/joint_states')
        self._client = LinearGuideClient(
            config, self._on_state, self._now_ns, on_trouble=self._on_trouble
        )
        self._client.connect()
        GoalRunner(self, MoveGuide, '~/move', self._move, accepting=self._accepting)
        GoalRunner(self, HomeGuide, '~/home', self._home, accepting=self._accepting)
        self._topics = WatchedTopics(self)
        for topic in config.heartbeat_topics:
            self._topics.add(Empty, topic, config.heartbeat_timeout_s, qos_profile_sensor_data)
        if config.strain_timeout_s:
            self._topics.add(
                StrainBlock,
                'tendon_sensor/strain',
                config.strain_timeout_s,
                STREAM,
                lambda block: bool(block.tension_n) and not block.status & NOT_LIVE,
            )
        self._stop_service = self.create_service(Trigger, '~/stop', self._on_stop)
        self._diagnostics = Diagnostics(self, self._hardware_id, self._health)
        self._parts = [
            self._topics,
            self._diagnostics,
            HeartbeatPublisher(self, self._is_well),
            ReadinessPublisher(self, self._find_missing),
        ]

    def stop(self) -> None:
        self._end_motion()

    def tear_down(self) -> None:
        self._end_motion()
        for runner in tuple(self.goal_runners):
            runner.close()
        if self._client is not None:
            self._client.close()
            self._client = None
        self._diagnostics = None
        for part in self._parts:
            part.close()
        self._parts = []
        self._topics = None
        if self._stop_service is not None:
            self.destroy_service(self._stop_service)
            self._stop_service = None
        if self._joint_states is not None:
            self.destroy_lifecycle_publisher(self._joint_states)
            self._joint_states = None

    # -- goals -------------------------------------------------------------------------------

    def _accepting(self) -> str:
        if not self.is_active:
            return 'The linear guide is not active; activate its node first.'
        if any(runner.is_busy for runner in self.goal_runners):
            return 'The guide is busy with another motion; stop it first.'
        return ''

    def _watch_topics(self, goal: Goal) -> Callable[[], bool]:
        """Return what a motion asks again and again: whether it is to stop.

        Waits for topics that have not been heard yet; the goal is aborted if they stay silent.
        """
        topics = self._topics
        assert topics is not None
        wait_first(lambda: topics.awaits_first, self.config.peer_wait_s, goal.wait)
        if silence := topics.find_silence():
            raise GoalAborted(silence, **self._rest())

        def should_stop() -> bool:
            if not goal.end_requested and (silence := topics.find_silence()):
                self._loss = silence
                self.get_logger().error(f'{silence} The guide brakes.')
                goal.request_end()
            return goal.end_requested

        self._loss = ''
        return should_stop

    def _describe_end(self, error: Exception) -> str:
        return f'{self._loss} {error}'.strip()

    def _move(self, goal: Goal) -> MoveGuide.Result:
        assert self._client is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)

        def on_state(state: GuideState) -> None:
            if state.position_m is not None and throttle.is_due():
                goal.feedback(position_m=state.position_m, speed_m_s=abs(state.velocity_m_s))

        should_stop = self._watch_topics(goal)
        started_s = time.monotonic()
        try:
            state = self._client.move_to(
                goal.request.position_m,
                goal.request.speed_m_s,
                on_state,
                should_stop,
            )
        except MotionStoppedError as error:
            raise GoalCanceled(self._describe_end(error), **self._rest()) from error
        except LinearGuideDriverError as error:
            raise GoalAborted(str(error), **self._rest()) from error
        return MoveGuide.Result(
            message=f'The guide rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
            duration_s=time.monotonic() - started_s,
            **(self._client.last_move._asdict() if self._client.last_move else {}),
        )

    def _home(self, goal: Goal) -> HomeGuide.Result:
        assert self._client is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)

        def on_elapsed(elapsed_s: float) -> None:
            if throttle.is_due():
                goal.feedback(elapsed_s=elapsed_s)

        try:
            state = self._client.home(on_elapsed, self._watch_topics(goal))
        except MotionStoppedError as error:
            raise GoalCanceled(self._describe_end(error)) from error
        except LinearGuideDriverError as error:
            raise GoalAborted(str(error)) from error
        return HomeGuide.Result(
            message=f'The guide is homed and rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
        )

    def _rest(self) -> dict[str, float]:
        """Return where the guide rests, for a result; nothing while that is unknown."""
        state = self._client.state if self._client is not None else None
        if state is None or state.position_m is None:
            return {}
        return {'position_m': state.position_m}

    # -- the rest ----------------------------------------------------------------------------

    def _end_motion(self) -> bool:
        was_busy = any(runner.is_busy for runner in self.goal_runners)
        for runner in self.goal_runners:
            runner.end_goal()
        if self._client is not None:
            self._client.request_stop()
        return was_busy

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = (
            'The guide brakes; the running goal ends when it is at rest.'
            if self._end_motion()
            else 'The guide was not moving.'
        )
        return response

    def _on_state(self, state: GuideState) -> None:
        if state.position_m is not None and self._joint_states is not None:
            self._joint_states.publish(
                joint_state_to_msg(
                    self.config.joint_name,
                    self.config.frame_id,
                    state.position_m,
                    state.velocity_m_s,
                    state.received_at_ns,
                )
            )

    def _is_well(self) -> bool:
        return self.is_active and self._client is not None and not self._client.is_lost

    def _find_missing(self) -> list[str]:
        client, topics = self._client, self._topics
        if client is None or topics is None:
            return ['The guide is not connected; see its log.']
        if not self.is_active:
            return ['The guide is not active; activate its node.']
        homing = f'{client.trouble}; home the guide.' if client.trouble else ''
        return [sentence for sentence in (homing, topics.find_silence()) if sentence]

    def _on_trouble(self, reason: str) -> None:
        self.get_logger().error(f'{reason}; the position is unknown')
        if self._diagnostics is not None:
            self._diagnostics.publish()

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _hardware_id(self) -> str:
        return '' if self._client is None else self._client.identification

    def _health(self) -> Health:
        client = self._client
        state = None if client is None else client.state
        if client is None or state is None:
            return Health(ERROR, 'The guide is not connected.', {})
        values = {
            'state': state.state,
            'position_m': 'unknown' if state.position_m is None else f'{state.position_m:.6f}',
            'report_age_s': f'{(self._now_ns() - state.received_at_ns) / 1e9:.2f}',
            'late_moves': client.late_moves,
            'garbage_lines': client.garbage_lines,
            'port': self.config.port,
        }
        if client.is_lost:
            return Health(ERROR, f'{client.trouble}; plug it in and home the guide', values)
        if client.trouble:
            return Health(WARN, f'{client.trouble}; home the guide', values)
        return Health(OK, 'The position is known.', values)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run_node(LinearGuideNode)
