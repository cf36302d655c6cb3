# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The trial runner: carries out a protocol on the guide and the tendon."""

from __future__ import annotations

import concurrent.futures
import math
import time
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import (
    glide_speed_m_s,
    GuideStep,
    TendonStep,
    trial_steps,
    TrialRequest,
    WaitStep,
)
from tactile_msgs.action import MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.goals import Goal, GoalAborted, GoalCanceled, GoalRunner
from tactile_ros.heartbeat import HeartbeatPublisher
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import run_node
from tactile_ros.qos import EVENTS, STREAM
from tactile_ros.requests import send, wait_for

POLL_S = 0.02
"""How often a trial that waits looks for a reason to end."""

RELEASE_ATTEMPTS = 3
RELEASE_PAUSE_S = 0.3
"""A servo that has been silent for a moment takes a fresh command once it is heard again."""


class TrialRunnerNode(TactileNode):
    """Runs trials: action ``~/run_trial``, events on ``~/events``, ``~/heartbeat``.

    When a trial ends early, for whatever reason, guide and tendon are stopped
    and the tendon is released; nothing moves again without a new goal. A trial ends
    early, too, when the actuator lets the tendon go in contact: its guard or its watchdog
    has acted, and what follows would be no trial.
    """

    def __init__(self, node_name: str = 'trial_runner', **node_options: Any) -> None:
        super().__init__(node_name, TrialConfig, **node_options)
        self._runner: GoalRunner | None = None
        self._events: Any = None
        self._guide: ActionClient | None = None
        self._tendon: ActionClient | None = None
        self._stops: list[Any] = []
        self._tendon_states: Any = None
        self._heartbeat: HeartbeatPublisher | None = None
        self._contact = _Contact()
        self._request: TrialRequest | None = None
        self._count = 0

    def set_up(self, config: TrialConfig) -> None:
        self._events = self.create_lifecycle_publisher(TrialEvent, '~/events', EVENTS)
        self._guide = ActionClient(self, MoveGuide, 'linear_guide/move')
        self._tendon = ActionClient(self, PullTendon, 'tendon_actuator/pull')
        self._stops = [
            self.create_client(Trigger, 'linear_guide/stop'),
            self.create_client(Trigger, 'tendon_actuator/stop'),
        ]
        self._tendon_states = self.create_subscription(
            JointState, 'tendon_actuator/joint_states', self._on_tendon_state, STREAM
        )
        self._runner = GoalRunner(
            self,
            RunTrial,
            '~/run_trial',
            self._run_trial,
            accepting=lambda: '' if self.is_active else 'the trial runner is not active',
        )
        self._heartbeat = HeartbeatPublisher(self, lambda: self.is_active)

    def stop(self) -> None:
        if self._runner is not None and self._runner.is_busy:
            self._runner.end_goal()
            # From here, since the trial's thread can send nothing while this one is busy,
            # as it is when the node is shut down.
            self._ask_to_stop()

    def tear_down(self) -> None:
        if self._runner is not None:
            # Not for long: with the executor waiting here, the trial gets no more answers.
            self._runner.close(timeout_s=0.5)
            if self._runner.is_busy and self._request and self._tendon and self.context.ok():
                self._tendon.send_goal_async(self._pull(self._release(), self._request))
            self._runner = None
        if self._tendon_states is not None:
            self.destroy_subscription(self._tendon_states)
            self._tendon_states = None
        if self._heartbeat is not None:
            self._heartbeat.close()
            self._heartbeat = None
        for client in (self._guide, self._tendon):
            if client is not None:
                client.destroy()
        self._guide = self._tendon = None
        for stop in self._stops:
            self.destroy_client(stop)
        self._stops = []
        if self._events is not None:
            self.destroy_lifecycle_publisher(self._events)
            self._events = None

    # -- one trial, on the goal's own thread -----------------------------------------

    def _run_trial(self, goal: Goal) -> RunTrial.Result:
        asked = goal.request
        self._count += 1
        now_ns = self.get_clock().now().nanoseconds
        request = TrialRequest(
            protocol=asked.protocol,
            contact=asked.contact,
            object_label=asked.object_label,
            trial_id=asked.trial_id or f'trial-{now_ns // 1_000_000_000}-{self._count:04d}',
            session_id=asked.session_id,
            glide_speed_m_s=asked.glide_speed_m_s,
            hold_s=asked.hold_s,
        )
        steps = trial_steps(self.config, request)  # refuses, before anything moves
        self._request = request
        started = time.monotonic()
        phase = ''
        try:
            for step in steps:
                goal.check()
                if step.phase != phase:
                    phase = step.phase
                    self._announce(request, phase)
                    goal.feedback(phase=phase, elapsed_s=time.monotonic() - started)
                self._carry_out(step, request, goal)
        except Exception as error:
            self._contact.end()
            self._bring_to_rest(request)
            self._announce(request, TrialEvent.PHASE_ABORTED, str(error))
            end = GoalCanceled if isinstance(error, GoalCanceled) else GoalAborted
            message = f'trial {request.trial_id} ended in {phase}: {error}'
            raise end(message, trial_id=request.trial_id) from error
        self._announce(request, TrialEvent.PHASE_DONE)
        return RunTrial.Result(
            trial_id=request.trial_id,
            message=f'trial {request.trial_id} done after {time.monotonic() - started:.1f} s',
        )

    def _carry_out(
        self, step: GuideStep | TendonStep | WaitStep, request: TrialRequest, goal: Goal
    ) -> None:
        if isinstance(step, WaitStep):
            end_s = time.monotonic() + step.duration_s
            while (left_s := end_s - time.monotonic()) > 0:
                goal.wait(min(left_s, POLL_S))
                goal.check()
                self._contact.check()
        elif isinstance(step, GuideStep):
            move = MoveGuide.Goal(position_m=step.position_m, speed_m_s=step.speed_m_s)
            self._call(self._guide, 'linear guide', move, goal)
        else:
            self._contact.end()
            self._call(self._tendon, 'tendon actuator', self._pull(step, request), goal)
            if step.displacement_m > 0:
                self._contact.begin(step.displacement_m)

    def _on_tendon_state(self, state: JointState) -> None:
        for displacement_m in state.position:
            self._contact.take(displacement_m)

    def _release(self) -> TendonStep:
        return TendonStep(TrialEvent.PHASE_RELEASE, 0.0, self.config.pull_speed_m_s)

    def _pull(self, step: TendonStep, request: TrialRequest) -> PullTendon.Goal:
        return PullTendon.Goal(
            displacement_m=step.displacement_m,
            speed_m_s=step.speed_m_s,
            contact=request.contact,
        )

    def _announce(self, request: TrialRequest, phase: str, message: str = '') -> None:
        event = TrialEvent(
            trial_id=request.trial_id,
            session_id=request.session_id,
            protocol=request.protocol,
            contact=request.contact,
            object_label=request.object_label,
            phase=phase,
            message=message,
            glide_speed_m_s=glide_speed_m_s(self.config, request),
            pull_speed_m_s=self.config.pull_speed_m_s,
            pull_displacement_m=self.config.displacement_m(request.contact),
            simulated=self.config.simulated,
        )
        event.header.stamp = self.get_clock().now().to_msg()
        if self._events is not None:
            self._events.publish(event)

    def _call(
        self,
        client: Any,
        who: str,
        message: Any,
        goal: Goal | None,
        timeout_s: float = math.inf,
    ) -> Any:
        """Send one action goal and wait for its end; raise unless it succeeded.

        Without a trial's ``goal`` the call cannot be cancelled: it is part of
        coming to rest.
        """
        if not client.wait_for_server(timeout_sec=self.config.server_timeout_s):
            raise GoalAborted(f'the {who} does not answer; is its node active?')
        answer = send(self, lambda: client.send_goal_async(message))
        try:
            handle = answer.result(self.config.server_timeout_s)
        except concurrent.futures.TimeoutError:
            answer.add_done_callback(_cancel_late_goal)
            raise GoalAborted(f'the {who} did not take the goal') from None
        if not handle.accepted:
            raise GoalAborted(f'the {who} rejected the goal')
        result = send(self, handle.get_result_async)
        deadline_s = time.monotonic() + timeout_s
        end: Exception | None = None  # why the device has been asked to end its goal
        while not concurrent.futures.wait([result], POLL_S).done:
            if goal is not None and end is None:
                try:
                    goal.check()
                    self._contact.check()
                except (GoalAborted, GoalCanceled) as error:
                    end = error
                    send(self, handle.cancel_goal_async)
                    deadline_s = time.monotonic() + self.config.server_timeout_s
            if not self.context.ok():
                raise GoalAborted('the process is ending')
            if not client.server_is_ready():
                raise end or GoalAborted(f'the {who} went away; is its node running?')
            if time.monotonic() > deadline_s:
                raise end or GoalAborted(f'the {who} did not end its goal; see its log')
        reply = result.result()
        if end is not None:
            raise end
        if goal is not None:
            goal.check()
        if reply.status != GoalStatus.STATUS_SUCCEEDED:
            raise GoalAborted(f'{who}: {reply.result.message}')
        return reply.result

    def _ask_to_stop(self) -> list[Any]:
        return [
            stop.call_async(Trigger.Request()) for stop in self._stops if stop.service_is_ready()
        ]

    def _bring_to_rest(self, request: TrialRequest) -> None:
        """Stop both devices, then release the tendon."""
        for future in self._ask_to_stop():
            wait_for(future, 1.0)
        for attempt in range(RELEASE_ATTEMPTS):
            if attempt:
                time.sleep(RELEASE_PAUSE_S)
            problem = self._try_release(request)
            if not problem or self._tendon is None or not self._tendon.server_is_ready():
                break
        if problem:
            self.get_logger().error(f'the tendon could not be released: {problem}')

    def _try_release(self, request: TrialRequest) -> str:
        """Release the tendon; return what went wrong, or nothing."""
        seconds = self.config.displacement_m(request.contact) / self.config.pull_speed_m_s
        pull = self._pull(self._release(), request)
        timeout_s = seconds + self.config.server_timeout_s
        try:
            self._call(self._tendon, 'tendon actuator', pull, None, timeout_s)
        except Exception as error:  # whatever it is, the trial must still tell its end
            return str(error)
        return ''


class _Contact:
    """Whether the tendon is kept at the displacement that a trial has pulled it to.

    It counts as let go at half the displacement, once it has been seen at nine tenths:
    states that were measured before the pull ended may still arrive after it.
    """

    def __init__(self) -> None:
        self._displacement_m = math.inf
        self._was_seen = False
        self._is_lost = False

    def begin(self, displacement_m: float) -> None:
        self._was_seen = self._is_lost = False
        self._displacement_m = displacement_m

    def end(self) -> None:
        self._displacement_m = math.inf
        self._was_seen = self._is_lost = False

    def take(self, displacement_m: float) -> None:
        if displacement_m >= 0.9 * self._displacement_m:
            self._was_seen = True
        elif self._was_seen and displacement_m < 0.5 * self._displacement_m:
            self._is_lost = True

    def check(self) -> None:
        if self._is_lost:
            raise GoalAborted('the tendon actuator has let the tendon go; its log says why')


def _cancel_late_goal(answer: concurrent.futures.Future[Any]) -> None:
    if answer.exception() is None and answer.result().accepted:
        answer.result().cancel_goal_async()


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(TrialRunnerNode)
