# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of the tendon actuator, a Dynamixel XM430 in current-based position mode.

`TendonActuatorClient` has three layers, from the bottom up:

- *Loop*: each poll locks the bus, reads the servo, asks `TendonSafety` for the order to the
  servo, and writes the registers that differ from the desired state. A command runs this loop
  once without waiting for the next poll, and so does a sample that may change the order.
- *Desired state*: the goal and the limits that the servo should have. Orders and pulls only
  select a desired state. A new desired state ends an earlier pull.
- *Motions*: a pull or a homing is executed by `Motions`. It begins when `TendonSafety` admits
  its goal, and ends when the servo has reached the goal.

The servo's bus watchdog stops the servo if no packet arrives. The reads of the servo in each poll
are such packets.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from functools import partial
import logging
import math
import time
from typing import TypeVar

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import LATE_S, SilentServoError
from linear_guide_driver.dynamixel.servo import (
    DesiredState,
    Found,
    open_servo,
    ServoChangedError,
    TendonServo,
)
from linear_guide_driver.dynamixel.servo_monitor import ServoMonitor
from linear_guide_driver.errors import (
    capitalise,
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.motion import Motion, Motions
from linear_guide_driver.safety import (
    Ending,
    Order,
    Pull,
    State,
    TendonSafety,
    Watch,
    Zero,
)
from linear_guide_driver.stop_latch import StopLatch
from linear_guide_driver.types import TendonState
from tactile_ros.refusal import Refusal

POSITION_TOLERANCE_M = 0.0005
"""Distance [m] from its goal at which a pull may end: the servo deviates a little under load."""

SLACK_S = 1.0
"""Time [s] added to the computed duration of a pull before it counts as stuck."""

POLL_WAIT_S = 1.0

COMMAND_CYCLES = 5
"""Number of attempts to write a command to the servo. A lost packet costs one attempt."""

SLACKEN_S = 2.0
"""Longest time [s] that `TendonActuatorClient.close` waits for the tendon to become slack."""

HOMING_REACH_M = 0.005
"""Homing searches for the zero over this distance [m], or ``max_displacement_m`` if larger."""

HOMING_POLLS = 3
"""Number of consecutive polls in which homing must find the tendon taut (or slack) to accept it.

A single sample may be noise."""

HOMING_SLACK_SHARE = 0.5
"""During homing, a tension up to this fraction of ``taut_tension_n`` counts as slack."""

NOT_BEGUN = 'The pull was stopped before it began.'
RELEASED = 'The tendon was released.'
RESTARTED = 'The driver has started with a taut tendon; the tendon is slackened.'

_logger = logging.getLogger(__name__)

_Result = TypeVar('_Result')
MotionProgress = Generator[TendonState | None, None, _Result]


class TendonActuatorClient:
    """Blocking, thread-safe client of the tendon's servo; one pull at a time.

    `TendonSafety` checks every command, and the poll thread executes the orders of
    `TendonSafety`. `connect` slackens a tendon that was left taut. `close` slackens the tendon
    and switches the torque off. Commands raise `MotionRefusedError` and the errors of the bus.

    Parameters
    ----------
    config : TendonActuatorConfig
        Connection and limits.
    on_state : callable
        Called on the poll thread with each `TendonState`, stamped by ``clock_ns``.
    clock_ns : callable
        Returns the present time [ns].
    on_trouble : callable
        Called on any thread with a sentence for each new fault, and for each order of
        `TendonSafety` that no command has requested.
    watches : sequence of Watch
        Nodes and topics that are needed while the tendon is taut.
    on_cycle : callable
        Called in each cycle of the poll thread; see `ServoMonitor`.
    latch : StopLatch, optional
        Stopped state of the rig. Call `supervise` after each change of this state.

    Attributes
    ----------
    safety : TendonSafety
        State machine that checks every motion. Pass it the samples of the tension.
    recoveries : int
        Number of times that the bus watchdog stopped the servo and the driver cleared the stop.
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        on_state: Callable[[TendonState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
        on_trouble: Callable[[str], None] = lambda _: None,
        watches: Sequence[Watch] = (),
        on_cycle: Callable[[float], None] = lambda _: None,
        latch: StopLatch | None = None,
    ) -> None:
        self._config, self._clock_ns = config, clock_ns
        self._on_state, self._on_trouble, self._on_cycle = on_state, on_trouble, on_cycle
        self._servo: TendonServo | None = None
        self._monitor: ServoMonitor | None = None
        self._motions = Motions('The tendon is busy with another pull; stop it first.', NOT_BEGUN)
        self._order = Order.FOLLOW  # last order of `TendonSafety`
        self._pull_state: DesiredState | None = None  # desired state of the last pull
        self._goal_m = 0.0  # goal of the last pull
        self._is_written = False  # True if the servo has the whole desired state
        self._reported_alarm: str | None = None
        self.safety = TendonSafety(config, watches, latch)
        self.recoveries = 0

    @property
    def state(self) -> TendonState | None:
        """The latest state; None before the first poll."""
        return None if self._monitor is None else self._monitor.state

    @property
    def identification(self) -> str:
        """Model and firmware; an empty string until the servo is set up."""
        return '' if self._servo is None else self._servo.identification

    @property
    def temperature_limit_c(self) -> float:
        """Temperature at which the servo shuts down [C]."""
        return 0.0 if self._servo is None else float(self._servo.limits.temperature_c)

    @property
    def is_at_rest(self) -> bool:
        """True while the tendon is slack and at rest, so that it is polled at a lower rate."""
        return self._monitor is not None and self._monitor.is_at_rest

    @property
    def trouble(self) -> Refusal | None:
        """Why the servo cannot tighten the tendon: an outage or a fault. None if it can."""
        return None if self._monitor is None else self._monitor.trouble

    # -- life ----------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the bus and set the servo up; slacken a tendon that was left taut.

        Raises the errors of `open_servo`.
        """
        self.close()
        self._servo, found = open_servo(self._config)
        self._take_over(found)
        listeners = (
            self._on_poll,
            self._on_state,
            self._on_loss,
            self._on_trouble,
            self._on_cycle,
        )
        self._monitor = ServoMonitor(
            self._servo, self._config, *listeners, restore=self._restore, is_slack=self._is_slack
        )
        self._monitor.start()
        self._monitor.wait_poll(POLL_WAIT_S)

    def close(self) -> None:
        """Slacken the tendon, then switch the torque off; idempotent."""
        servo, monitor = self._servo, self._monitor
        if servo is None or monitor is None:
            return
        if not monitor.outage:
            self._slacken(monitor)
        with servo.bus.lock:
            self._pull_state = None  # ends a running pull
        monitor.close()
        self._servo = None
        servo.switch_off()

    def _slacken(self, monitor: ServoMonitor) -> None:
        """Slacken the tendon, and wait up to `SLACKEN_S` until it is slack."""
        deadline_s = time.monotonic() + SLACKEN_S
        if self.safety.zero is Zero.UNKNOWN and self._read_tension() is None:
            return  # neither the zero nor the sensor would show when the tendon is slack
        try:
            self.request_release(reason='The driver is closing; the tendon is slackened.')
            while time.monotonic() < deadline_s:
                state = monitor.wait_poll(POLL_WAIT_S)
                if monitor.outage:
                    break
                if state and self.safety.is_slack(state.displacement_m, time.monotonic_ns()):
                    return
        except LinearGuideDriverError as error:
            _logger.error('the tendon may still be taut: %s', error)
        else:
            _logger.error('the tendon was not slack after %s s; it may still be taut', SLACKEN_S)

    def _take_over(self, found: Found) -> None:
        """Reset order and zero to match the state in which the servo was found at its setup."""
        if found is Found.SAME:
            return
        self._order = Order.FOLLOW
        if found is Found.MISPLACED:
            reason = 'the servo held the tendon at a position that does not fit its zero'
            self.safety.set_zero(Zero.UNKNOWN, reason)
        else:
            self.safety.set_zero(Zero.UNCONFIRMED)
        if found is Found.KEPT:
            _logger.warning(RESTARTED)
            self.safety.release(RESTARTED)

    def _restore(self) -> None:
        """Re-establish a lost connection. The next poll executes the present order."""
        servo, _ = self._require_connection()
        servo.bus.open()
        self._take_over(servo.set_up())

    def _require_connection(self) -> tuple[TendonServo, ServoMonitor]:
        servo, monitor = self._servo, self._monitor
        if servo is None or monitor is None:
            raise MotionRefusedError('The tendon actuator is not connected; connect it first.')
        return servo, monitor

    # -- motions -------------------------------------------------------------------------

    def pull_to(
        self,
        displacement_m: float,
        speed_m_s: float = 0.0,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
        *,
        contact: str = 'flexion',
        stop_tension_n: float = 0.0,
    ) -> TendonState:
        """Move the tendon to a displacement and hold it there; return the state at rest.

        Parameters
        ----------
        displacement_m : float
            Displacement from the zero [m]; 0 slackens the tendon.
        speed_m_s : float
            Tendon speed [m/s]; 0: the configured speed.
        on_state : callable
            Called with each new state while the tendon moves.
        should_stop : callable
            Returns True if the pull must stop; the tendon is then held.
        contact : str
            ``flexion`` or ``abduction``; selects the limit of the tension.
        stop_tension_n : float
            Tension at which the pull ends and the tendon is held [N]; 0: none.
            ``safety.ending`` shows whether this tension ended the pull.

        Returns
        -------
        TendonState

        Raises
        ------
        MotionRefusedError
            If a value is out of range, or the actuator is busy, not safe, or not connected.
            Nothing has moved.
        MotionFailedError
            If a fault or safety ended the pull.
        MotionStoppedError
            If ``should_stop`` or a later command ended the pull.
        """
        if displacement_m == 0.0:  # slackening the tendon is always allowed
            return self._run(partial(self._release, speed_m_s), on_state, should_stop)
        if not 0.0 <= displacement_m <= self._config.max_displacement_m:
            raise MotionRefusedError(
                f'Displacement {displacement_m} m must be between 0 and max_displacement_m, '
                f'{self._config.max_displacement_m} m.'
            )
        speed_m_s = speed_m_s or self._config.speed_m_s
        if not 0.0 < speed_m_s <= self._max_speed_m_s * (1 + 1e-9):
            raise MotionRefusedError(
                f"Speed {speed_m_s} m/s must be above 0 and at most the servo's limit of "
                f'{self._max_speed_m_s:.4f} m/s.'
            )
        pull = Pull(displacement_m, contact, stop_tension_n)
        return self._run(partial(self._drive, pull, speed_m_s), on_state, should_stop)

    def home(
        self,
        taut_tension_n: float,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> float:
        """Find the zero of the displacement: tighten slowly until the tendon becomes taut.

        A taut tendon is slackened first. The fingertip must be free.

        Parameters
        ----------
        taut_tension_n : float
            Tension at which the tendon counts as taut [N].
        on_state, should_stop : callable
            See `pull_to`, also for the errors.

        Returns
        -------
        float
            Displacement of the new zero from the old one [m].
        """
        # ``taut_tension_n`` must not exceed the limit, like the stop tension of a pull.
        contact = self.safety.strictest_contact
        self.safety.check_pull(Pull(0.0, contact, stop_tension_n=taut_tension_n))
        return self._run(partial(self._find_zero, taut_tension_n), on_state, should_stop)

    def _run(
        self,
        begin: Callable[[], MotionProgress[_Result]],
        on_state: Callable[[TendonState], None],
        should_stop: Callable[[], bool],
    ) -> _Result:
        endings = (self._stop_pull, self._fail_pull, self._abandon_pull, self.safety.finish)
        motion = Motion(begin, *endings)
        return self._motions.run(motion, on_state, should_stop)

    def _stop_pull(self) -> str:
        servo, _ = self._require_connection()
        with servo.bus.lock:
            if not self._is_replaced:  # do not override a later command
                self.hold_here()
        return self._format_end(self.safety.reason)

    def _fail_pull(self, reason: str) -> str:
        self._require_connection()[1].fail(reason)
        return f'The pull failed: {reason}.'

    def _abandon_pull(self) -> None:
        with suppress(LinearGuideDriverError):
            self.hold_here()

    def _release(self, speed_m_s: float) -> MotionProgress[TendonState]:
        """Slacken the tendon to the zero of its displacement.

        If the zero is unknown, slacken until the sensor reads a slack tendon, or at the latest
        until `TendonSafety.slack_m`.
        """
        safety = self.safety
        wanted_m_s = speed_m_s if speed_m_s > 0.0 else self._config.speed_m_s

        def until(state: TendonState) -> bool:
            is_known = safety.zero is not Zero.UNKNOWN
            return not is_known and safety.is_slack(state.displacement_m, time.monotonic_ns())

        return self._drive(Pull(safety.slack_m), min(wanted_m_s, self._max_speed_m_s), until)

    def _find_zero(self, taut_tension_n: float) -> MotionProgress[float]:
        """Slacken the tendon, tighten until it is taut, and set the zero there."""
        present_n = self._read_tension()
        if present_n is None:
            reason = 'Homing needs the tendon sensor, but no valid strain sample arrives'
            raise MotionRefusedError(f'{reason}; start the sensor.')
        slack_n = HOMING_SLACK_SHARE * taut_tension_n
        if present_n > slack_n:
            yield from self._seek(-1, lambda n: n <= slack_n, 'slack; tare the sensor')
        there = 'taut; check the tendon'
        taut = yield from self._seek(1, lambda n: n >= taut_tension_n, there)
        self._shift_zero(taut.displacement_m)
        return taut.displacement_m

    def _seek(
        self, direction: int, is_there: Callable[[float], bool], goal: str
    ) -> MotionProgress[TendonState]:
        """Tighten (1) or slacken (-1) until ``is_there(tension)`` is True in consecutive polls.

        Return the state of the first of these `HOMING_POLLS` polls.
        """
        there: list[TendonState] = []

        def until(state: TendonState) -> bool:
            tension_n = self._read_tension()
            if tension_n is not None and is_there(tension_n):
                there.append(state)
            else:
                there.clear()
            return len(there) >= HOMING_POLLS

        start = self.state
        if start is None:
            raise MotionRefusedError('The servo has not answered yet; try again.')
        reach_m = max(self._config.max_displacement_m, HOMING_REACH_M)
        start_m = start.displacement_m
        if direction > 0:  # an unknown zero may be far above the present position
            start_m = max(start_m, 0.0)
        end_m = start_m + direction * reach_m
        pull = Pull(end_m, self.safety.strictest_contact, is_homing=True)
        end = yield from self._drive(pull, self._config.homing_speed_m_s, until)
        if len(there) < HOMING_POLLS:
            raise MotionFailedError(
                f'Homing failed at {end.displacement_m:.4f} m: the tendon did not become {goal}.'
            )
        return there[0]

    def _drive(
        self,
        pull: Pull,
        speed_m_s: float,
        until: Callable[[TendonState], bool] = lambda _: False,
    ) -> MotionProgress[TendonState]:
        """Move to the goal of a pull, or until ``until(state)`` is True; then hold."""
        path_m = self._begin(pull, speed_m_s)
        _, monitor = self._require_connection()
        deadline_s = time.monotonic() + path_m / speed_m_s + SLACK_S
        one_unit_m_s = registers.velocity_to_m_s(1, self._config.pulley_radius_m)
        while True:
            state = self._wait_state(monitor)
            yield state
            if state is not None and self.safety.ending is Ending.REACHED:
                return state
            if outage := monitor.outage:
                raise MotionFailedError(f'The pull failed: {outage.reason}.')
            # A pull that slackens also continues if `TendonSafety` orders to slacken.
            goes_on = pull.slackens and self.safety.state is State.RELEASING
            if self._is_replaced and not goes_on:
                raise MotionStoppedError(self._format_end(self.safety.reason))
            if state is not None:
                if until(state):
                    servo, _ = self._require_connection()
                    with servo.bus.lock:
                        if not self._is_replaced:
                            self._desire(Order.HOLD)
                            self._apply()
                    return state
                if (
                    abs(state.displacement_m - self._goal_m) <= POSITION_TOLERANCE_M
                    and abs(state.velocity_m_s) <= 1.5 * one_unit_m_s
                ):
                    return state
            if time.monotonic() > deadline_s:
                end = self._format_end()
                self.request_release(reason=end)
                raise MotionFailedError(
                    f'{end} The pull stalled at a motor current of '
                    f'{self.safety.find_current_limit_a(pull):g} A; the tendon is slackened.'
                )

    def _wait_state(self, monitor: ServoMonitor) -> TendonState | None:
        """Return the next state, or None after a timeout. Raise if safety has ended the pull."""
        state = monitor.wait_poll(POLL_WAIT_S)
        ending = self.safety.ending
        if ending is None:
            return state
        self.supervise()  # before the exception ends the pull
        if ending is Ending.REACHED and self.safety.state is not State.RELEASING:
            return self.state
        error = MotionStoppedError if ending is Ending.STOPPED else MotionFailedError
        raise error(self._format_end(self.safety.reason))

    @property
    def _max_speed_m_s(self) -> float:
        """The servo's velocity limit as a tendon speed [m/s]."""
        limit = 1 if self._servo is None else self._servo.limits.velocity
        return registers.velocity_to_m_s(limit, self._config.pulley_radius_m)

    def _read_tension(self) -> float | None:
        return self.safety.tension.live_n(time.monotonic_ns())

    def _format_end(self, reason: str = '') -> str:
        """Return a sentence with the end position and the goal of the pull, and the reason."""
        state = self.state
        at = 'an unknown position' if state is None else f'{state.displacement_m:.4f} m'
        return f'The pull ended at {at} on the way to {self._goal_m:.4f} m. {reason}'.strip()

    # -- goals ---------------------------------------------------------------------------

    @property
    def _is_replaced(self) -> bool:
        """True if a later command has replaced the desired state of the last pull."""
        servo = self._servo
        return servo is None or servo.desired is not self._pull_state

    def _begin(self, pull: Pull, speed_m_s: float) -> float:
        """Write the goal of a pull if safety admits it; return the distance to the goal [m]."""
        servo, monitor = self._require_connection()
        with servo.bus.lock:
            # A stop calls `hold_here`, which needs the same lock. An earlier stop is detected
            # here, and a later stop overrides the goal.
            if self._motions.is_stopping:
                raise MotionStoppedError(NOT_BEGUN)
            if pull.slackens:  # if the servo is silent now, it slackens when it answers again
                self.safety.release(RELEASED)
            self._check_reachable(monitor)
            start_m = servo.read_displacement_m()
            self.safety.admit(pull, start_m, time.monotonic_ns(), monitor.fault)
            goal_m = pull.displacement_m
            if pull.slackens:
                goal_m = min(self.safety.slack_m, start_m)
            self._order, self._goal_m = Order.FOLLOW, goal_m
            # The servo may move before the goal is written. A goal that does not tighten at
            # ``start_m`` must not tighten at the new position either.
            self._pull_state = DesiredState(
                goal_m, servo.to_velocity(speed_m_s), self._find_current(pull), goal_m > start_m
            )
            servo.desire(self._pull_state)
            self._apply()
            return abs(goal_m - start_m)

    def _find_current(self, pull: Pull) -> int:
        """Return the current limit of a pull, in the servo's units."""
        return registers.a_to_current(self.safety.find_current_limit_a(pull))

    def _shift_zero(self, shift_m: float) -> None:
        """Move the servo's zero to the displacement ``shift_m`` [m]."""
        servo, monitor = self._require_connection()
        with servo.bus.lock:  # no poll may read the servo while its torque is off
            self._check_reachable(monitor)
            servo.write_zero(shift_m)
            self.safety.set_zero(Zero.KNOWN)
        # Wait for a state with the new zero.
        monitor.wait_poll(POLL_WAIT_S)

    # -- orders --------------------------------------------------------------------------

    def hold_here(self) -> None:
        """Hold the tendon at its position.

        If the tension is above its limit, the tendon is slackened instead. If the rig is stopped,
        a taut tendon is slackened after ``slack_after_s``.
        """
        self._command(lambda: self.safety.hold(time.monotonic_ns()), Order.HOLD)

    def request_release(
        self, end_pull: Callable[[], None] = lambda: None, reason: str = RELEASED
    ) -> None:
        """Start to slacken the tendon at the servo's highest speed; ends a running pull.

        Raises `LinearGuideDriverError` if the servo cannot be reached. The tendon is then
        slackened when the servo answers again.

        Parameters
        ----------
        end_pull : callable
            Makes ``should_stop`` of a running pull return True. It is called with the bus's lock
            held, so that no pull can hold the tendon before it is slackened.
        reason : str
            Sentence for `TendonSafety.reason`.
        """

        def release() -> None:
            end_pull()
            self.safety.release(reason)

        self._command(release, Order.RELEASE)

    def supervise(self) -> None:
        """Execute the present order of `TendonSafety`; the next poll repeats failed writes.

        Nothing is sent to a silent servo, because every packet would feed its bus watchdog, which
        must stop the servo.
        """
        servo, monitor = self._servo, self._monitor
        if servo is None or monitor is None or monitor.outage:
            return
        with suppress(LinearGuideDriverError), servo.bus.lock:
            self._check_reachable(monitor)
            monitor.cycle()

    def _command(self, ask: Callable[[], None], order: Order) -> None:
        """Request ``order`` from `TendonSafety`, and execute the order that it decides on."""
        servo, monitor = self._require_connection()
        with servo.bus.lock:
            ask()
            self._check_reachable(monitor)
            self._order = Order.FOLLOW
            self._desire(order)
            self._apply()

    @staticmethod
    def _check_reachable(monitor: ServoMonitor) -> None:
        """Refuse a command while the torque is off or the connection is being re-established."""
        if monitor.is_lost or monitor.is_shut_down:
            raise MotionRefusedError(f'The tendon actuator cannot move: {monitor.outage}')

    def _apply(self) -> None:
        """Write the desired state now; repeat this after lost packets.

        If a write was acknowledged but not executed, the next poll repeats it.
        """
        _, monitor = self._require_connection()
        monitor.poll_fast()
        for _ in range(COMMAND_CYCLES - 1):
            with suppress(SilentServoError, DeviceRefusedError):
                if self._cycle(monitor):
                    return
                continue
            time.sleep(LATE_S)
        if not self._cycle(monitor):
            raise DeviceRefusedError(
                'the servo does not accept its settings; configure the driver again'
            )

    def _cycle(self, monitor: ServoMonitor) -> bool:
        """Read the servo and write the desired state once; return True if all is written."""
        self._check_reachable(monitor)
        self._is_written = False
        monitor.cycle()
        return self._is_written

    def _desire(self, order: Order) -> None:
        """Select the desired state for an order."""
        servo, monitor = self._require_connection()
        desired, velocity = servo.desired, servo.limits.velocity
        if order is Order.HOLD:
            servo.desire(DesiredState(math.inf, desired.velocity, desired.current))
        elif order is Order.RELEASE:
            servo.desire(DesiredState(self.safety.slack_m, velocity, desired.current))
        monitor.poll_fast()

    def _follow_order(self, order: Order) -> None:
        """Select another desired state if the order of `TendonSafety` has changed."""
        if order is not self._order:
            was, self._order = self._order, order
            if order is not Order.FOLLOW:
                self._desire(order)
            elif was is Order.RELEASE and self.safety.zero is Zero.UNKNOWN:
                self._desire(Order.HOLD)  # the sensor reads slack before the goal is reached
        alarm = self.safety.alarm
        if alarm and alarm != self._reported_alarm:
            self._require_connection()[1].report_trouble(alarm)
        self._reported_alarm = alarm

    def _on_loss(self, reason: str) -> None:
        self.safety.lose(f'{capitalise(reason)}.', time.monotonic_ns())

    def _is_slack(self, state: TendonState) -> bool:
        return self.safety.is_at_rest(state.displacement_m, time.monotonic_ns())

    def _on_poll(self, polled: registers.ServoState) -> TendonState:
        """Execute the order of `TendonSafety` for a newly read state of the servo.

        The caller has locked the bus.
        """
        servo, _ = self._require_connection()
        state = servo.to_state(polled, self._clock_ns())
        self.safety.add_current(state.current_a, time.monotonic_ns())
        if not polled.is_torque_on:
            self.safety.set_zero(Zero.UNKNOWN, "the servo's torque went off")
            return state
        try:
            servo.check_unchanged(polled)
        except ServoChangedError as change:
            self.safety.set_zero(Zero.UNKNOWN, str(change))
            raise
        if polled.watchdog == registers.WATCHDOG_TRIPPED:
            self.recoveries += 1
            if self.safety.is_pulling and servo.has_goal(polled):
                silence = f'{self._config.watchdog_s} s of silence'
                self._on_loss(f"the servo's watchdog has stopped it after {silence}")
        order = self.safety.decide(state.displacement_m, time.monotonic_ns())
        self._follow_order(order)
        may_tighten = order is Order.FOLLOW and self.safety.is_pulling
        self._is_written = servo.apply(polled, may_tighten=may_tighten)
        return state
