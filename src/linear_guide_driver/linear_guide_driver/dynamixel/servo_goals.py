# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The goals of the tendon's servo, written under the bus's lock as safety orders.

Each goal is numbered, so that a later one ends an earlier. The servo's bus watchdog stops it
when nothing is heard for a while; the monitor's reads keep it fed. `tendon_client` adds the
motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import logging
import threading
import time

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.goal_writer import GoalWriter
from linear_guide_driver.dynamixel.servo_monitor import ServoMonitor
from linear_guide_driver.dynamixel.tendon_servo import TendonServo
from linear_guide_driver.dynamixel.tendon_setup import open_servo, ServoSetup, set_up_servo
from linear_guide_driver.errors import (
    capitalise,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.safety.pull import Pull
from linear_guide_driver.safety.states import Ending, Order, State, Zero
from linear_guide_driver.safety.tendon_safety import TendonSafety
from linear_guide_driver.safety.topic_watchdog import TopicWatchdog

POLL_WAIT_S = 1.0

LET_OUT_S = 2.0
"""Longest wait of `ServoGoals.close` for a tendon to become slack."""

RELEASED = 'The tendon was released.'
RESTARTED = 'The driver has started with a taut tendon: it is let out.'

_logger = logging.getLogger(__name__)


class ServoGoals:
    """The servo in lengths of tendon, and who may move it; thread-safe.

    Parameters
    ----------
    config : TendonActuatorConfig
    on_state : callable, optional
        Called with each `TendonState`, on the poll thread.
    clock_ns : callable, optional
        Clock that stamps states [ns].
    on_trouble : callable, optional
        Called with a sentence as soon as a fault or a safety order is new, from any thread.
    watchdogs : sequence of TopicWatchdog, optional
        Topics that must be heard while the tendon is taut.

    Attributes
    ----------
    safety : TendonSafety
        Feed it the samples of the tension.
    identification : str
        Model and firmware; empty before the first `connect`.
    temperature_limit_c : float
        At which the servo shuts down [degree Celsius].
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        on_state: Callable[[TendonState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
        on_trouble: Callable[[str], None] = lambda _: None,
        watchdogs: Sequence[TopicWatchdog] = (),
    ) -> None:
        self._config = config
        self._on_state, self._on_trouble = on_state, on_trouble
        self._clock_ns = clock_ns
        self._servo: TendonServo | None = None
        self._monitor: ServoMonitor | None = None
        self._slot = threading.Lock()  # held by the one pull
        self._repeated = 0  # number of the last goal that the servo had missed
        self.safety = TendonSafety(config, watchdogs)
        self._writer = GoalWriter(config, self.safety, self._on_alarm, self._on_written)
        self.identification = ''
        self.temperature_limit_c = 0.0

    @property
    def state(self) -> TendonState | None:
        """The last state; None before the first poll."""
        return None if self._monitor is None else self._monitor.state

    @property
    def trouble(self) -> str:
        """The fault that keeps the servo from winding in; empty when there is none."""
        return '' if self._monitor is None else self._monitor.trouble

    @property
    def remedy(self) -> str:
        """What ends the trouble, as the end of a sentence."""
        return '' if self._monitor is None else self._monitor.remedy

    @property
    def recoveries(self) -> int:
        """How often the servo's watchdog had stopped it and its goals were unlocked again."""
        return self._writer.recoveries

    @property
    def _max_speed_m_s(self) -> float:
        """The servo's velocity limit as tendon speed [m/s]."""
        return registers.velocity_to_m_s(self._writer.velocity_limit, self._config.pulley_radius_m)

    # -- life ----------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the bus and set the servo up; a tendon that was left taut is let out.

        Raises
        ------
        DeviceConnectionError
            When the servo does not answer for three seconds.
        DeviceRefusedError
            When it is not a supported servo, too old, or has a fault that a restart does not end.
        """
        self.close()
        bus, setup = open_servo(self._config)
        self._take_over(setup)
        self._servo = TendonServo(bus, self._config)
        self._monitor = ServoMonitor(
            bus,
            self._config,
            self._on_poll,
            self._on_state,
            self._on_loss,
            self._on_trouble,
            self._restore,
        )
        self._monitor.start()
        self._monitor.wait_poll(POLL_WAIT_S)

    def close(self) -> None:
        """Let the tendon out, then switch the torque off; harmless when called twice."""
        servo, monitor = self._servo, self._monitor
        if servo is None or monitor is None:
            return
        if not monitor.outage:
            self._let_out(monitor)
        bus = servo.bus
        with bus.lock:
            self._writer.number += 1  # ends a running pull
        monitor.close()
        self._servo = None
        with suppress(LinearGuideDriverError):
            bus.write(registers.TORQUE_ENABLE, 0)
            bus.write(registers.BUS_WATCHDOG, 0)
        bus.close()

    # -- goals ---------------------------------------------------------------------------

    def _begin(
        self, pull: Pull, speed_m_s: float, should_stop: Callable[[], bool]
    ) -> tuple[int, float, float]:
        """Write a new goal if safety admits it.

        Parameters
        ----------
        pull : Pull
            One with a target tension begins where the tendon is.
        speed_m_s : float
            [m/s]
        should_stop : callable
            Asked last; nothing moves when it returns True.

        Returns
        -------
        number : int
            Of the goal.
        start_m, goal_m : float
            Present displacement, and the goal [m].

        Raises
        ------
        MotionRefusedError, MotionStoppedError, DeviceConnectionError, DeviceRefusedError
        """
        servo, monitor = self._require_connection()
        with servo.bus.lock:
            # Asked under the lock that `hold_here` takes, too: a stop comes either before
            # the goal is written, and is seen here, or after it, and overrides it.
            if should_stop():
                raise MotionStoppedError('The pull was stopped before it began.')
            if pull.lets_out and monitor.outage:
                self.safety.release(RELEASED)  # carried out when the servo answers
            self._check_reachable(monitor)
            start_m = servo.read_displacement_m()
            now_ns = time.monotonic_ns()
            fault = f'{capitalise(monitor.fault)}; {monitor.remedy}.' if monitor.fault else ''
            self.safety.admit(pull, start_m, now_ns, fault)
            goal_m = pull.displacement_m
            if pull.lets_out:
                goal_m = min(self.safety.slack_m, start_m)
            if self.safety.decide(start_m, now_ns) is Order.FOLLOW:
                velocity = registers.m_s_to_velocity(speed_m_s, self._config.pulley_radius_m)
                self._writer.write_pull(servo, goal_m, velocity, lets_out=pull.lets_out)
            else:
                self._writer.carry_out(servo, start_m)
            return self._writer.number, start_m, goal_m

    def _watch(
        self, number: int, target: str, should_stop: Callable[[], bool]
    ) -> TendonState | None:
        """Return the next state of a goal that is still in force; None when none came in time.

        Raises
        ------
        MotionFailedError, MotionStoppedError
            When a fault, safety, ``should_stop`` or a later goal has ended it.
        """
        _, monitor = self._require_connection()
        state = monitor.wait_poll(POLL_WAIT_S)
        ending = self.safety.ending
        if ending is not None:
            self.supervise()  # before the pull is forgotten
            if ending is Ending.REACHED and self.safety.state is not State.RELEASING:
                return self.state
            error = MotionStoppedError if ending is Ending.STOPPED else MotionFailedError
            raise error(f'{self._describe_end(target)} {self.safety.reason}')
        if should_stop():
            self._stop_goal(number)
            raise MotionStoppedError(f'{self._describe_end(target)} {self.safety.reason}'.strip())
        if monitor.outage:
            raise MotionFailedError(f'The pull failed: {monitor.outage}.')
        if number != self._writer.number:
            raise MotionStoppedError(f'{self._describe_end(target)} {self.safety.reason}'.strip())
        return state

    def _stop_goal(self, number: int) -> None:
        """Hold the tendon where it is, unless a later command, as a release, is in force."""
        with self._commanding():
            if number == self._writer.number:
                self.hold_here()

    def _hold(self, number: int) -> None:
        """Hold the tendon where it is, unless a later command has come."""
        with self._commanding() as servo:
            if number == self._writer.number:
                self._writer.write(servo, servo.write_hold)

    def hold_here(self) -> None:
        """Hold the tendon where it is; above the limit it is let out instead.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        self._command(self.safety.stop, Order.HOLD)

    def request_release(
        self,
        end_pull: Callable[[], None] = lambda: None,
        reason: str = RELEASED,
    ) -> None:
        """Begin to let the tendon out as fast as the servo can; ends a running pull.

        While the servo cannot be reached this raises, and is carried out when it answers.

        Parameters
        ----------
        end_pull : callable
            Makes ``should_stop`` of a pull return True. Called under the bus's lock, so
            that no pull can hold the tendon before it is let out.
        reason : str

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """

        def tell() -> None:
            end_pull()
            self.safety.release(reason)

        self._command(tell, Order.RELEASE)

    def supervise(self) -> None:
        """Carry out what safety orders now; the next poll tries again what fails.

        A silent servo is left alone: a question that it hears would feed its bus watchdog,
        which is what stops it.
        """
        monitor = self._monitor
        if monitor is None or monitor.outage:
            return
        with suppress(LinearGuideDriverError), self._commanding() as servo:
            self._writer.carry_out(servo)

    def _shift_zero(self, shift_m: float) -> None:
        """Count displacements from ``shift_m`` further in, in the servo itself [m].

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        with self._commanding() as servo:  # so that no poll sees the torque off
            self._writer.number += 1
            servo.write_zero(shift_m)
            self.safety.set_zero(Zero.KNOWN)
        # So that no state counts from the old zero.
        self._require_connection()[1].wait_poll(POLL_WAIT_S)

    def _describe_end(self, target: str) -> str:
        """Return a sentence that says how far a pull came."""
        state = self.state
        at = 'an unknown position' if state is None else f'{state.displacement_m:.4f} m'
        return f'The pull ended at {at} on the way to {target}.'

    # -- inside --------------------------------------------------------------------------

    def _let_out(self, monitor: ServoMonitor) -> None:
        """Release and wait until the tendon is slack, for a while at the most."""
        deadline_s = time.monotonic() + LET_OUT_S
        tension_n = self.safety.live_tension_n(time.monotonic_ns())
        if self.safety.zero is Zero.UNKNOWN and tension_n is None:
            return  # nothing would tell where to end
        try:
            self.request_release(reason='The driver is closed: the tendon is let out.')
            while time.monotonic() < deadline_s:
                state = monitor.wait_poll(POLL_WAIT_S)
                if monitor.outage:
                    break
                if state and self.safety.is_slack(state.displacement_m, time.monotonic_ns()):
                    return
        except LinearGuideDriverError as error:
            _logger.error('the tendon may still be taut: %s', error)
        else:
            _logger.error('the tendon was not slack after %s s; it may still be taut', LET_OUT_S)

    def _require_connection(self) -> tuple[TendonServo, ServoMonitor]:
        servo, monitor = self._servo, self._monitor
        if servo is None or monitor is None:
            raise MotionRefusedError('The tendon actuator is not connected; connect it first.')
        return servo, monitor

    @contextmanager
    def _commanding(self) -> Iterator[TendonServo]:
        """Hold the bus's lock for a command to a servo that can be reached."""
        servo, monitor = self._require_connection()
        with servo.bus.lock:
            self._check_reachable(monitor)
            yield servo

    @staticmethod
    def _check_reachable(monitor: ServoMonitor) -> None:
        """Refuse a command while the torque is off or the connection is made again."""
        if monitor.is_lost or monitor.is_shut_down:
            raise MotionRefusedError(
                f'The tendon actuator cannot move: {monitor.outage}; {monitor.remedy}.'
            )

    def _take_over(self, setup: ServoSetup) -> None:
        """Begin with a servo that has just been set up."""
        self.identification = setup.identification
        self._writer.begin(setup.velocity_limit)
        self.temperature_limit_c = float(setup.temperature_limit_c)
        if setup.was_held and not setup.is_zero_kept:
            self.safety.set_zero(
                Zero.UNKNOWN, 'the servo held a tendon whose zero it does not know'
            )
        else:
            self.safety.set_zero(Zero.UNCONFIRMED)
        if setup.is_zero_kept:
            _logger.warning(RESTARTED)
            self.safety.release(RESTARTED)

    def _restore(self) -> None:
        """Open a lost line again; set the servo up if its torque went off. On the poll thread.

        A torque that has stayed on proves that the servo kept its zero. The next poll unlocks its
        goals and carries safety's order out.
        """
        servo, _ = self._require_connection()
        bus = servo.bus
        bus.open()
        is_kept = (
            bus.read(registers.TORQUE_ENABLE) != 0
            and bus.read(registers.OPERATING_MODE) == registers.MODE_CURRENT_BASED_POSITION
        )
        if is_kept or bus.read(registers.HARDWARE_ERROR):  # the poll tells the error
            return
        servo.forget_goal()  # or it would seem to be missed, and be written again
        self._take_over(set_up_servo(bus, self._config))

    def _on_loss(self, reason: str) -> None:
        self.safety.lose(f'{capitalise(reason)}.', time.monotonic_ns())

    def _on_poll(self, polled: registers.ServoState) -> TendonState:
        """Carry safety's order out with each new state, under the bus's lock."""
        servo, _ = self._require_connection()
        state = servo.to_state(polled, self._clock_ns())
        if not polled.is_torque_on:
            self.safety.set_zero(Zero.UNKNOWN, "the servo's torque went off")
        else:
            # Off: a command that sets it anew was cut off half way.
            is_tripped = polled.watchdog in (registers.WATCHDOG_TRIPPED, registers.WATCHDOG_OFF)
            if is_tripped:
                self._writer.recover(servo)
            has_missed = not is_tripped and servo.has_missed_goal(polled.goal_counts)
            number = self._writer.number
            self._writer.carry_out(servo, state.displacement_m)
            # Only if safety has ordered nothing else: the goal that was missed may wind in.
            if has_missed and number == self._writer.number:
                if number != self._repeated:
                    _logger.warning('the servo has missed a goal; it is written again')
                self._repeated = number
                servo.repeat_goal(lets_out=not self.safety.is_pulling)
        return state

    def _on_alarm(self, reason: str) -> None:
        self._require_connection()[1].tell_trouble(reason)

    def _on_written(self) -> None:
        self._require_connection()[1].clear()  # a command was heard, so the silence is over

    def _command(self, tell: Callable[[], None], order: Order) -> None:
        servo, monitor = self._require_connection()
        with servo.bus.lock:
            tell()
            self._check_reachable(monitor)
            self._writer.command(servo, order)
