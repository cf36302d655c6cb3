# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node of the tendon actuator: actions to pull and to home, with tension limits."""

from __future__ import annotations

from functools import partial
import math
import time
from typing import Any

import numpy as np
from rclpy.time import Time

from linear_guide_driver.config import REST_CYCLE_S, REST_REPORT_S, TendonActuatorConfig
from linear_guide_driver.dynamixel.tendon_client import TendonActuatorClient
from linear_guide_driver.errors import capitalise, LinearGuideDriverError
from linear_guide_driver.interlock import judge_slack, Slack, TendonReport
from linear_guide_driver.motion_node import MotionNode
from linear_guide_driver.safety import Ending, State, Zero
from linear_guide_driver.tension import find_limit_warnings
from linear_guide_driver.types import TendonState
from tactile_msgs.action import HomeTendon, PullTendon
from tactile_msgs.msg import StrainBlock, Tare, TendonSlack
from tactile_ros.goals import Goal, GoalRunner
from tactile_ros.hang_watch import HangWatch
from tactile_ros.health import ERROR, Health, OK, WARN
from tactile_ros.polling import POLL_S
from tactile_ros.qos import LATEST, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord
from tactile_ros.strain import StrainStatus

SLACK_PERIOD_S = 0.5
"""Period [s] of unchanged reports on ``~/slack``; the guide does not move without them for 2 s."""

LOOK_S = 0.2
"""Period [s] in which the publishers of the samples are counted; a count takes a microsecond."""

WARM_C = 10.0
FULL_CURRENT = 0.95


class TendonActuatorNode(MotionNode):
    """Node of the tendon actuator.

    Provides the actions ``~/pull`` and ``~/home`` and the services ``~/stop``, ``~/reset`` and
    ``~/release``, and publishes on ``~/slack`` whether the tendon is slack. Passes the samples of
    ``tendon_sensor/strain`` and the heartbeats to `linear_guide_driver.safety`, which checks every
    motion.
    """

    device = 'tendon actuator'

    def __init__(self, node_name: str = 'tendon_actuator', **node_options: Any) -> None:
        super().__init__(node_name, TendonActuatorConfig, **node_options)
        self._hang_watch: HangWatch | None = None
        self._report_due_s = 0.0  # time of the next joint state at rest
        self._slack: Any = None  # publisher
        self._slack_report = TendonReport(Slack.UNKNOWN)  # the last published report
        self._reported_rest = False  # ``at_rest`` of the last published report
        self._slack_due_s = 0.0

    def set_up(self, config: TendonActuatorConfig) -> None:
        super().set_up(config)
        self._slack = self.create_publisher(TendonSlack, '~/slack', LATEST)
        self._slack_due_s = 0.0
        self._parts.callback(self.destroy_publisher, self._slack)
        if config.hang_timeout_s:
            self._hang_watch = HangWatch(config.hang_timeout_s)
            self._parts.callback(self._hang_watch.close)
        self._client = TendonActuatorClient(
            config,
            self._on_state,
            self.now_ns,
            self.report_trouble,
            self._watches,
            self._on_cycle,
            self._latch,
        )
        self._client.connect()
        for warning in find_limit_warnings(config):
            self.get_logger().warning(warning)
        self._samples = self.poll(
            StrainBlock, 'tendon_sensor/strain', self._on_strain, STREAM, together=True
        )
        self._publisher_count = 0
        looking = self.call_every(LOOK_S, self._look_for_publishers)
        self._parts.callback(looking.cancel)
        tare = self.create_subscription(Tare, 'tendon_sensor/tare_state', self._on_tare, LATEST)
        self._parts.callback(self.destroy_subscription, tare)
        GoalRunner(
            self,
            PullTendon,
            '~/pull',
            self._pull,
            find_refusal=self.find_goal_refusal,
            preempts=lambda request: not request.displacement_m,
        )
        GoalRunner(self, HomeTendon, '~/home', self._home, find_refusal=self.find_goal_refusal)
        self.offer(release=self._on_release)

    def stop(self) -> None:
        """End all goals. A taut tendon is held, then slackened, because the node is inactive."""
        self.end_goals()
        self.on_stop_change()

    def on_stop_change(self) -> None:
        if self._client is not None:
            self._client.supervise()

    def stop_device(self) -> tuple[bool, str]:
        """Hold a taut tendon, then slacken it. Goals that tighten end; others continue."""
        safety = self._client.safety
        try:
            self._client.hold_here()
        except LinearGuideDriverError as error:
            return False, str(error)
        if safety.state is State.FREE:
            return True, 'The tendon is slack and stays slack.'
        return True, safety.reason

    # -- goals -------------------------------------------------------------------------------

    def _pull(self, goal: Goal) -> PullTendon.Result:
        client, request = self._client, goal.request
        started_s = time.monotonic()

        def find_rest() -> dict[str, float]:
            reached_m = 0.0 if client.state is None else client.state.displacement_m
            return {
                'displacement_m': reached_m,
                'duration_s': time.monotonic() - started_s,
                'tension_n': (client.safety.tension.latest_n or 0.0)
                if request.stop_tension_n
                else 0.0,
            }

        if request.displacement_m:
            self.refuse_rivals()
            self.wait_for_peers(goal, lambda: client.safety.awaits_first)
        state = self.carry_out(
            goal,
            partial(
                client.pull_to,
                request.displacement_m,
                request.speed_m_s,
                contact=request.contact,
                stop_tension_n=request.stop_tension_n,
            ),
            lambda state: {'displacement_m': state.displacement_m, 'current_a': state.current_a},
            find_rest,
        )
        message = f'The tendon rests at {state.displacement_m:.4f} m.'
        stopped_by_tension = client.safety.ending is Ending.REACHED
        if stopped_by_tension:
            message = f'The tension reached {request.stop_tension_n:.2f} N; the tendon is held.'
        return PullTendon.Result(
            message=message, stopped_by_tension=stopped_by_tension, **find_rest()
        )

    def _home(self, goal: Goal) -> HomeTendon.Result:
        client = self._client

        def to_feedback(state: TendonState) -> dict[str, float]:
            tension_n = client.safety.tension.latest_n or 0.0
            return {'displacement_m': state.displacement_m, 'tension_n': tension_n}

        self.refuse_rivals()
        self.wait_for_peers(goal, lambda: client.safety.awaits_first)
        taut_n = goal.request.taut_tension_n or self.config.taut_tension_n
        shift_m = self.carry_out(goal, partial(client.home, taut_n), to_feedback)
        return HomeTendon.Result(
            message=f'The tendon is homed: the zero has moved by {shift_m:.4f} m.',
            shift_m=shift_m,
        )

    # -- topics ------------------------------------------------------------------------------

    def _on_strain(self, blocks: list[StrainBlock], _: Any) -> None:
        """Pass all waiting blocks to safety, together."""
        client = self._client
        if client is None:
            return
        # A simulated clock may be slow or paused, so it does not show the age of samples.
        clock_ns = None if self.get_clock().ros_time_is_active else self.now_ns()
        records = [self._to_record(block) for block in blocks if self._is_whole(block)]
        if client.safety.add_blocks(records, time.monotonic_ns(), clock_ns):
            client.supervise()

    def _is_whole(self, block: StrainBlock) -> bool:
        if not block.tension_n:
            reason = 'tension_n is empty; a block must contain one sample or more'
            self.message_guard.refuse('tendon_sensor/strain', reason)
        elif not all(map(math.isfinite, block.tension_n)):
            reason = 'a sample is not finite; finite samples are only compared with the limit'
            self.message_guard.refuse('tendon_sensor/strain', reason)
        return bool(block.tension_n)

    @staticmethod
    def _to_record(block: StrainBlock) -> StrainRecord:
        return StrainRecord(
            Time.from_msg(block.header.stamp).nanoseconds,
            block.sequence,
            block.period_ns,
            np.asarray(block.tension_n),
            status=StrainStatus(block.status),
        )

    def _on_tare(self, tare: Tare) -> None:
        if self._client is not None:
            stamp_ns = Time.from_msg(tare.header.stamp).nanoseconds
            self._client.safety.tension.note_tare(stamp_ns)

    def _look_for_publishers(self) -> None:
        """Query the names of the publishers if their number has changed or is not one."""
        with self.lock:
            client = self._client
            if client is None:
                return
            count = self._samples.get_publisher_count()
        if count == self._publisher_count == 1:
            return
        found = self.get_publishers_info_by_topic(self._samples.topic_name)
        client.safety.tension.set_publishers(
            {
                bytes(each.endpoint_gid): f'{each.node_namespace.rstrip("/")}/{each.node_name}'
                for each in found
            }
        )
        self._publisher_count = count if count == len(found) else 0

    def _on_release(self) -> tuple[bool, str]:
        try:
            self._client.request_release(self.end_goals)
        except LinearGuideDriverError as error:
            self.end_goals()
            return False, str(error)
        return True, 'The tendon is being slackened.'

    def _on_cycle(self, pause_s: float) -> None:
        self.beat()
        rest_s = min(REST_CYCLE_S, self.config.guard_timeout_s / 4)
        self.poll_every(rest_s if self._client.is_at_rest else POLL_S)
        self._report_slack()
        if self._hang_watch is not None:
            self._hang_watch.feed(pause_s)

    def _on_state(self, state: TendonState) -> None:
        if self._client.is_at_rest and time.monotonic() < self._report_due_s:
            return
        self._report_due_s = time.monotonic() + REST_REPORT_S
        self.publish_joint(state.displacement_m, state.velocity_m_s, state.received_at_ns)

    def _report_slack(self) -> None:
        """Publish the slackness at each change and periodically. Runs on the poll thread."""
        client, now_s = self._client, time.monotonic()
        state, safety, trouble = client.state, client.safety, client.trouble
        if trouble or state is None:
            reason = trouble.reason if trouble else 'the servo has not been read yet'
            report = TendonReport(Slack.UNKNOWN, reason=reason)
        else:
            report = judge_slack(
                state.displacement_m,
                safety.zero,
                is_slack=safety.is_slack(state.displacement_m, time.monotonic_ns()),
                was_slack=self._slack_report.slack is Slack.SLACK,
                has_sensor=not self.config.unguarded,
            )
        # The samples of a tendon at rest are sent later, which a short timeout does not allow.
        is_patient = self.config.unguarded or self.config.guard_timeout_s >= 3 * REST_CYCLE_S
        is_at_rest = is_patient and report.slack is Slack.SLACK and client.is_at_rest
        last = self._slack_report
        is_new = (*report[::2], is_at_rest) != (*last[::2], self._reported_rest)
        self._slack_report, self._reported_rest = report, is_at_rest
        if is_new or now_s >= self._slack_due_s:
            self._slack_due_s = now_s + SLACK_PERIOD_S
            slack, displacement_m, reason = report
            message = TendonSlack(
                state=slack.value,
                displacement_m=displacement_m,
                at_rest=is_at_rest,
                reason=reason or '',
            )
            message.header.stamp = Time(nanoseconds=self.now_ns()).to_msg()
            self._slack.publish(message)

    def is_usable(self) -> bool:
        return self._client.trouble is None

    def find_obstacles(self) -> list[str]:
        client = self._client
        if trouble := client.trouble:
            return [capitalise(str(trouble))]
        obstacle = client.safety.find_obstacle(client.state.displacement_m, time.monotonic_ns())
        return [str(obstacle)] if obstacle else []

    def judge_health(self, state: TendonState) -> Health:
        client, safety = self._client, self._client.safety
        values = {
            'displacement_m': f'{state.displacement_m:.6f}',
            'current_a': f'{state.current_a:.3f}',
            'voltage_v': f'{state.voltage_v:.1f}',
            'temperature_c': f'{state.temperature_c:.0f}',
            'tension_limit_n': safety.limit_n,
            'tension_n': 'unknown'
            if safety.tension.latest_n is None
            else f'{safety.tension.latest_n:.3f}',
            'safety': safety.state.value,
            'zero': safety.zero.value,
            'watchdog_recoveries': client.recoveries,
            'port': self.config.port,
        }
        if trouble := client.trouble:
            return Health(ERROR, str(trouble), values)
        if safety.alarm or safety.zero is Zero.UNKNOWN:
            return Health(WARN, safety.reason or next(iter(self.find_obstacles()), ''), values)
        if state.temperature_c >= client.temperature_limit_c - WARM_C:
            sentence = (
                f'The servo is hot; it shuts down at {client.temperature_limit_c:.0f} C. Let it '
                'cool.'
            )
            return Health(WARN, sentence, values)
        if abs(state.current_a) >= FULL_CURRENT * self.config.current_limit_a:
            return Health(WARN, 'The motor current has reached current_limit_a.', values)
        if safety.tension.latest_n is None:
            return Health(
                WARN, 'The tension is not limited: no strain sample has arrived yet.', values
            )
        if loss := safety.tension.find_loss(time.monotonic_ns()):
            return Health(WARN, f'The tension is not limited: {loss}', values)
        return Health(OK, 'The actuator is ready.', values)
