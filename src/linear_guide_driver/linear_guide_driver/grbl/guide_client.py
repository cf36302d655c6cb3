# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of the linear guide, which is the X axis of a Grbl 1.1 controller.

`LinearGuideClient` executes homing and moves by `Motions`. `_KnownPosition` keeps the position of
the guide, or the reason why it is unknown.

Grbl does not monitor its serial connection, and loses its position when it is reset during a
motion. Therefore:

- A move is sent in short pieces.
- Each move is followed by a dwell (pause). The move has ended when the dwell is answered with
  ``ok``; status reports do not show the end of a move.
- If the controller stalls in this dwell, with moves left in its queue, a cycle start continues it.
- To stop, a feed hold brakes the guide, and a reset follows once the guide is at rest.
- After any other reset or fault of the controller, the position is unknown until the guide is
  homed again.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from functools import partial
import logging
import statistics
import time
from typing import NamedTuple, TypeVar

from linear_guide_driver.config import LinearGuideConfig
from linear_guide_driver.errors import (
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
)
from linear_guide_driver.grbl import protocol as grbl
from linear_guide_driver.grbl.connection import GrblConnection
from linear_guide_driver.grbl.protocol import GuideSettings
from linear_guide_driver.motion import Motion, Motions
from linear_guide_driver.types import GuideState
from tactile_ros.refusal import Refusal

MOVED_M = 0.0002
"""Smallest displacement [m] that counts as motion, above the resolution and jitter of the axis."""

CRUISE_SHARE = 0.05
"""Fraction of the path, at each end, that is not assessed, because the speed changes there."""

START_REPORTS = 2
"""Number of reports during a motion from which its start is computed; one for a short motion."""

LEAST_REPORTS = 3
"""Smallest number of reports at full speed from which a motion can be assessed."""


NEAR_SWITCH_M = 0.002
"""If the position is known, the guide starts the homing cycle at this distance [m] from the rest
position of the last homing. The distance is short, but exceeds the error of the position."""


class MotionSummary(NamedTuple):
    """Speed and lag of a motion."""

    mean_speed_m_s: float  # slope of a line fitted to the reports at full speed [m/s]
    # Largest delay relative to a motion at the commanded speed [s]: the guide paused or was slow
    lag_s: float


class MotionTrack:
    """Position reports of one motion at a commanded speed.

    Reports must be added in one thread; the properties may be read in any thread.
    """

    def __init__(self, start_m: float, target_m: float, speed_m_s: float) -> None:
        self._start_m = start_m
        self._path_m = abs(target_m - start_m)
        self._sign = 1.0 if target_m >= start_m else -1.0
        self._speed_m_s = speed_m_s
        self._moving: list[tuple[int, float]] = []  # stamp [ns], covered path [m]
        self._is_over = False

    @property
    def is_motion(self) -> bool:
        """True if the path is long enough to be measured."""
        return self._path_m > 2 * MOVED_M

    def add(self, stamp_ns: int, position_m: float) -> None:
        """Add a report: its stamp [ns] and position [m]."""
        covered_m = self._sign * (position_m - self._start_m)
        if self._moving and stamp_ns == self._moving[-1][0]:
            return  # a repeated report
        if covered_m > self._path_m - MOVED_M:
            self._is_over = True
        elif covered_m > MOVED_M and not self._is_over:
            self._moving.append((stamp_ns, covered_m))

    @property
    def start_ns(self) -> int | None:
        """Start of the motion [ns]; None until there are enough reports.

        The start is extrapolated at the commanded speed. If the axis needs the time ``t`` to
        reach its speed, the result is up to ``t / 2`` after the true start.
        """
        first = self._starts(self._moving[:START_REPORTS])
        return min(first) if len(first) == START_REPORTS or (first and self._is_over) else None

    @property
    def end_ns(self) -> int | None:
        """Arrival at the target [ns], extrapolated from the last reports at full speed."""
        last = self._starts(self._cruise()[-LEAST_REPORTS:])
        return min(last) + round(self._path_m / self._speed_m_s * 1e9) if last else None

    def summarise(self, least_lag_s: float = 0.0) -> MotionSummary | None:
        """Return speed and lag, or None with fewer than `LEAST_REPORTS` reports at full speed.

        ``least_lag_s`` is a lower bound of the lag [s], known from the duration of the move.
        """
        cruise = self._cruise()
        if len(cruise) < LEAST_REPORTS:
            return None
        starts = self._starts(cruise)
        # A report that arrives late is no lag if later reports are in time. The last report is
        # excluded, because no later report can show this.
        lags_ns = [
            min(starts[index:]) - min(starts[: index + 1]) for index in range(len(starts) - 1)
        ]
        times_s = [(stamp - cruise[0][0]) / 1e9 for stamp, _ in cruise]
        line = statistics.linear_regression(times_s, [path_m for _, path_m in cruise])
        return MotionSummary(line.slope, max(least_lag_s, max(lags_ns) / 1e9))

    def _cruise(self) -> list[tuple[int, float]]:
        margin_m = max(MOVED_M, CRUISE_SHARE * self._path_m)
        return [r for r in list(self._moving) if margin_m <= r[1] <= self._path_m - margin_m]

    def _starts(self, reports: list[tuple[int, float]]) -> list[int]:
        """Return the start of the motion [ns] extrapolated from each report."""
        return [stamp - round(path_m / self._speed_m_s * 1e9) for stamp, path_m in reports]


POSITION_TOLERANCE_M = 0.0001
"""Largest distance [m] from its target at which a move may end: a few motor steps."""

REPLY_TIMEOUT_S = 2.0
"""Timeout [s] for the answer to a line that does not wait for motion."""

SLACK_S = 2.0
"""Time [s] added to the computed duration of a motion before it counts as failed."""

LATE_S = 0.15
"""A move counts as late if it takes longer than computed by more than this time [s]. The guide has
then paused, because pieces of the move arrived too late."""

HOME = 'home the guide'
HOMING = Refusal('the guide is being homed', 'wait until homing has ended')
HOMING_FAILED = Refusal('the last homing did not succeed', HOME)
NOT_HOMED = Refusal('the guide has not been homed since the driver connected', HOME)
"""Reasons why the position is unknown; other reasons are faults of controller and connection."""

_logger = logging.getLogger(__name__)

_Progress = TypeVar('_Progress')
MotionProgress = Generator[_Progress | None, None, GuideState]


class LinearGuideClient:
    """Blocking, thread-safe client of the guide's controller; one motion at a time.

    Parameters
    ----------
    config : LinearGuideConfig
        Connection and limits.
    on_state : callable
        Called on the reader thread with each `GuideState`, stamped by ``clock_ns``.
    clock_ns : callable
        Returns the present time [ns].
    on_trouble : callable
        Called on the reader thread with the reason when the position is lost.
    on_cycle : callable
        Called in each cycle of the reader thread, at least every 20 ms, or at rest
        every `REST_CYCLE_S`.

    Attributes
    ----------
    last_move : MotionSummary or None
        Speed and lag of the last finished move; None if there were too few reports.
    late_moves : int
        Number of moves that took longer than computed. Their speed was not constant.
    """

    def __init__(
        self,
        config: LinearGuideConfig,
        on_state: Callable[[GuideState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
        on_trouble: Callable[[str], None] = lambda _: None,
        on_cycle: Callable[[], None] = lambda: None,
    ) -> None:
        self._config, self._on_cycle = config, on_cycle
        self._position = _KnownPosition(config.travel_m, clock_ns, on_state, on_trouble)
        self._position.lose(NOT_HOMED)
        self._connection: GrblConnection | None = None
        self._settings: GuideSettings | None = None
        self._motions = Motions(
            busy='The guide is busy with another motion; stop it first.',
            not_begun='Stopped before the guide moved.',
        )
        self.last_move: MotionSummary | None = None
        self.late_moves = 0
        self._homed_m: float | None = None  # position at the end of the last homing [m]

    # -- state ---------------------------------------------------------------------------

    @property
    def state(self) -> GuideState | None:
        """The latest state; None before the first report."""
        last = self._position.last
        return None if last is None else last[0]

    @property
    def trouble(self) -> Refusal | None:
        """Why the guide must be homed before it can move, or None."""
        trouble = self._position.trouble
        if trouble is not None and self.is_lost:
            return Refusal(trouble.reason, f'check the cable, then {HOME}')
        return trouble

    @property
    def is_lost(self) -> bool:
        """True if the connection is lost; homing tries to re-establish it."""
        return self._connection is not None and self._connection.is_lost

    @property
    def identification(self) -> str:
        """Firmware and build of the controller; an empty string if not connected."""
        return self._connection.identification if self._connection else ''

    @property
    def garbage_lines(self) -> int:
        """Number of received lines that are not valid in Grbl's protocol."""
        return self._connection.garbage_lines if self._connection else 0

    # -- life ----------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the port, bring the controller to rest and check its settings.

        Raises
        ------
        DeviceConnectionError
            If no Grbl controller answers.
        DeviceRefusedError
            If a setting of the controller would silently change the motion.
        """
        self.close()
        self._connection, self._settings = self._open()

    def close(self) -> None:
        """Stop a running motion, then close the port; idempotent."""
        connection = self._connection
        if connection is None:
            return
        self.request_stop()
        # The stopped motion needs the connection until the guide is at rest.
        with self._motions.no_motion(SLACK_S + 3.0):
            self._connection = None
            connection.close()

    # -- motion --------------------------------------------------------------------------

    def home(
        self,
        on_elapsed: Callable[[float], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> GuideState:
        """Find the reference switch; return the state at rest.

        Re-establishes a lost connection. If the position is known, the guide first moves close to
        the switch, in short pieces like any move. The controller then executes its homing cycle,
        which needs no further commands.

        Parameters
        ----------
        on_elapsed : callable
            Called repeatedly with the time since the command [s].
        should_stop : callable
            Returns True if homing must stop. A controller in its homing cycle is then reset,
            because it ignores all other commands.

        Raises
        ------
        DeviceConnectionError
            If the connection cannot be re-established; also the errors of `move_to`.
        """
        stop = self._stop_homing  # also called if ``on_elapsed`` or ``should_stop`` raises
        motion = Motion(
            self._begin_homing,
            stop,
            self._fail_homing,
            stop,
            self._finish,
            lambda: None if self._is_in_homing_cycle else self._brake(),
        )
        return self._motions.run(motion, on_elapsed, should_stop)

    def move_to(
        self,
        position_m: float,
        speed_m_s: float,
        on_state: Callable[[GuideState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> GuideState:
        """Move to a position; return the state at rest.

        Parameters
        ----------
        position_m : float
            Target in the guide's frame [m].
        speed_m_s : float
            Speed [m/s].
        on_state : callable
            Called with each new state during the motion.
        should_stop : callable
            Returns True if the guide must brake; its position remains known.

        Raises
        ------
        MotionRefusedError
            If the guide is not homed or is busy, or a value is out of range. Nothing has moved.
        MotionFailedError
            If a fault ended the motion. The guide must be homed again.
        MotionStoppedError
            If ``should_stop`` or `request_stop` ended the motion. The position is still known.
        """
        motion = Motion(
            partial(self._begin_move, position_m, speed_m_s),
            partial(self._stop_move, f'{position_m:.4f} m'),
            partial(self._fail_move, position_m),
            partial(self._give_up, 'a move was abandoned'),
            self._finish,
            self._brake,
        )
        return self._motions.run(motion, on_state, should_stop)

    def request_stop(self) -> bool:
        """Brake immediately; return True if a motion is running.

        The motion ends once the guide is at rest.
        """
        return self._motions.request_stop()

    # -- homing --------------------------------------------------------------------------

    def _begin_homing(self) -> MotionProgress[float]:
        connection, settings = self._require_connection()
        if connection.is_lost:
            connection.close()
            self._connection, self._settings = connection, settings = self._open()

        def home() -> MotionProgress[float]:
            started_s = time.monotonic()
            if (near_m := self._find_near_switch()) is not None:
                speed_mm_s = settings.homing_seek_mm_min / 60
                speed_m_s = min(speed_mm_s / 1e3, self._config.max_speed_m_s)
                with closing(self._drive(near_m, speed_m_s)) as progress:
                    for _ in progress:
                        yield time.monotonic() - started_s
            self._position.trouble = HOMING
            connection.reset()
            timeout_s = settings.compute_homing_timeout_s() + SLACK_S
            with closing(connection.stream([grbl.HOME], timeout_s, answers_status=False)) as wakes:
                for _ in wakes:
                    yield time.monotonic() - started_s
            self._position.trouble = None  # cleared first, so that a fault from now on is kept
            report = connection.wait_report(REPLY_TIMEOUT_S)
            position_m = self._position.to_m(report)
            if position_m is None or not -1e-6 <= position_m <= self._config.travel_m + 1e-6:
                self._position.trouble = HOMING_FAILED
                raise MotionFailedError(
                    f'Homing ended at machine position {report.mpos_mm} mm, outside the travel of '
                    f'{self._config.travel_m} m; check the settings $23, $27 and $130.'
                )
            self._homed_m = position_m
            return self._to_rest_state(report)

        return home()

    def _find_near_switch(self) -> float | None:
        """Return a position near the switch [m].

        Return None if the position of the switch is unknown, or the guide is closer to it.
        """
        state, homed_m = self.state, self._homed_m
        if homed_m is None or state is None or state.position_m is None:
            return None
        side = 1 if homed_m < self._config.travel_m / 2 else -1  # away from the switch
        near_m = homed_m + side * NEAR_SWITCH_M
        return near_m if side * (state.position_m - near_m) > 0 else None

    @property
    def _is_in_homing_cycle(self) -> bool:
        return self._position.trouble == HOMING

    def _stop_homing(self) -> str:
        if not self._is_in_homing_cycle:  # still on the way to the switch
            return self._stop_move('the reference switch')
        self._position.trouble = HOMING_FAILED
        self._require_connection()[0].reset()  # only a reset ends a homing cycle
        return 'Homing was stopped; home the guide before the next move.'

    def _fail_homing(self, reason: str) -> str:
        if not self._is_in_homing_cycle:
            self._give_up(reason)
        self._position.lose(HOMING_FAILED)
        return f'Homing failed: {reason}.'

    # -- moves ---------------------------------------------------------------------------

    def _begin_move(self, position_m: float, speed_m_s: float) -> MotionProgress[GuideState]:
        self._require_connection()
        if not 0.0 <= position_m <= self._config.travel_m:
            raise MotionRefusedError(
                f'Position {position_m} m is outside the travel of 0 to {self._config.travel_m} m.'
            )
        if not 0.0 < speed_m_s <= self._config.max_speed_m_s:
            raise MotionRefusedError(
                f'Speed {speed_m_s} m/s must be above 0 and at most '
                f'{self._config.max_speed_m_s} m/s.'
            )
        state = self.state
        if self._position.trouble or state is None or state.position_m is None:
            trouble = self.trouble or Refusal('no report yet', HOME)
            raise MotionRefusedError(f'The position is unknown: {trouble}')
        return self._drive(position_m, speed_m_s)

    def _drive(self, position_m: float, speed_m_s: float) -> MotionProgress[GuideState]:
        """Move from a known position in short pieces; return the state at rest."""
        connection, settings = self._require_connection()
        state = self.state
        assert state is not None
        assert state.position_m is not None
        start_m = state.position_m
        self._position.direction = 1 if position_m >= start_m else -1
        track = MotionTrack(start_m, position_m, speed_m_s)
        expected_s = settings.compute_move_duration_s(position_m - start_m, speed_m_s)
        piece_s = grbl.compute_piece_s(self._config.run_on_s, connection.planner_blocks)
        start_mm, end_mm = ((x - self._config.travel_m) * 1e3 for x in (start_m, position_m))
        pieces = grbl.encode_pieces(start_mm, end_mm, speed_m_s * 1e3, piece_s)
        started_s = time.monotonic()
        connection.reset_override()
        with closing(connection.stream([grbl.MODES], REPLY_TIMEOUT_S)) as wakes:
            yield from wakes
        with closing(connection.stream(pieces, expected_s + SLACK_S)) as wakes:
            for _ in wakes:
                yield self._watch(connection, track)
        late_s = time.monotonic() - started_s - expected_s
        report = connection.wait_report(REPLY_TIMEOUT_S)
        yield None  # a stop must be handled before the end position is checked
        rest_m = self._position.to_m(report)
        is_there = rest_m is not None and abs(rest_m - position_m) <= POSITION_TOLERANCE_M
        if report.state != 'Idle' or not is_there:
            raise DeviceRefusedError(f'the guide ended in state {report.state} at {rest_m} m')
        self.last_move = track.summarise(late_s if late_s > LATE_S else 0.0)
        if late_s > LATE_S:
            self.late_moves += 1
            _logger.warning(
                'the move to %.4f m took %.2f s longer than computed', position_m, late_s
            )
        return self._to_rest_state(report)

    def _watch(self, connection: GrblConnection, track: MotionTrack) -> GuideState | None:
        last = self._position.last
        if last is None or self._motions.is_stopping:  # the driver's stop causes Hold, too
            return None
        state, arrived_at_ns = last
        if state.state in ('Hold', 'Door', 'Check', 'Sleep'):
            raise DeviceRefusedError(f'the controller entered the state {state.state} by itself')
        if state.position_m is not None:
            track.add(arrived_at_ns, state.position_m)
        if connection.has_stalled:
            self._motions.unless_stopping(connection.start_cycle)
        return state

    def _stop_move(self, target: str) -> str:
        connection, _ = self._require_connection()
        try:
            connection.hold_and_reset()
            position_m = self._position.to_m(connection.wait_report(REPLY_TIMEOUT_S))
        except LinearGuideDriverError as error:
            self._give_up(str(error))
            raise MotionFailedError(f'Stopping failed: {error}; home the guide.') from error
        if self._position.trouble or position_m is None:
            raise MotionFailedError(
                f'Stopping lost the position: {self.trouble or Refusal("no report", HOME)}'
            )
        return f'Stopped at {position_m:.4f} m on the way to {target}; the guide is still homed.'

    def _fail_move(self, target_m: float, reason: str) -> str:
        self._give_up(reason)
        return f'The move to {target_m:.4f} m failed: {reason}; home the guide.'

    def _give_up(self, reason: str) -> None:
        self._position.lose(Refusal(reason, HOME))
        self._brake()

    def _brake(self) -> None:
        if self._connection is not None:
            self._connection.hold()

    def _finish(self) -> None:
        self._position.direction = 0
        if self._position.trouble == HOMING:
            self._position.trouble = HOMING_FAILED

    # -- inside --------------------------------------------------------------------------

    def _open(self) -> tuple[GrblConnection, GuideSettings]:
        connection = GrblConnection(
            self._config.port,
            self._config.baud,
            self._config.poll_rate_hz,
            on_report=self._position.take_report,
            on_fault=self._position.take_fault,
            on_cycle=self._on_cycle,
        )
        try:
            connection.open()
            settings = GuideSettings.from_lines(connection.read_settings())
            settings.check(self._config, connection.options, is_hal=connection.is_hal)
            self._position.trouble = NOT_HOMED
            connection.start_polling()
            connection.wait_report(REPLY_TIMEOUT_S)
            return connection, settings
        except LinearGuideDriverError:
            connection.close()
            raise

    def _require_connection(self) -> tuple[GrblConnection, GuideSettings]:
        if self._connection is not None and self._settings is not None:
            return self._connection, self._settings
        raise MotionRefusedError('The guide is not connected; connect it first.')

    def _to_rest_state(self, report: grbl.StatusReport) -> GuideState:
        """Return the state after a motion; raise if a fault has lost the position since then."""
        state = self._position.to_state(report)
        if state.position_m is None:
            raise MotionFailedError(
                f'The motion ended, then its position was lost: {self.trouble}'
            )
        return state


class _KnownPosition:
    """Converts status reports to `GuideState`.

    After a fault, the position is unknown until the next homing.

    Attributes
    ----------
    trouble : Refusal or None
        Why the guide must be homed before it can move.
    direction : int
        Direction of the running move, 1 or -1; 0 without a move.
    """

    def __init__(
        self,
        travel_m: float,
        clock_ns: Callable[[], int],
        on_state: Callable[[GuideState], None],
        on_trouble: Callable[[str], None],
    ) -> None:
        self._travel_m, self._clock_ns = travel_m, clock_ns
        self._on_state, self._on_trouble = on_state, on_trouble
        # Last report, and its arrival on the node's clock and on the monotonic clock [ns].
        self._last: tuple[grbl.StatusReport, int, int] | None = None
        self.direction = 0
        self.trouble: Refusal | None = None

    @property
    def last(self) -> tuple[GuideState, int] | None:
        """The last state and its arrival on the monotonic clock [ns]; None before the first."""
        last = self._last
        return None if last is None else (self.to_state(*last[:2]), last[2])

    def lose(self, trouble: Refusal) -> None:
        """Record why the position is unknown. A reason that is already recorded is kept."""
        self.trouble = self.trouble or trouble

    def take_fault(self, reason: str) -> None:
        """Handle a fault of the controller or the connection."""
        if self.trouble is None:
            self.trouble = Refusal(reason, HOME)
            self._on_trouble(reason)

    def take_report(self, report: grbl.StatusReport) -> None:
        """Handle a report of the controller."""
        if report.state == 'Alarm':
            self.take_fault('the controller is locked by an alarm')
        self._last = (report, self._clock_ns(), time.monotonic_ns())
        try:
            self._on_state(self.to_state(*self._last[:2]))
        except Exception:  # reading must continue, because it detects alarms and answers
            _logger.exception('the consumer of the guide states failed')

    def to_m(self, report: grbl.StatusReport) -> float | None:
        """Return the position in the guide's frame [m], or None if the report has none."""
        return None if report.mpos_mm is None else report.mpos_mm[0] / 1e3 + self._travel_m

    def to_state(self, report: grbl.StatusReport, received_at_ns: int | None = None) -> GuideState:
        """Return the state in a report.

        ``received_at_ns`` is the arrival of the report on the node's clock [ns]; by default, the
        present time.
        """
        return GuideState(
            position_m=None if self.trouble else self.to_m(report),
            velocity_m_s=self.direction * (report.feed_mm_min or 0.0) / 60e3,
            state=report.state,
            received_at_ns=self._clock_ns() if received_at_ns is None else received_at_ns,
        )
