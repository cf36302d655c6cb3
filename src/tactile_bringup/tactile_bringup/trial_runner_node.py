# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The trial runner: carries out a protocol on the guide and the tendon."""

from __future__ import annotations

import threading
import time
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.task import Future
from std_srvs.srv import Trigger
from tactile_msgs.action import MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import TrialEvent

from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import (
    GuideStep,
    TendonStep,
    TrialRequest,
    WaitStep,
    glide_speed_m_s,
    trial_steps,
)
from tactile_ros.goals import Goal, GoalAborted, GoalCanceled, GoalRunner
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import run_node
from tactile_ros.qos import EVENTS


class TrialRunnerNode(TactileNode):
    """Runs trials: action ``~/run_trial``, events on ``~/events``.

    When a trial ends early, for whatever reason, guide and tendon are stopped
    and the tendon is released; nothing moves again without a new goal.
    """

    def __init__(self, node_name: str = 'trial_runner', **node_options: Any) -> None:
        super().__init__(node_name, TrialConfig, **node_options)
        self._runner: GoalRunner | None = None
        self._events: Any = None
        self._guide: ActionClient | None = None
        self._tendon: ActionClient | None = None
        self._stops: list[Any] = []
        self._count = 0

    def set_up(self, config: TrialConfig) -> None:
        self._events = self.create_lifecycle_publisher(TrialEvent, '~/events', EVENTS)
        self._guide = ActionClient(self, MoveGuide, 'linear_guide/move')
        self._tendon = ActionClient(self, PullTendon, 'tendon_actuator/pull')
        self._stops = [
            self.create_client(Trigger, 'linear_guide/stop'),
            self.create_client(Trigger, 'tendon_actuator/stop'),
        ]
        self._runner = GoalRunner(
            self,
            RunTrial,
            '~/run_trial',
            self._run_trial,
            accepting=lambda: '' if self.is_active else 'the trial runner is not active',
        )

    def stop(self) -> None:
        if self._runner is not None:
            self._runner.end_goal()

    def tear_down(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None
        for client in (self._guide, self._tendon):
            if client is not None:
                client.destroy()
        self._guide = self._tendon = None
        for stop in self._stops:
            self.destroy_client(stop)
        self._stops = []
        if self._events is not None:
            self.destroy_publisher(self._events)
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
        started = time.monotonic()
        phase = ''
        try:
            for step in trial_steps(self.config, request):
                goal.check()
                if step.phase != phase:
                    phase = step.phase
                    self._announce(request, phase)
                    goal.feedback(phase=phase, elapsed_s=time.monotonic() - started)
                self._carry_out(step, request, goal)
        except Exception as error:
            self._bring_to_rest(request)
            self._announce(request, TrialEvent.PHASE_ABORTED, str(error))
            if isinstance(error, GoalCanceled):
                raise
            raise GoalAborted(f'trial {request.trial_id} ended in {phase}: {error}') from error
        self._announce(request, TrialEvent.PHASE_DONE)
        return RunTrial.Result(
            trial_id=request.trial_id,
            message=f'trial {request.trial_id} done after {time.monotonic() - started:.1f} s',
        )

    def _carry_out(
        self, step: GuideStep | TendonStep | WaitStep, request: TrialRequest, goal: Goal
    ) -> None:
        if isinstance(step, WaitStep):
            if goal.wait(step.duration_s):
                goal.check()
        elif isinstance(step, GuideStep):
            move = MoveGuide.Goal(position_m=step.position_m, speed_m_s=step.speed_m_s)
            self._call(self._guide, 'linear guide', move, goal)
        else:
            self._call(self._tendon, 'tendon actuator', self._pull(step, request), goal)

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
            simulated=self.config.simulated,
        )
        event.header.stamp = self.get_clock().now().to_msg()
        if self._events is not None:
            self._events.publish(event)

    def _call(self, client: Any, who: str, message: Any, goal: Goal | None) -> Any:
        """Send one action goal and wait for its end; raise unless it succeeded.

        Without a trial's ``goal`` the call cannot be cancelled: it is part of
        coming to rest.
        """
        if not client.wait_for_server(timeout_sec=self.config.server_timeout_s):
            raise GoalAborted(f'the {who} does not answer; is its node active?')
        handle = wait_for(client.send_goal_async(message), self.config.server_timeout_s)
        if handle is None:
            raise GoalAborted(f'the {who} did not take the goal')
        if not handle.accepted:
            raise GoalAborted(f'the {who} rejected the goal')
        result_future = handle.get_result_async()
        ended = threading.Event()
        result_future.add_done_callback(lambda _: ended.set())
        cancelled = False
        while not ended.wait(0.02):
            if goal is not None and goal.end_requested and not cancelled:
                cancelled = True
                handle.cancel_goal_async()
            if not self.context.ok():
                raise GoalAborted('the process is ending')
        reply = result_future.result()
        if goal is not None:
            goal.check()
        if reply.status != GoalStatus.STATUS_SUCCEEDED:
            raise GoalAborted(f'{who}: {reply.result.message}')
        return reply.result

    def _bring_to_rest(self, request: TrialRequest) -> None:
        """Stop both devices, then release the tendon."""
        pending = [
            stop.call_async(Trigger.Request()) for stop in self._stops if stop.service_is_ready()
        ]
        for future in pending:
            wait_for(future, 1.0)
        try:
            release = TendonStep(TrialEvent.PHASE_RELEASE, 0.0, self.config.pull_speed_m_s)
            self._call(self._tendon, 'tendon actuator', self._pull(release, request), None)
        except Exception as error:
            self.get_logger().error(f'the tendon could not be released: {error}')


def wait_for(future: Future, timeout_s: float) -> Any:
    """Block this thread, not the executor's, until the future is done; None on time-out."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not future.done() and not done.wait(timeout_s):
        return None
    return future.result()


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(TrialRunnerNode)
