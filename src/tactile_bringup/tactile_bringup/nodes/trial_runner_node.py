# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trial runner: executes a protocol with guide and tendon actuator."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import fields
import math
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.time import Time

from linear_guide_driver.config import REST_CYCLE_S
from linear_guide_driver.dynamixel.tendon_client import POSITION_TOLERANCE_M
from linear_guide_driver.grbl.guide_client import MotionTrack
from linear_guide_driver.motion_node import RigStop
from linear_guide_driver.safety import SLACK_M
from linear_guide_driver.stop_latch import StopLatch
from tactile_bringup.nodes.trial_devices import (
    ContactLost,
    POLL_S,
    REPORT_S,
    RunningTrial,
    StrainWatch,
    TrialDevice,
)
from tactile_bringup.trial_observation import find_glide_fault, GuideRest, TendonContact
from tactile_bringup.trial_protocols import (
    glide_speed_m_s,
    GuideStep,
    longest_trial_s,
    Step,
    TendonStep,
    trial_steps,
    TrialConfig,
    TrialRequest,
    WaitStep,
)
from tactile_msgs.action import MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.goals import Goal, GoalAborted, GoalRunner, wait_for
from tactile_ros.health import Heartbeat, Presence, ReadinessPublisher
from tactile_ros.periodic import Periodic
from tactile_ros.polling import PollingNode
from tactile_ros.qos import EVENTS
from tactile_ros.refusal import Refusal

CANCEL_S = 1.0
"""Longest wait for the guide's driver to answer a request to cancel its goals [s]."""

GUIDE_SILENCE_S = 1.5
"""Longest time without joint states of a guide at rest [s]; it publishes them every 0.2 s."""

TURN_S, HANG_S = 0.5, 1.2
"""Period of a timer that shows that the executor runs, and the time without a call of this timer
after which the executor is regarded as hanging [s]. The period is long, because each call takes
0.6 ms, and between trials this node does not command any motion."""

LOG_S, LOG_AFTER_S = 0.5, 10.0
"""Period at which missing conditions for a trial are checked, and time until they are logged
[s]."""

HOMINGS = {
    'home the guide': ('linear_guide/home', 'tactile_msgs/action/HomeGuide'),
    'home the tendon': ('tendon_actuator/home', 'tactile_msgs/action/HomeTendon'),
}
"""Homing actions that the log proposes if a message about a missing condition contains the key."""

RELEASE_ATTEMPTS = 3
RELEASE_PAUSE_S = 0.3
"""Pause between two attempts to slacken the tendon [s]. There are several attempts, because a
servo may not respond for a short time."""


class TrialRunnerNode(PollingNode):
    """Node that runs trials.

    It provides the action ``~/run_trial`` and publishes ``~/events``, ``~/ready`` and
    ``~/heartbeat``. The services ``~/stop`` and ``~/reset`` begin and end the stopped state of the
    rig.

    The stamp of a phase is taken from the observed motion: a glide begins when the guide moves, a
    hold when the tendon is at rest. A trial fails if a driver or the strain falls silent, if the
    observed motion differs from the commanded one, or if the runner itself did not run for more
    than ``heartbeat_timeout_s``.

    When a trial ends early, for any reason, the goals of guide and tendon are cancelled and the
    tendon is slackened. Nothing moves again without a new goal.

    Strain and joint states are polled only when they are needed: every `POLL_S` during a trial,
    and for ``~/ready``.
    """

    poll_s = None

    def __init__(self, node_name: str = 'trial_runner', **node_options: Any) -> None:
        super().__init__(node_name, TrialConfig, **node_options)
        self._runner: GoalRunner | None = None
        self._events: Any = None
        self._guide: TrialDevice | None = None
        self._tendon: TrialDevice | None = None
        self._strain: StrainWatch | None = None
        self._heartbeat: Heartbeat | None = None
        self._presence: Presence | None = None
        self._latch = StopLatch()
        self._rig_stop: RigStop | None = None
        self._executor_ran_s = 0.0  # last time that the timer ran on the executor
        self._ready: ReadinessPublisher | None = None
        self._readiness_log: Periodic | None = None
        self._began_s = math.inf  # time of the configuration; inf after the warning
        self._parts = ExitStack()  # destroys topics, services and timers in reverse order
        self._contact = TendonContact()
        self._rest = GuideRest()
        self._trial: RunningTrial | None = None
        self._count = 0

    def set_up(self, config: TrialConfig) -> None:
        self._rig_stop = RigStop(self, self._latch, self._answer_stop)
        self._parts.callback(self._rig_stop.close)
        self._events = self.create_lifecycle_publisher(TrialEvent, '~/events', EVENTS)
        self._parts.callback(self.destroy_lifecycle_publisher, self._events)
        guide = ('linear_guide', MoveGuide, 'move', config)
        self._guide = TrialDevice(self, *guide, self._rest.take)
        self._parts.callback(self._guide.close)
        tendon = ('tendon_actuator', PullTendon, 'pull', config)
        self._tendon = TrialDevice(self, *tendon, self._contact.take)
        self._parts.callback(self._tendon.close)
        self._strain = StrainWatch(self, config.strain_timeout_s)
        self._parts.callback(self._strain.close)
        self._runner = GoalRunner(
            self,
            RunTrial,
            '~/run_trial',
            self._run_trial,
            find_refusal=self._find_refusal,
        )
        self._heartbeat = Heartbeat(self, lambda: self.is_active)
        self._parts.callback(self._heartbeat.close)
        self._presence = Presence(self)
        self._parts.callback(self._presence.close)
        self._ready = ReadinessPublisher(self, self._find_missing)
        self._parts.callback(self._ready.close)
        self._began_s = time.monotonic()
        self._readiness_log = self.call_every(LOG_S, self._log_readiness)
        self._parts.callback(self._readiness_log.cancel)
        self._note_executor()  # the timer's first call may be late
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        turns = self.create_timer(TURN_S, self._note_executor, clock=clock)
        self._parts.callback(self.destroy_timer, turns)
        beats = self.call_every(REST_CYCLE_S, self._beat_for_executor)
        self._parts.callback(beats.cancel)

    def stop(self) -> None:
        if self._runner is not None and self._runner.is_busy:
            self._runner.end_goal()
            # The goals are cancelled on this thread, because the thread of the trial cannot send
            # requests while this thread is busy, for example during a shutdown of the node.
            for device in (self._guide, self._tendon):
                if device is not None:
                    device.cancel_goals()

    def tear_down(self) -> None:
        if self._runner is not None:
            # The timeout is short, because the trial gets no answers while the executor waits.
            self._runner.close(timeout_s=0.5)
            if self._runner.is_busy and self._trial and self._tendon and self.context.ok():
                self._tendon.send_unwatched(self._pull(self._trial.request))
            self._runner = None
        self._parts.close()
        self._ready = self._heartbeat = self._presence = None
        self._readiness_log = self._rig_stop = None
        self._strain = self._guide = self._tendon = self._events = None

    def _find_refusal(self) -> Refusal | None:
        """Return why no trial can be accepted now, or None."""
        if stop := self._find_stop():
            return stop
        if not self.is_active:
            return Refusal('The trial runner is not active', 'activate its node')
        return None

    def _find_stop(self) -> Refusal | None:
        """Return why the rig is stopped, or None."""
        return None if self._rig_stop is None else self._rig_stop.find_refusal()

    def _find_rival(self) -> Refusal | None:
        """Return a refusal if there is a second trial runner, otherwise None."""
        return None if self._presence is None else self._presence.rivals.find_loss()

    @staticmethod
    def _answer_stop() -> tuple[bool, str]:
        return True, 'The rig is stopped: a running trial ends, and its tendon is slackened.'

    def _find_missing(self) -> list[str]:
        """Return a sentence for each reason why no trial can be accepted."""
        if refusal := self._find_refusal():
            return [str(refusal)]
        if self._runner is not None and self._runner.is_busy:
            return ['A trial is running; wait for it to end or cancel it.']
        return self._find_missing_parts()

    def _find_missing_parts(self) -> list[str]:
        guide, tendon, strain = self._guide, self._tendon, self._strain
        if guide is None or tendon is None or strain is None:
            return ['The trial runner is not configured; configure its node.']
        parts = [
            self._find_stop(),  # first, because it processes waiting messages
            self._find_rival(),
            *guide.find_missing(),
            *tendon.find_missing(),
            strain.find_silence(),
        ]
        return list(dict.fromkeys(str(part) for part in parts if part))

    def _log_readiness(self) -> None:
        """Log once that trials can run.

        If they cannot run after `LOG_AFTER_S`, log the missing conditions once.
        """
        missing, log = None if self._ready is None else self._ready.missing, self._readiness_log
        if missing is None or log is None:
            return
        if self._runner is not None and self._runner.is_busy:
            log.cancel()  # a running trial shows that the node was ready
        elif not missing:
            self.get_logger().info('ready for trials')
            log.cancel()
        elif time.monotonic() - self._began_s > LOG_AFTER_S:
            self._began_s = math.inf
            text = ' '.join(missing)
            commands = [
                f'ros2 action send_goal {self.resolve_service_name(name)} {kind} "{{}}"'
                for words, (name, kind) in HOMINGS.items()
                if words in text
            ]
            self.get_logger().warning(' '.join(['not ready for trials:', text, *commands]))

    # -- heartbeat -------------------------------------------------------------------

    def _beat_for_executor(self) -> None:
        """Publish the heartbeat if the executor runs and no trial publishes it.

        This is called periodically on another thread.
        """
        is_watched = self._trial is not None and self._trial.is_watched
        if not is_watched and time.monotonic() - self._executor_ran_s < HANG_S:
            self._beat()

    def _note_executor(self) -> None:
        self._executor_ran_s = time.monotonic()

    def _beat(self) -> None:
        heartbeat = self._heartbeat
        if heartbeat is not None:
            heartbeat.beat()

    # -- one trial, on the goal's own thread -----------------------------------------

    def _run_trial(self, goal: Goal) -> RunTrial.Result:
        self._count += 1
        asked = {f.name: getattr(goal.request, f.name) for f in fields(TrialRequest)}
        trial_id = asked['trial_id'] or f'trial-{self._now_ns() // 10**9}-{self._count:04d}'
        request = TrialRequest(**{**asked, 'trial_id': trial_id})
        steps = trial_steps(self.config, request)  # may raise, before anything moves
        longest_s = longest_trial_s(self.config, request)
        self._trial = trial = RunningTrial(request, goal, longest_s)
        try:
            for step in steps:
                goal.check()
                is_new = step.phase != trial.phase
                trial.phase = step.phase
                self._carry_out(step, trial, is_new)
        except Exception as error:
            trial.is_watched = False
            self._end_early(trial, error)
        trial.is_watched = False
        self._announce(trial, TrialEvent.PHASE_DONE)
        return RunTrial.Result(
            message=f'trial {request.trial_id} done after {trial.elapsed_s:.1f} s',
            **trial.numbers(),
        )

    def _carry_out(self, step: Step, trial: RunningTrial, is_new: bool) -> None:
        if isinstance(step, WaitStep):
            if is_new:
                self._begin(trial, self._contact.rest_ns)
            end_s = time.monotonic() + step.duration_s
            self._wait_until(lambda: time.monotonic() >= end_s, trial)
        elif isinstance(step, GuideStep):
            self._carry_out_guide(step, trial, is_new)
        else:
            self._carry_out_tendon(step, trial, is_new)

    def _carry_out_guide(self, step: GuideStep, trial: RunningTrial, is_new: bool) -> None:
        assert self._guide is not None
        self._rest.end()
        move = MoveGuide.Goal(
            position_m=step.position_m,
            speed_m_s=step.speed_m_s,
            allow_taut=step.phase == TrialEvent.PHASE_GLIDE,
        )
        if step.phase == TrialEvent.PHASE_APPROACH:
            self._begin(trial, None)
            self._wait_until_ready(trial)
            trial.has_moved = True
            self._slacken(trial)
            result = self._guide.call(move, lambda: self._check(trial))
            self._rest.begin(result.position_m)
            return
        track = self._guide.track(step.position_m, step.speed_m_s)
        result = self._move(self._guide, move, track, trial, is_new)
        if step.phase == TrialEvent.PHASE_GLIDE:
            summary = track.summarise(result.lag_s)
            if summary is not None:
                trial.glide_speed_m_s, trial.glide_lag_s = summary
            if fault := find_glide_fault(summary, step.speed_m_s, self.config):
                raise GoalAborted(str(fault))
            trial.glide_end_ns = track.end_ns

    def _slacken(self, trial: RunningTrial) -> None:
        """Slacken the tendon if it is taut, so that the guide does not drag the finger."""
        tendon = self._tendon
        assert tendon is not None
        if tendon.position_m is not None and tendon.position_m > SLACK_M:
            tendon.call(self._pull(trial.request), lambda: self._check(trial))

    def _carry_out_tendon(self, step: TendonStep, trial: RunningTrial, is_new: bool) -> None:
        assert self._tendon is not None
        pull = self._pull(trial.request, step.displacement_m)
        track = self._tendon.track(step.displacement_m, step.speed_m_s)
        if step.displacement_m > 0:
            self._contact.begin(step.displacement_m, self.config.displacement_tolerance_m)
            trial.needs_strain = True
            self._move(self._tendon, pull, track, trial, is_new)
            # The actuator reports the end of a pull within its tolerance, when the tendon may
            # still move. Because the servo rounds speeds to its units, a slow pull may be a third
            # slower than commanded.
            timeout_s = REPORT_S + 1.5 * POSITION_TOLERANCE_M / step.speed_m_s
            if not self._wait_until(lambda: self._contact.rest_ns is not None, trial, timeout_s):
                raise GoalAborted(
                    'the tendon did not come to rest at its displacement; check the diagnostics '
                    'of the tendon actuator'
                )
        else:
            trial.displacement_error_m = self._contact.error_m
            self._contact.end()
            self._rest.end()
            if is_new and trial.glide_end_ns is not None:
                self._begin(trial, trial.glide_end_ns)
                is_new = False
            self._move(self._tendon, pull, track, trial, is_new)

    def _move(
        self,
        device: TrialDevice,
        message: Any,
        track: MotionTrack,
        trial: RunningTrial,
        is_new: bool,
    ) -> Any:
        """Execute one motion. If ``is_new`` is True, its phase begins when motion is observed."""
        if is_new and not track.is_motion:
            self._begin(trial, None)
            is_new = False

        def begin() -> bool:
            nonlocal is_new
            if is_new and track.start_ns is not None:
                self._begin(trial, track.start_ns)
                is_new = False
            return not is_new

        def check() -> None:
            begin()
            self._check(trial)

        result = device.call(message, check)
        if not self._wait_until(begin, trial, REPORT_S):
            raise GoalAborted(
                f'the motion was not observed on {device.name}/joint_states; check the '
                'diagnostics of its node'
            )
        return result

    # -- reasons to end a trial --------------------------------------------------------

    def _wait_until_ready(self, trial: RunningTrial) -> None:
        deadline_s = time.monotonic() + self.config.server_timeout_s
        while missing := self._find_missing_parts():
            if self._latch.state.is_stopped or time.monotonic() > deadline_s:
                raise GoalAborted(' '.join(missing))
            trial.goal.wait(POLL_S)
            trial.goal.check()
        trial.look()

    def _wait_until(
        self, is_done: Callable[[], bool], trial: RunningTrial, timeout_s: float = float('inf')
    ) -> bool:
        """Check the trial until ``is_done()`` is True; return False after ``timeout_s`` [s]."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            self._check(trial)  # first, so that an unsupervised phase does not succeed
            if is_done():
                return True
            if time.monotonic() > deadline_s:
                return False
            trial.goal.wait(POLL_S)

    def _check(self, trial: RunningTrial) -> None:
        """Raise if the trial must end, otherwise publish the heartbeat."""
        try:
            self._find_end(trial)
        except Exception:
            # From now on, the executor publishes the heartbeat, because ending a trial may take
            # longer than the time after which a heartbeat counts as lost.
            trial.is_watched = False
            raise
        trial.is_watched = True
        self._beat()

    def _find_end(self, trial: RunningTrial) -> None:
        """Raise an exception if there is a reason to end the trial."""
        self.poll_now()
        # Checked first, because a pause of this process may be the cause of a cancellation.
        trial.look(self.config.heartbeat_timeout_s)
        trial.goal.check()
        if trial.elapsed_s > trial.longest_s:
            raise GoalAborted(
                f"the trial did not end within {trial.longest_s:.0f} s; check the drivers' logs"
            )
        try:
            self._find_loss(trial)
        except GoalAborted:
            # If this process was paused, report the pause instead of the loss.
            trial.look(self.config.heartbeat_timeout_s)
            raise

    def _find_loss(self, trial: RunningTrial) -> None:
        """Raise if the rig is stopped, or if a needed node or topic is lost."""
        if refusal := self._find_stop() or self._find_rival():
            raise GoalAborted(str(refusal))
        for device in (self._guide, self._tendon):
            if device is not None:
                device.check()
        if loss := self._contact.find_loss():
            raise ContactLost(str(loss))
        if motion := self._rest.find_motion():
            raise GoalAborted(str(motion))
        guide = self._guide if trial.needs_strain else None
        if guide is not None and (silence := guide.find_silence(GUIDE_SILENCE_S)):
            raise GoalAborted(str(silence))
        watched = (self._strain, self._tendon) if trial.needs_strain else ()
        for source in watched:
            if source is not None and (silence := source.find_silence()):
                raise GoalAborted(str(silence))

    def _end_early(self, trial: RunningTrial, error: Exception) -> None:
        """Bring the rig to rest and raise `GoalAborted`."""
        trial.displacement_error_m = max(trial.displacement_error_m, self._contact.error_m)
        self._contact.end()
        self._rest.end()
        # The guide is stopped first, so that it is at rest before the tendon moves.
        guide = self._guide if trial.has_moved else None
        cancelled = None if guide is None else guide.cancel_goals()
        sentence = str(error)
        if isinstance(error, ContactLost) and self._tendon is not None:
            sentence = ' '.join([sentence, *self._tendon.wait_for_reasons()])
        self._announce(trial, TrialEvent.PHASE_ABORTED, message=sentence)
        if trial.has_moved:
            if cancelled is not None:
                wait_for(cancelled, CANCEL_S)
            self._release_tendon(trial.request)
        message = f'trial {trial.request.trial_id} ended in {trial.phase}: {sentence}'
        raise GoalAborted(message, **trial.numbers()) from error

    def _release_tendon(self, request: TrialRequest) -> None:
        tendon = self._tendon
        if tendon is None:
            return
        seconds = self.config.displacement_m(request.contact) / self.config.pull_speed_m_s
        problem: object = None
        for attempt in range(RELEASE_ATTEMPTS):
            if attempt:
                time.sleep(RELEASE_PAUSE_S)
            try:
                if problem := tendon.find_loss():
                    tendon.send(self._pull(request))
                    break
                timeout_s = seconds + self.config.server_timeout_s
                tendon.call(self._pull(request), timeout_s=timeout_s)
                return
            except Exception as error:  # the end of the trial must be reported in any case
                problem = error
        self.get_logger().error(f'the tendon could not be slackened: {problem}')

    # -- messages ------------------------------------------------------------------------

    def _pull(self, request: TrialRequest, displacement_m: float = 0.0) -> PullTendon.Goal:
        speed_m_s = self.config.pull_speed_m_s
        return PullTendon.Goal(
            displacement_m=displacement_m, speed_m_s=speed_m_s, contact=request.contact
        )

    def _begin(self, trial: RunningTrial, stamp_ns: int | None) -> None:
        """Publish the start of the trial's present phase at ``stamp_ns`` [ns], or now."""
        self._announce(trial, trial.phase, stamp_ns)
        trial.goal.feedback(phase=trial.phase, elapsed_s=trial.elapsed_s)

    def _announce(
        self, trial: RunningTrial, phase: str, stamp_ns: int | None = None, message: str = ''
    ) -> None:
        request = trial.request
        event = TrialEvent(
            trial_id=request.trial_id,
            session_id=request.session_id,
            mounting_id=request.mounting_id,
            protocol=request.protocol,
            contact=request.contact,
            object_label=request.object_label,
            phase=phase,
            message=message,
            glide_speed_m_s=glide_speed_m_s(self.config, request),
            pull_speed_m_s=self.config.pull_speed_m_s,
            pull_displacement_m=self.config.displacement_m(request.contact),
            simulated=self._strain is not None and self._strain.is_simulated,
        )
        # The stamps of events must not decrease, even if the drivers have slightly other clocks.
        trial.stamp_ns = max(trial.stamp_ns, self._now_ns() if stamp_ns is None else stamp_ns)
        event.header.stamp = Time(nanoseconds=trial.stamp_ns).to_msg()
        if self._events is not None:
            self._events.publish(event)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)
