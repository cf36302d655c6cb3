# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node of the linear guide: actions to home and to move."""

from __future__ import annotations

from functools import partial
import time
from typing import Any

from linear_guide_driver.config import LinearGuideConfig
from linear_guide_driver.grbl.guide_client import LinearGuideClient
from linear_guide_driver.interlock import Slack, TendonInterlock, TendonReport
from linear_guide_driver.motion_node import MotionNode
from linear_guide_driver.safety import TopicWatchdog
from linear_guide_driver.types import GuideState
from tactile_msgs.action import HomeGuide, MoveGuide
from tactile_msgs.msg import StrainBlock, TendonSlack
from tactile_ros.goals import Goal, GoalAborted, GoalRunner
from tactile_ros.health import ERROR, Health, OK, WARN
from tactile_ros.qos import LATEST, NEWEST
from tactile_ros.refusal import Refusal
from tactile_ros.strain import NOT_LIVE

TAUT_WAIT_S = 0.5
"""Time [s] that a goal waits for a taut tendon to become slack: the report of a slack tendon may
arrive after the result of the pull that slackened it."""


class LinearGuideNode(MotionNode):
    """Node of the linear guide.

    Provides the actions ``~/move`` and ``~/home`` and the services ``~/stop`` and ``~/reset``.
    Joint states are published only while the position is known. A motion ends, with the reason in
    its result, if a needed node or topic is lost or the tendon is not slack. If the goal sets
    ``allow_taut``, the tendon is not checked.
    """

    device = 'guide'
    poll_s = None

    def __init__(self, node_name: str = 'linear_guide', **node_options: Any) -> None:
        super().__init__(node_name, LinearGuideConfig, **node_options)
        self._interlock: TendonInterlock | None = None
        self._allows_taut = False  # allow_taut of the running goal

    def set_up(self, config: LinearGuideConfig) -> None:
        self._client = LinearGuideClient(
            config,
            self._on_state,
            self.now_ns,
            lambda reason: self.report_trouble(f'{reason}; the position is unknown'),
            self.beat,
        )
        self._client.connect()
        super().set_up(config)
        if config.strain_timeout_s:
            self._watch_strain(config.strain_timeout_s)
        self._interlock = None
        if config.tendon_topic:
            self._watch_tendon(config.tendon_topic)
        find_refusal = self.find_goal_refusal
        GoalRunner(self, MoveGuide, '~/move', self._move, find_refusal=find_refusal)
        GoalRunner(self, HomeGuide, '~/home', self._home, find_refusal=find_refusal)
        self.offer()

    def stop(self) -> None:
        self.end_goals()
        if self._client is not None:
            self._client.request_stop()

    def tear_down(self) -> None:
        self.stop()
        super().tear_down()

    # -- goals -------------------------------------------------------------------------------

    def _move(self, goal: Goal) -> MoveGuide.Result:
        client, request = self._client, goal.request
        self._await_topics(goal)
        started_s = time.monotonic()
        state = self.carry_out(
            goal,
            partial(client.move_to, request.position_m, request.speed_m_s),
            self._to_feedback,
            self._find_rest,
        )
        return MoveGuide.Result(
            message=f'The guide rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
            duration_s=time.monotonic() - started_s,
            **(client.last_move._asdict() if client.last_move else {}),
        )

    def _home(self, goal: Goal) -> HomeGuide.Result:
        self._await_topics(goal)
        state = self.carry_out(
            goal,
            self._client.home,
            lambda elapsed_s: {'elapsed_s': elapsed_s},
            self._find_rest,
        )
        return HomeGuide.Result(
            message=f'The guide is homed and rests at {state.position_m:.4f} m.',
            position_m=state.position_m,
        )

    def _await_topics(self, goal: Goal) -> None:
        """Wait until needed topics are heard and the tendon is slack; abort the goal otherwise."""
        self.refuse_rivals()
        self._allows_taut = goal.request.allow_taut
        began_s = time.monotonic()

        def awaits() -> bool:
            self.poll_now()
            if not all(watch.was_heard for watch in self._watches):
                return True
            slack = self._judge_tendon()
            may_become_slack = time.monotonic() - began_s < TAUT_WAIT_S
            return slack is Slack.UNKNOWN or (slack is Slack.TAUT and may_become_slack)

        self.wait_for_peers(goal, awaits)
        if loss := self.find_loss():
            raise GoalAborted(str(loss), **self._find_rest())

    def _watch_strain(self, timeout_s: float) -> None:
        watchdog = TopicWatchdog('tendon_sensor/strain', timeout_s)
        self._watches = (*self._watches, watchdog)

        def hear(block: StrainBlock, _: Any) -> None:
            if block.tension_n and not block.status & NOT_LIVE:
                watchdog.beat(time.monotonic_ns())

        self.poll(StrainBlock, 'tendon_sensor/strain', hear, NEWEST)

    def find_peer_loss(self) -> Refusal | None:
        self.poll_now()  # the samples are polled only when they are needed
        self._latch.check(time.monotonic_ns())
        return super().find_peer_loss()

    def find_loss(self) -> Refusal | None:
        return self.find_peer_loss() or (None if self._allows_taut else self._find_interlock())

    # -- the tendon --------------------------------------------------------------------------

    def _watch_tendon(self, topic: str) -> None:
        release = self.resolve_service_name(f'{topic.rpartition("/")[0]}/release')
        interlock = self._interlock = TendonInterlock(topic, release)

        def hear(message: TendonSlack, _: Any) -> None:
            report = TendonReport(
                Slack(message.state), message.displacement_m, message.reason or None
            )
            interlock.take(report, time.monotonic_ns())

        self.poll(TendonSlack, topic, hear, LATEST)

    def _judge_tendon(self) -> Slack:
        """Return the slackness of the tendon, or SLACK if the running goal ignores it."""
        if self._interlock is None or self._allows_taut:
            return Slack.SLACK
        return self._interlock.judge(time.monotonic_ns())

    def _find_interlock(self) -> Refusal | None:
        """Return why the guide may not move because of the tendon, or None."""
        interlock = self._interlock
        return None if interlock is None else interlock.find_refusal(time.monotonic_ns())

    @staticmethod
    def _to_feedback(state: GuideState) -> dict[str, float]:
        if state.position_m is None:
            return {}
        return {'position_m': state.position_m, 'speed_m_s': abs(state.velocity_m_s)}

    def _find_rest(self) -> dict[str, float]:
        """Return the position as a field of the result, if the position is known."""
        state = self._client.state
        is_known = state is not None and state.position_m is not None
        return {'position_m': state.position_m} if is_known else {}

    # -- state -------------------------------------------------------------------------------

    def stop_device(self) -> tuple[bool, str]:
        is_usable = self.is_usable()
        message = 'The guide was not moving.'
        if not is_usable:
            message = 'The connection to the guide is lost; the guide may still be moving.'
        elif self.is_busy:
            message = 'The guide is braking; the running goal ends when it is at rest.'
        self._loss = self._latch.find_loss(time.monotonic_ns())
        self.stop()
        return is_usable, message

    def _on_state(self, state: GuideState) -> None:
        if state.position_m is not None:
            self.publish_joint(state.position_m, state.velocity_m_s, state.received_at_ns)

    def is_usable(self) -> bool:
        return not self._client.is_lost

    def find_obstacles(self) -> list[str]:
        trouble, loss, interlock = self._client.trouble, self.find_peer_loss(), self._interlock
        tendon = None
        # A taut tendon is not an obstacle: a trial slackens it before it moves the guide.
        if interlock is not None and interlock.judge(time.monotonic_ns()) is Slack.UNKNOWN:
            tendon = self._find_interlock()
        return [str(each) for each in (trouble, loss, tendon) if each]

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
            return Health(ERROR, str(client.trouble), values)
        if client.trouble:
            return Health(WARN, str(client.trouble), values)
        return Health(OK, 'homed', values)
