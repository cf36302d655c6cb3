# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The linear guide: moves a Grbl 1.1 controller's X axis and knows when it is at rest.

Grbl keeps no watch over the line and forgets its position when it is reset while
moving. Hence the rules here: a move is sent in short pieces; it ends with the ``ok`` of
a dwell, never with a status; a dwell that stalls with moves queued is started again; a stop is
a feed hold, rest, then a reset; and whatever else happens to the controller makes the position
unknown until the guide has been homed again.
"""

from __future__ import annotations

from collections.abc import Callable
import logging
import time
from typing import NoReturn

from linear_guide_driver.errors import (
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.grbl import protocol as grbl
from linear_guide_driver.grbl.connection import GrblConnection
from linear_guide_driver.grbl.guide_path import (
    check_reach,
    compute_piece_s,
    encode_pieces,
    mpos_to_m,
)
from linear_guide_driver.grbl.known_position import KnownPosition
from linear_guide_driver.grbl.motion_gate import MotionGate
from linear_guide_driver.grbl.motion_track import MotionSummary, MotionTrack
from linear_guide_driver.grbl.settings import GuideSettings
from linear_guide_driver.records import GuideState, LinearGuideConfig

POSITION_TOLERANCE_M = 0.0001
"""How far from its target a finished move may rest: some motor steps."""

REPLY_TIMEOUT_S = 2.0
"""For the answer to a line that does not wait for motion."""

SLACK_S = 2.0
"""Added to the computed duration of a motion before it counts as failed."""

LATE_S = 0.15
"""A move that takes so much longer than computed has paused on the way: pieces came late."""

HOMING = 'the guide is being homed'
HOMING_FAILED = 'the last homing did not succeed'
NOT_HOMED = 'the guide has not been homed since the driver connected'

_logger = logging.getLogger(__name__)


class LinearGuideClient:
    """Blocking, thread-safe client of the guide's controller; one motion at a time.

    Parameters
    ----------
    config : LinearGuideConfig
    on_state : callable, optional
        Called with each `GuideState`, on the reader thread.
    clock_ns : callable, optional
        Clock that stamps states [ns].
    on_trouble : callable, optional
        Called with a reason, on the reader thread, when a fault has lost the position.

    Attributes
    ----------
    late_moves : int
        Moves so far that took longer than computed; a glide among them was not steady.
    last_move : MotionSummary or None
        Speed and lag of the last finished move; None when too few positions were reported.
    """

    def __init__(
        self,
        config: LinearGuideConfig,
        on_state: Callable[[GuideState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
        on_trouble: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._config = config
        self._position = KnownPosition(config.travel_m, clock_ns, on_state, on_trouble)
        self._position.lose(NOT_HOMED)
        self._connection: GrblConnection | None = None
        self._settings: GuideSettings | None = None
        self._gate = MotionGate()
        self.last_move: MotionSummary | None = None
        self.late_moves = 0

    # -- what is known -------------------------------------------------------------------

    @property
    def state(self) -> GuideState | None:
        """The last state; None before the first report."""
        last = self._position.last
        return None if last is None else last[0]

    @property
    def trouble(self) -> str:
        """Why the guide must be homed before it can move; empty when it need not."""
        return self._position.trouble

    @property
    def is_lost(self) -> bool:
        """Whether the line is lost; homing tries to open it again."""
        return self._connection is not None and self._connection.is_lost

    @property
    def identification(self) -> str:
        """Firmware and build of the controller; empty when not connected."""
        return self._connection.identification if self._connection else ''

    @property
    def garbage_lines(self) -> int:
        """Lines received that were no Grbl."""
        return self._connection.garbage_lines if self._connection else 0

    # -- life ----------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the line, bring the controller to rest and check its settings.

        Raises
        ------
        DeviceConnectionError
            When no Grbl answers.
        DeviceRefusedError
            When its settings would silently change a glide.
        """
        self.close()
        self._connection, self._settings = self._open()

    def close(self) -> None:
        """Stop a running motion, then close the line. Harmless when called twice."""
        connection = self._connection
        if connection is None:
            return
        self.request_stop()
        # The motion itself brings the guide to rest; take the line away only afterwards.
        with self._gate.no_motion(SLACK_S + 3.0):
            self._connection = None
            connection.close()

    # -- motion --------------------------------------------------------------------------

    def home(
        self,
        on_elapsed: Callable[[float], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> GuideState:
        """Find the reference switch; return the state at rest.

        Connects anew when the line was lost. Stopping resets the controller, since
        a homing cycle heeds nothing else.

        Parameters
        ----------
        on_elapsed : callable
            Called now and then with the time since the command [s].
        should_stop : callable
            Ends the homing when it returns True.

        Raises
        ------
        MotionRefusedError, MotionFailedError, MotionStoppedError, DeviceConnectionError
        """
        with self._gate.one_motion():
            connection, settings = self._require_connection()
            if connection.is_lost:
                connection.close()
                self._connection, self._settings = connection, settings = self._open()
            self._gate.begin('homing', should_stop)
            self._position.trouble = HOMING
            started_s = time.monotonic()
            try:
                connection.reset()
                connection.stream(
                    [grbl.HOME],
                    settings.compute_homing_timeout_s() + SLACK_S,
                    lambda: should_stop() or self._gate.is_stopping,
                    lambda: on_elapsed(time.monotonic() - started_s),
                    answers_status=False,
                )
                # Before the last look, so that no later fault is forgotten.
                self._position.trouble = ''
                report = connection.wait_report(REPLY_TIMEOUT_S)
            except MotionStoppedError:
                connection.reset()
                raise MotionStoppedError(
                    'Homing was stopped; home before the next move.'
                ) from None
            except LinearGuideDriverError as error:
                self._position.lose(HOMING_FAILED)
                raise MotionFailedError(f'Homing failed: {error}.') from error
            except BaseException:  # a fault of the caller's functions: nobody watches now
                connection.reset()
                raise
            finally:
                if self._position.trouble == HOMING:
                    self._position.trouble = HOMING_FAILED
            position = mpos_to_m(report, self._config.travel_m)
            if position is None or not -1e-6 <= position <= self._config.travel_m + 1e-6:
                self._position.trouble = HOMING_FAILED
                raise MotionFailedError(
                    f'Homing ended at machine position {report.mpos_mm}, outside of the travel of '
                    f'{self._config.travel_m} m; check the settings $23, $27 and $130.'
                )
            return self._to_rest_state(report)

    def move_to(
        self,
        position_m: float,
        speed_m_s: float,
        on_state: Callable[[GuideState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> GuideState:
        """Move; return the state at rest.

        Parameters
        ----------
        position_m : float
            Target in the guide's frame [m].
        speed_m_s : float
            Speed [m/s].
        on_state : callable
            Called with each new state while the guide moves.
        should_stop : callable
            Stops the guide, with braking and position kept, when it returns True.

        Raises
        ------
        MotionRefusedError
            Not homed, out of travel, too fast, or busy; nothing has moved.
        MotionFailedError
            Ended by a fault; the guide must be homed again.
        MotionStoppedError
            Ended by ``should_stop`` or `request_stop`; the position is still known.
        """
        with self._gate.one_motion():
            connection, settings = self._require_connection()
            start_m = self._check_move(position_m, speed_m_s)
            self._gate.begin('move', should_stop)
            self._position.direction = 1 if position_m >= start_m else -1
            track = MotionTrack(start_m, position_m, speed_m_s)
            expected_s = settings.compute_move_duration_s(position_m - start_m, speed_m_s)
            started_s = time.monotonic()

            def is_stopped() -> bool:
                return should_stop() or self._gate.is_stopping

            try:
                connection.reset_override()
                connection.stream([grbl.MODES], REPLY_TIMEOUT_S, is_stopped)
                connection.stream(
                    encode_pieces(
                        self._to_mpos_mm(start_m),
                        self._to_mpos_mm(position_m),
                        speed_m_s * 1e3,
                        compute_piece_s(self._config.run_on_s, connection.planner_blocks),
                    ),
                    expected_s + SLACK_S,
                    is_stopped,
                    lambda: self._watch(connection, on_state, track),
                )
                late_s = time.monotonic() - started_s - expected_s
                report = connection.wait_report(REPLY_TIMEOUT_S)
                rest_m = mpos_to_m(report, self._config.travel_m)
                if self._gate.end():
                    raise MotionStoppedError
                is_there = rest_m is not None and abs(rest_m - position_m) <= POSITION_TOLERANCE_M
                if report.state != 'Idle' or not is_there:
                    raise MotionFailedError(f'it ended as {report.state} at {rest_m} m')
                self.last_move = track.summarise(late_s if late_s > LATE_S else 0.0)
                if late_s > LATE_S:
                    self.late_moves += 1
                    _logger.warning('the move to %.4f m took %.2f s too long', position_m, late_s)
            except MotionStoppedError:
                self._gate.end()  # a further stop would hold the guide after the reset
                self._come_to_rest(connection, position_m)
            except LinearGuideDriverError as error:
                self._give_up(connection, str(error))
                raise MotionFailedError(
                    f'The move to {position_m:.4f} m failed: {error}; home the guide.'
                ) from error
            except BaseException:  # a fault of the caller's functions: nobody watches now
                self._give_up(connection, 'a move was left unwatched')
                raise
            finally:
                self._position.direction = 0
            return self._to_rest_state(report)

    def request_stop(self) -> bool:
        """Begin to stop at once and return; the running motion ends when at rest.

        Returns
        -------
        bool
            Whether a motion was running.
        """
        connection = self._connection

        def act(motion: str) -> None:
            if connection is not None and motion == 'move':  # homing heeds a reset only,
                connection.hold()  # which it does by itself

        return self._gate.request_stop(act)

    # -- inside --------------------------------------------------------------------------

    def _open(self) -> tuple[GrblConnection, GuideSettings]:
        connection = GrblConnection(
            self._config.port,
            self._config.baud,
            self._config.poll_rate_hz,
            on_report=self._position.take_report,
            on_fault=self._position.take_fault,
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

    def _check_move(self, position_m: float, speed_m_s: float) -> float:
        check_reach(self._config, position_m, speed_m_s)
        state = self.state
        if self._position.trouble or state is None or state.position_m is None:
            raise MotionRefusedError(
                f'The position is unknown: {self.trouble or "no report yet"}; home the guide.'
            )
        return state.position_m

    def _watch(
        self,
        connection: GrblConnection,
        on_state: Callable[[GuideState], None],
        track: MotionTrack,
    ) -> None:
        last = self._position.last
        if last is None or self._gate.is_stopping:  # a stop begins with a hold of our own
            return
        state, arrived_at_ns = last
        if state.state in ('Hold', 'Door', 'Check', 'Sleep'):
            raise MotionFailedError(f'the controller went to {state.state} by itself')
        if state.position_m is not None:
            track.add(arrived_at_ns, state.position_m)
        if connection.has_stalled:
            self._gate.unless_stopping(connection.start_cycle)
        on_state(state)

    def _come_to_rest(self, connection: GrblConnection, target_m: float) -> NoReturn:
        try:
            connection.hold_and_reset()
            position = mpos_to_m(connection.wait_report(REPLY_TIMEOUT_S), self._config.travel_m)
        except LinearGuideDriverError as error:
            self._give_up(connection, str(error))
            raise MotionFailedError(f'Stopping failed: {error}; home the guide.') from error
        if self._position.trouble or position is None:
            raise MotionFailedError(
                f'Stopping lost the position: {self._position.trouble}; home the guide.'
            )
        raise MotionStoppedError(
            f'Stopped at {position:.4f} m on the way to {target_m:.4f} m; the position is kept.'
        ) from None

    def _to_rest_state(self, report: grbl.StatusReport) -> GuideState:
        """Return the state after a motion; a fault may have come since its last report."""
        state = self._position.to_state(report)
        if state.position_m is None:
            raise MotionFailedError(
                f'The motion ended, then its position was lost: {self.trouble}; home the guide.'
            )
        return state

    def _give_up(self, connection: GrblConnection, reason: str) -> None:
        self._position.lose(reason)
        connection.hold()

    def _to_mpos_mm(self, position_m: float) -> float:
        return (position_m - self._config.travel_m) * 1e3
