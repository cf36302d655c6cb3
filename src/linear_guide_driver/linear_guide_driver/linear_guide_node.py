# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The linear guide as a ROS 2 node: actions to home and to move, a service to stop."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from std_srvs.srv import Trigger

from linear_guide_driver.errors import LinearGuideDriverError
from linear_guide_driver.grbl.guide_client import HOMING, LinearGuideClient
from linear_guide_driver.motion_node import MotionNode
from linear_guide_driver.records import GuideState, LinearGuideConfig
from tactile_msgs.action import HomeGuide, MoveGuide
from tactile_msgs.msg import StrainBlock
from tactile_ros.health.diagnostics import ERROR, Health, OK, WARN
from tactile_ros.node.goals import Goal, GoalAborted, GoalRunner
from tactile_ros.qos import STREAM
from tactile_ros.strain import NOT_LIVE


class LinearGuideNode(MotionNode):
    """Drives the linear guide.

    Actions ``~/move`` and ``~/home``, service ``~/stop``; joint states only while the position is
    known. A motion ends, with the reason in its result, when a topic that it needs is silent.
    """

    device = 'guide'

    def __init__(self, node_name: str = 'linear_guide', **node_options: Any) -> None:
        super().__init__(node_name, LinearGuideConfig, **node_options)
        self._loss = ''  # why the running motion has been ended

    def set_up(self, config: LinearGuideConfig) -> None:
        self._client = LinearGuideClient(
            config,
            self._on_state,
            self.now_ns,
            lambda reason: self.tell_trouble(f'{reason}; the position is unknown'),
        )
        self._client.connect()
        super().set_up(config)
        if config.strain_timeout_s:
            self._topics.add(
                StrainBlock,
                'tendon_sensor/strain',
                config.strain_timeout_s,
                STREAM,
                lambda block: bool(block.tension_n) and not block.status & NOT_LIVE,
            )
        GoalRunner(self, MoveGuide, '~/move', self._move, accepting=self.accepting)
        GoalRunner(self, HomeGuide, '~/home', self._home, accepting=self.accepting)
        self.offer(stop=self._on_stop)

    def stop(self) -> None:
        self.end_goals()
        if self._client is not None:
            self._client.request_stop()

    def tear_down(self) -> None:
        self.stop()
        super().tear_down()

    # -- goals -------------------------------------------------------------------------------

    def _move(self, goal: Goal) -> MoveGuide.Result:
        client, tell = self._client, self.limit_feedback(goal)

        def on_state(state: GuideState) -> None:
            if state.position_m is not None:
                tell(position_m=state.position_m, speed_m_s=abs(state.velocity_m_s))

        should_stop = self._watch_topics(goal)
        started_s = time.monotonic()
        try:
            state = client.move_to(
                goal.request.position_m, goal.request.speed_m_s, on_state, should_stop
            )
        except LinearGuideDriverError as error:
            raise self._abort(error) from error
        return MoveGuide.Result(
            message=f'The guide rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
            duration_s=time.monotonic() - started_s,
            **(client.last_move._asdict() if client.last_move else {}),
        )

    def _home(self, goal: Goal) -> HomeGuide.Result:
        tell, should_stop = self.limit_feedback(goal), self._watch_topics(goal)
        try:
            state = self._client.home(lambda elapsed_s: tell(elapsed_s=elapsed_s), should_stop)
        except LinearGuideDriverError as error:
            raise self._abort(error) from error
        return HomeGuide.Result(
            message=f'The guide is homed and rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
        )

    def _watch_topics(self, goal: Goal) -> Callable[[], bool]:
        """Return what a motion asks again and again: whether it is to stop.

        Waits for topics that have not been heard yet; the goal is aborted if they stay silent.
        """
        topics = self._topics
        self.wait_for_peers(goal, lambda: topics.awaits_first)
        self._loss = ''
        if silence := topics.find_silence():
            raise self._abort(silence)

        def should_stop() -> bool:
            if not goal.end_requested and (silence := topics.find_silence()):
                self._loss = silence
                self.get_logger().error(f'{silence} The guide brakes.')
                goal.request_end()
            return goal.end_requested

        return should_stop

    def _abort(self, reason: object) -> GoalAborted:
        """Return the end of a goal: why, and where the guide rests while that is known."""
        state = self._client.state
        is_known = state is not None and state.position_m is not None
        rest = {'position_m': state.position_m} if is_known else {}
        return GoalAborted(f'{self._loss} {reason}'.strip(), **rest)

    # -- the rest ----------------------------------------------------------------------------

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = not self._client.is_lost
        if not response.success:
            response.message = 'The connection to the guide is lost: it may still move.'
        elif self.is_busy:
            response.message = 'The guide brakes; the running goal ends when it is at rest.'
        else:
            response.message = 'The guide was not moving.'
        self.stop()
        return response

    def _on_state(self, state: GuideState) -> None:
        if state.position_m is not None:
            self.publish_joint(state.position_m, state.velocity_m_s, state.received_at_ns)

    def is_well(self) -> bool:
        return not self._client.is_lost

    def find_obstacles(self) -> list[str]:
        trouble = f'{self._describe_trouble()}.' if self._client.trouble else ''
        return [sentence for sentence in (trouble, self._topics.find_silence()) if sentence]

    def judge_health(self, state: GuideState) -> Health:
        client = self._client
        values = {
            'state': state.state,
            'position_m': 'unknown' if state.position_m is None else f'{state.position_m:.6f}',
            'report_age_s': f'{(self.now_ns() - state.received_at_ns) / 1e9:.2f}',
            'late_moves': client.late_moves,
            'garbage_lines': client.garbage_lines,
            'port': self.config.port,
        }
        if client.is_lost:
            return Health(ERROR, f'{client.trouble}; plug it in and home the guide', values)
        if client.trouble:
            return Health(WARN, self._describe_trouble(), values)
        return Health(OK, 'The position is known.', values)

    def _describe_trouble(self) -> str:
        trouble = self._client.trouble
        return f'{trouble}; {"wait for its end" if trouble == HOMING else "home the guide"}'
