# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tendon actuator: a Dynamixel XM430 in current-based position mode.

The servo's bus watchdog stops it when nothing is heard for a while, so a dead
driver or a cut line brings it to rest; the poll thread's reads keep it fed.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from linear_guide_driver import dynamixel_registers as registers
from linear_guide_driver.dynamixel_bus import DynamixelBus, SilentServoError
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.tendon_setup import arm_watchdog, set_up_servo

POSITION_TOLERANCE_M = 0.0005
"""How far from its goal a finished pull may rest: the loop yields a little under load."""

SLACK_S = 1.0
"""Added to the computed duration of a pull before it counts as stuck."""

SILENT_POLLS = 5
"""Polls in a row without an answer after which the servo counts as silent: about 0.2 s.

Fewer ended pulls on a busy host, where an answer can be late three times in a row.
"""

_logger = logging.getLogger(__name__)


def _never() -> bool:
    return False


class TendonActuatorClient:
    """Blocking, thread-safe client of the tendon's servo; one pull at a time.

    The displacement is 0 where the servo stands when `connect` returns: connect
    with the tendon slack. `close` switches the torque off, so the tendon goes slack.

    Parameters
    ----------
    config : TendonActuatorConfig
    on_state : callable, optional
        Called with each `TendonState`, on the poll thread.
    clock_ns : callable, optional
        Clock that stamps states [ns].
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        on_state: Callable[[TendonState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._config = config
        self._on_state = on_state
        self._clock_ns = clock_ns
        self._sign = -1 if config.reverse else 1
        self._bus: DynamixelBus | None = None
        self._slot = threading.Lock()  # held by the one pull
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._slack_counts = 0
        self._velocity_limit = 1
        self._goal_number = 0  # grows with each goal written; a pull sees when its own is gone
        self._state: TendonState | None = None
        self._polls = 0
        self._trouble = ''
        self._needs_connect = False
        self.identification = ''

    # -- what is known -------------------------------------------------------------------

    @property
    def state(self) -> TendonState | None:
        """The last state; None before the first poll."""
        return self._state

    @property
    def trouble(self) -> str:
        """The fault that has ended motion; empty when there is none."""
        return self._trouble

    @property
    def max_speed_m_s(self) -> float:
        """The servo's velocity limit as tendon speed [m/s]."""
        return registers.velocity_to_m_s(self._velocity_limit, self._config.pulley_radius_m)

    # -- life ----------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the bus, set the servo up and hold the tendon where it is, as slack.

        Raises
        ------
        DeviceConnectionError
            When the servo does not answer.
        DeviceRefusedError
            When it is not a supported servo, too old, or reports a hardware error.
        """
        self.close()
        config = self._config
        bus = DynamixelBus(config.port, config.baud, config.device_id)
        try:
            servo = set_up_servo(bus, config)
        except LinearGuideDriverError:
            with suppress(LinearGuideDriverError):
                bus.write(registers.TORQUE_ENABLE, 0)
            bus.close()
            raise
        self.identification = servo.identification
        self._velocity_limit, self._slack_counts = servo.velocity_limit, servo.position_counts
        self._bus, self._state, self._trouble, self._needs_connect = bus, None, '', False
        self._closing.clear()
        self._thread = threading.Thread(
            target=self._poll, args=(bus,), name='tendon poll', daemon=True
        )
        self._thread.start()
        self._wait_poll(1.0)

    def close(self) -> None:
        """Switch the torque off, so that the tendon goes slack; harmless when called twice."""
        bus = self._bus
        if bus is None:
            return
        with bus.lock:
            self._goal_number += 1  # ends a running pull
            self._bus = None
        with self._changed:
            self._closing.set()
            self._changed.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(2.0)
        with suppress(LinearGuideDriverError):
            bus.write(registers.TORQUE_ENABLE, 0)
            bus.write(registers.BUS_WATCHDOG, 0)
        bus.close()

    # -- motion --------------------------------------------------------------------------

    def pull_to(
        self,
        displacement_m: float,
        speed_m_s: float = 0.0,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = _never,
    ) -> TendonState:
        """Wind the tendon to a displacement and keep it there; return the state at rest.

        Parameters
        ----------
        displacement_m : float
            From the slack reference [m].
        speed_m_s : float
            [m/s]; 0: the configured default.
        on_state : callable
            Called with each new state while the tendon moves.
        should_stop : callable
            Ends the pull when it returns True; the tendon is held where it is.

        Raises
        ------
        MotionRefusedError
            Out of range, busy, or the driver must be connected anew; nothing has moved.
        MotionFailedError
            Ended by a fault.
        MotionStoppedError
            Ended by ``should_stop``, `hold_here` or `request_release`.
        """
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError('The tendon is busy with another pull; stop it first.')
        try:
            return self._pull(displacement_m, speed_m_s, on_state, should_stop)
        except (DeviceConnectionError, DeviceRefusedError) as error:
            self._fail(str(error))
            raise MotionFailedError(f'The pull failed: {error}.') from error
        except LinearGuideDriverError:
            raise
        except BaseException:  # a fault of the caller's functions: nobody watches the pull now
            with suppress(LinearGuideDriverError):
                self.hold_here()
            raise
        finally:
            self._slot.release()

    def release(self) -> TendonState:
        """Let the tendon out to the slack reference at the default speed."""
        return self.pull_to(0.0)

    def hold_here(self) -> None:
        """Hold the tendon where it is, at once; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        bus = self._require_bus()
        with bus.lock:
            self._make_ready(bus)
            self._write_hold(bus)

    stop = hold_here

    def request_release(self) -> None:
        """Begin to let the tendon out as fast as the servo can; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        bus = self._require_bus()
        with bus.lock:
            self._make_ready(bus)
            self._write_goal(bus, self._slack_counts, self._velocity_limit)

    # -- inside: motion ------------------------------------------------------------------

    def _pull(
        self,
        displacement_m: float,
        speed_m_s: float,
        on_state: Callable[[TendonState], None],
        should_stop: Callable[[], bool],
    ) -> TendonState:
        config = self._config
        speed_m_s = speed_m_s or config.speed_m_s
        if not 0.0 <= displacement_m <= config.max_displacement_m:
            raise MotionRefusedError(
                f'Displacement {displacement_m} m must be between 0 and max_displacement_m, '
                f'{config.max_displacement_m} m.'
            )
        if not 0.0 < speed_m_s <= self.max_speed_m_s * (1 + 1e-9):
            raise MotionRefusedError(
                f"Speed {speed_m_s} m/s must be above 0 and at most the servo's limit of "
                f'{self.max_speed_m_s:.4f} m/s.'
            )
        bus = self._require_bus()
        counts = registers.m_to_counts(displacement_m, config.pulley_radius_m)
        with bus.lock:
            # Asked under the lock that `hold_here` takes, too: a stop comes either before
            # the goal is written, and is seen here, or after it, and overrides it.
            if should_stop():
                raise MotionStoppedError('The pull was stopped before it began.')
            self._make_ready(bus)
            start_m = self._to_displacement_m(bus.read(registers.PRESENT_POSITION))
            goal = self._write_goal(
                bus,
                self._slack_counts + self._sign * counts,
                registers.m_s_to_velocity(speed_m_s, config.pulley_radius_m),
            )
        deadline_s = time.monotonic() + abs(displacement_m - start_m) / speed_m_s + SLACK_S
        while True:
            state = self._wait_poll(SLACK_S)
            if should_stop():
                with bus.lock:
                    if goal == self._goal_number:
                        self._write_hold(bus)
                raise MotionStoppedError(self._describe_end(displacement_m))
            if self._trouble:
                raise MotionFailedError(f'The pull failed: {self._trouble}.')
            if goal != self._goal_number:
                raise MotionStoppedError(self._describe_end(displacement_m))
            if state is not None:
                on_state(state)
                one_unit = registers.velocity_to_m_s(1, config.pulley_radius_m)
                if (
                    abs(state.displacement_m - displacement_m) <= POSITION_TOLERANCE_M
                    and abs(state.velocity_m_s) <= 1.5 * one_unit
                ):
                    return state
            if time.monotonic() > deadline_s:
                end = self._describe_end(displacement_m)
                self.request_release()
                raise MotionFailedError(
                    f'{end} It got no further with {config.current_limit_a} A; '
                    'the tendon is released.'
                )

    def _describe_end(self, target_m: float) -> str:
        state = self._state
        at = 'an unknown position' if state is None else f'{state.displacement_m:.4f} m'
        return f'The pull ended at {at} on the way to {target_m:.4f} m.'

    def _require_bus(self) -> DynamixelBus:
        bus = self._bus
        if bus is None:
            raise MotionRefusedError('The tendon actuator is not connected; connect it first.')
        if self._needs_connect:
            raise MotionRefusedError(
                f'The tendon actuator cannot move: {self._trouble}; remove the cause and '
                'configure the driver again.'
            )
        return bus

    def _make_ready(self, bus: DynamixelBus) -> None:
        """Take a fresh command after a fault: free the goals, with the goal where it stands."""
        if self._trouble:
            bus.write(registers.BUS_WATCHDOG, 0)
            self._write_hold(bus)
            arm_watchdog(bus, self._config.watchdog_s)
            with self._changed:
                self._trouble = ''
                self._changed.notify_all()

    def _write_goal(self, bus: DynamixelBus, counts: int, velocity: int) -> int:
        bus.write(registers.PROFILE_VELOCITY, velocity)
        bus.write(registers.GOAL_POSITION, counts)
        self._goal_number += 1
        return self._goal_number

    def _write_hold(self, bus: DynamixelBus) -> None:
        bus.write(registers.GOAL_POSITION, bus.read(registers.PRESENT_POSITION))
        self._goal_number += 1

    # -- inside: polling -----------------------------------------------------------------

    def _poll(self, bus: DynamixelBus) -> None:
        period_s = 1.0 / self._config.poll_rate_hz
        due_s = time.monotonic()
        silent_polls = 0
        while not self._closing.wait(max(0.0, due_s - time.monotonic())):
            due_s = max(due_s + period_s, time.monotonic())
            state = None
            try:
                with bus.lock:  # a fault is judged before a fresh command can clear it
                    block = bus.read_block(registers.STATE_BLOCK)
                    state = self._take(registers.decode_state(block))
                silent_polls = 0
            except SilentServoError as error:
                silent_polls += 1
                if silent_polls == SILENT_POLLS:
                    self._fail(f'the servo is silent ({error})')
                    silent_polls = 0
                    # It may still hear us: say nothing until its watchdog has stopped it,
                    # or until a fresh command has been heard.
                    with self._changed:
                        self._changed.wait_for(
                            lambda: not self._trouble or self._closing.is_set(),
                            2 * self._config.watchdog_s,
                        )
            except LinearGuideDriverError as error:
                self._fail(str(error), needs_connect=True)
                return
            if state is not None:
                self._report(state)

    def _report(self, state: TendonState) -> None:
        try:
            self._on_state(state)
        except Exception:  # the poll must outlive it: it feeds the watchdog
            _logger.exception('the consumer of the tendon states failed')

    def _take(self, servo: registers.ServoState) -> TendonState:
        radius_m = self._config.pulley_radius_m
        state = TendonState(
            displacement_m=self._to_displacement_m(servo.position_counts),
            velocity_m_s=self._sign * registers.velocity_to_m_s(servo.velocity, radius_m),
            current_a=self._sign * registers.current_to_a(servo.current),
            voltage_v=servo.voltage * registers.VOLTAGE_UNIT_V,
            temperature_c=float(servo.temperature_c),
            received_at_ns=self._clock_ns(),
        )
        if servo.hardware_error:
            words = registers.describe_hardware_error(servo.hardware_error)
            self._fail(f'the servo has shut down: {words}', needs_connect=True)
        elif not servo.is_torque_on:
            self._fail(
                "the servo's torque went off, so the slack reference is lost", needs_connect=True
            )
        elif servo.watchdog == registers.WATCHDOG_TRIPPED:
            self._fail(
                f"the servo's watchdog has stopped it after {self._config.watchdog_s} s of silence"
            )
        with self._changed:
            self._state = state
            self._polls += 1
            self._changed.notify_all()
        return state

    def _fail(self, reason: str, needs_connect: bool = False) -> None:
        with self._changed:
            self._trouble = self._trouble or reason
            self._needs_connect = self._needs_connect or needs_connect
            self._changed.notify_all()

    def _wait_poll(self, timeout_s: float) -> TendonState | None:
        """Return the next state, or None when a fault or the timeout came first."""
        with self._changed:
            count = self._polls
            self._changed.wait_for(lambda: self._polls > count or bool(self._trouble), timeout_s)
            return self._state if self._polls > count else None

    def _to_displacement_m(self, position_counts: int) -> float:
        return self._sign * registers.counts_to_m(
            position_counts - self._slack_counts, self._config.pulley_radius_m
        )
