# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""State of a running trial, and access to guide, tendon actuator and strain."""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
from contextlib import suppress
import math
import time
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.time import Time
from sensor_msgs.msg import JointState

from linear_guide_driver.config import REST_REPORT_S
from linear_guide_driver.grbl.guide_client import MotionTrack
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_msgs.msg import Readiness, StrainBlock
from tactile_ros.clock_watch import boot_time_s
from tactile_ros.goal_client import GoalClient, GoalLostError, SentGoal
from tactile_ros.goals import Goal, GoalAborted, GoalCanceled
from tactile_ros.health import HeartbeatWatch, watch_rivals
from tactile_ros.polling import PollingNode
from tactile_ros.qos import LATEST, NEWEST, STREAM
from tactile_ros.refusal import Refusal
from tactile_ros.strain import NOT_LIVE


class ContactLost(GoalAborted):
    """The tendon has left its commanded displacement, so the fingertip may have lost contact."""


class RunningTrial:
    """State of a running trial, and the numbers for its result.

    While ``is_watched`` is True, the trial's thread checks the trial repeatedly and publishes the
    runner's heartbeat.
    """

    def __init__(self, request: TrialRequest, goal: Goal, longest_s: float) -> None:
        self.request, self.goal, self.longest_s = request, goal, longest_s
        self.phase = ''
        self.stamp_ns = 0  # stamp of the last event
        self.has_moved = self.needs_strain = self.is_watched = False
        self.glide_end_ns: int | None = None
        self.glide_speed_m_s = self.glide_lag_s = self.displacement_error_m = 0.0
        self._started_s, self._looked_s = time.monotonic(), boot_time_s()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._started_s

    def look(self, most_s: float = math.inf) -> None:
        """Record that the trial is being checked now.

        Raises `GoalAborted` if the last check is more than ``most_s`` [s] ago, for example
        because the process was stopped or the computer was overloaded.
        """
        now_s = boot_time_s()  # includes the time of a suspended computer
        away_s, self._looked_s = now_s - self._looked_s, now_s
        if away_s > most_s:
            raise GoalAborted(
                f'the trial runner did not run for {away_s:.2f} s in the {self.phase}, so the '
                f'trial was not supervised; heartbeat_timeout_s allows {most_s:g} s. Repeat the '
                'trial, and check the load of the computer'
            )

    def numbers(self) -> dict[str, Any]:
        """Return the fields of the result that describe the trial's motion."""
        return {
            'trial_id': self.request.trial_id,
            'glide_speed_m_s': self.glide_speed_m_s,
            'glide_lag_s': self.glide_lag_s,
            'displacement_error_m': self.displacement_error_m,
        }


POLL_S = 0.02
"""Period at which a waiting function checks whether the trial must end [s]."""

REPORT_S = 0.5
"""Joint states of a motion may arrive this long after the result of its goal [s]."""

TRACK_S = 2 * REPORT_S
"""Time after the end of a goal during which joint states still belong to its motion [s]."""

REASON_S = 0.3
"""Longest wait for a driver to publish why it is not ready [s]; it checks this at 5 Hz."""


class TrialDevice:
    """Access to one motion driver: its action, heartbeat and reports.

    Parameters
    ----------
    node : PollingNode
        Node that polls joint states. An executor on another thread than the caller's must spin
        it.
    name : str
        Name of the driver's node.
    action_type
        Type of the action ``name/verb``.
    verb : str
        Name of the action.
    config : TrialConfig
        Timeouts.
    on_state : callable
        Called with stamp [ns], position [m] and speed [m/s] of each joint state.
    """

    def __init__(
        self,
        node: PollingNode,
        name: str,
        action_type: Any,
        verb: str,
        config: TrialConfig,
        on_state: Callable[[int, float, float], None] = lambda *_: None,
    ) -> None:
        self._node, self.name, self._title = node, name, name.replace('_', ' ')
        self._config, self._on_state = config, on_state
        self._heartbeat = HeartbeatWatch(node, f'{name}/heartbeat', config.heartbeat_timeout_s)
        self._rivals = watch_rivals(node, name)
        self._readiness: Readiness | None = None
        self._position_m: float | None = None
        self._reported_s = -math.inf  # arrival of the last joint state
        self._left: SentGoal | None = None  # an abandoned goal
        self._left_s = -math.inf  # time at which it was abandoned
        self._track: MotionTrack | None = None
        self._track_end_s = -math.inf  # later joint states do not belong to the track
        self._goals = GoalClient(node, action_type, f'{name}/{verb}')
        self._cancel = node.create_client(CancelGoal, f'{name}/{verb}/_action/cancel_goal')
        self._ready_subscription = node.create_subscription(
            Readiness, f'{name}/ready', self._on_ready, LATEST
        )
        self._states = node.poll(JointState, f'{name}/joint_states', self._on_joint_state, STREAM)

    def close(self) -> None:
        """Destroy clients and subscriptions."""
        self._heartbeat.close()
        self._rivals.close()
        self._goals.close()
        self._node.destroy_client(self._cancel)
        self._node.unpoll(self._states)
        self._node.destroy_subscription(self._ready_subscription)

    # -- availability ------------------------------------------------------------------------

    def find_missing(self) -> list[str]:
        """Return a sentence for each reason why the driver does not accept goals."""
        if not self._goals.server_is_ready():
            return [f'The {self._title} does not answer; start and activate its node.']
        if loss := self.find_loss():
            return [str(loss), *self._reasons()]
        if self._is_left_busy():
            return [f'The {self._title} is still executing its last goal; wait for its end.']
        if self._readiness is None and self._node.count_publishers(f'{self.name}/ready'):
            return [f'The {self._title} has not reported yet whether it is ready; check its log.']
        if missing := self._reasons():
            return missing
        if self._position_m is None:
            return [
                f'No position has arrived on {self.name}/joint_states yet; check the diagnostics '
                f'of the {self._title}.'
            ]
        return []

    def find_loss(self) -> Refusal | None:
        """Return a refusal if the heartbeat was lost or there are two drivers, otherwise None.

        A heartbeat that was never received does not count as lost. Two drivers are refused even
        if only one of them publishes a heartbeat, because both may answer a goal.
        """
        if rivals := self._rivals.find_loss():
            return rivals
        return self._heartbeat.find_loss() if self._heartbeat.was_heard else None

    def check(self) -> None:
        """Raise `GoalAborted` if `find_loss` returns a refusal.

        The message also contains the reasons why the driver is not ready, if it has published any.
        """
        if loss := self.find_loss():
            raise GoalAborted(' '.join([str(loss), *self._reasons()]))

    @property
    def position_m(self) -> float | None:
        """Last reported position [m]; None before the first report."""
        return self._position_m

    def find_silence(self, least_s: float = 0.0) -> Refusal | None:
        """Return a refusal if no joint states have arrived for too long, otherwise None.

        The limit is the longer of ``heartbeat_timeout_s`` and ``least_s`` [s].
        """
        timeout_s = max(self._config.heartbeat_timeout_s, least_s)
        if time.monotonic() - self._reported_s <= timeout_s:
            return None
        return Refusal(
            f'No position has arrived on {self.name}/joint_states for {timeout_s:g} s',
            f'check the diagnostics of the {self._title}',
        )

    def wait_for_reasons(self) -> list[str]:
        """Wait up to `REASON_S` for the driver's reasons why it is not ready; return them."""
        deadline_s = time.monotonic() + REASON_S
        while not self._reasons() and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
        return self._reasons()

    def _reasons(self) -> list[str]:
        return [] if self._readiness is None else list(self._readiness.missing)

    # -- motion --------------------------------------------------------------------------------

    def track(self, target_m: float, speed_m_s: float) -> MotionTrack:
        """Return a track, which records the joint states of the motion that is commanded next.

        `call` must follow immediately. The track ends `TRACK_S` after the end of this call. The
        position must be known, so `find_missing` must have returned no reasons.
        """
        assert self._position_m is not None
        now_s = time.monotonic()
        self._reported_s = max(self._reported_s, now_s + REST_REPORT_S)
        self._track_end_s = now_s + TRACK_S  # must be set before the track
        self._track = MotionTrack(self._position_m, target_m, speed_m_s)
        return self._track

    def cancel_goals(self) -> Any:
        """Request to cancel all goals of the action; return the future of the answer.

        Return None if the driver is not expected to answer. Unlike the driver's service
        ``~/stop``, this does not stop the rig.
        """
        if not self._cancel.service_is_ready():
            return None
        answer = self._cancel.call_async(CancelGoal.Request())  # an empty request is for all goals
        return None if self.find_loss() else answer

    def send(self, message: Any) -> None:
        """Send a goal without waiting for its end, for a driver whose heartbeat was lost."""
        self._leave(self._goals.send(message))

    def send_unwatched(self, message: Any) -> None:
        """Send a goal from the executor's thread, just before `close`; its result is ignored."""
        self._goals.send_unwatched(message)

    def call(
        self,
        message: Any,
        check: Callable[[], None] = lambda: None,
        timeout_s: float = math.inf,
    ) -> Any:
        """Send a goal and wait for its end; return the result.

        Parameters
        ----------
        message
            The goal.
        check : callable
            Called repeatedly. It ends the goal by raising `GoalAborted` or `GoalCanceled`.
        timeout_s : float
            Longest wait [s].

        Raises
        ------
        GoalAborted, GoalCanceled
            Unless the goal succeeded.
        """
        self._track_end_s = math.inf
        try:
            return self._run(message, check, time.monotonic() + timeout_s)
        finally:
            self._track_end_s = time.monotonic() + TRACK_S

    def _run(self, message: Any, check: Callable[[], None], deadline_s: float) -> Any:
        """Send a goal and wait for its end, see `call`; return the result."""
        if not self._goals.wait_for_server(self._config.server_timeout_s):
            raise GoalAborted(f'the {self._title} does not answer; check that its node is active')
        goal = self._goals.send(message)
        refusal = f'the {self._title} did not accept the goal; check its log'
        in_time_s = min(deadline_s, time.monotonic() + self._config.server_timeout_s)
        lateness = f'the {self._title} did not end its goal in time; check its log'
        try:
            self._wait(goal.taken, check, in_time_s, refusal)
            reply = self._wait(goal.end, check, deadline_s, lateness)
        except (GoalAborted, GoalCanceled):
            goal.cancel()
            if goal.taken.done():  # wait for its end, so that the next goal can be accepted
                end_s = time.monotonic() + self._config.server_timeout_s
                with suppress(GoalAborted):
                    self._wait(goal.end, lambda: None, end_s, lateness)
            self._leave(goal)
            raise
        check()
        if reply.status != GoalStatus.STATUS_SUCCEEDED:
            raise GoalAborted(f'{self._title}: {reply.result.message}')
        return reply.result

    def _leave(self, goal: SentGoal) -> None:
        """Record an abandoned goal, so that the next goal waits for its end."""
        self._left, self._left_s = goal, time.monotonic()

    def _is_left_busy(self) -> bool:
        """Return True while an abandoned goal still runs, for at most ``server_timeout_s``."""
        if self._left is None or self._left.end.done():
            return False
        return time.monotonic() - self._left_s < self._config.server_timeout_s

    def _wait(
        self,
        future: concurrent.futures.Future[Any],
        check: Callable[[], None],
        deadline_s: float,
        lateness: str,
    ) -> Any:
        """Return the result of a future.

        Raises `GoalAborted` with the message ``lateness`` after the deadline, or earlier if no
        result can be expected.
        """
        while not concurrent.futures.wait([future], POLL_S).done:
            check()
            if not self._node.context.ok():
                raise GoalAborted('the process is ending')
            try:
                self._check_wait(deadline_s, lateness)
            except GoalAborted:
                check()  # if the runner did not run, report this instead
                raise
        try:
            return future.result()
        except GoalLostError as error:
            raise GoalAborted(f'{self._title}: {error}') from None

    def _check_wait(self, deadline_s: float, lateness: str) -> None:
        """Raise `GoalAborted` after the deadline, or if the driver was lost."""
        if not self._goals.server_is_ready():
            raise GoalAborted(f'the {self._title} has disappeared; check that its node is running')
        if time.monotonic() > deadline_s:
            raise GoalAborted(lateness)
        self.check()

    # -- topics --------------------------------------------------------------------------------

    def _on_ready(self, readiness: Readiness) -> None:
        self._readiness = readiness

    def _on_joint_state(self, state: JointState, _: Any) -> None:
        if not state.position:
            return
        self._reported_s = time.monotonic()
        stamp_ns = Time.from_msg(state.header.stamp).nanoseconds
        self._position_m = state.position[0]
        if self._track is not None and time.monotonic() <= self._track_end_s:
            self._track.add(stamp_ns, state.position[0])
        self._on_state(stamp_ns, state.position[0], state.velocity[0] if state.velocity else 0.0)


class StrainWatch:
    """Detector of missing strain samples; it is updated when the node polls its topics."""

    def __init__(self, node: PollingNode, timeout_s: float) -> None:
        self._node, self._timeout_s = node, timeout_s
        self._heard_s = -math.inf
        self.is_simulated = False  # the newest samples are simulated
        self._blocks = node.poll(StrainBlock, 'tendon_sensor/strain', self._on_block, NEWEST)

    def close(self) -> None:
        """Destroy the subscription."""
        self._node.unpoll(self._blocks)

    def find_silence(self) -> Refusal | None:
        """Return a refusal if no valid samples have arrived for too long, otherwise None."""
        if time.monotonic() - self._heard_s <= self._timeout_s:
            return None
        return Refusal(
            f'No valid sample has arrived on tendon_sensor/strain for {self._timeout_s:g} s',
            'start the sensor node, and look at its diagnostics',
        )

    def _on_block(self, block: StrainBlock, _: Any) -> None:
        self.is_simulated = bool(block.status & StrainBlock.STATUS_SIMULATED)
        if block.tension_n and not block.status & NOT_LIVE:
            self._heard_s = time.monotonic()
