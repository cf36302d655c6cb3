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

"""The goals of the tendon's servo: each one numbered, so that a later one ends an earlier.

The servo's bus watchdog stops it when nothing is heard for a while, so a dead
driver or a cut line brings it to rest; the monitor's reads keep it fed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from linear_guide_driver import dynamixel_registers as registers
from linear_guide_driver.dynamixel_bus import DynamixelBus
from linear_guide_driver.errors import (
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.servo_monitor import describe_watchdog, ServoMonitor
from linear_guide_driver.tendon_setup import arm_watchdog, set_up_servo

POLL_WAIT_S = 1.0


class ServoGoals:
    """The servo in lengths of tendon, and who may move it; thread-safe.

    Parameters
    ----------
    config : TendonActuatorConfig
    on_state : callable
        Called with each `TendonState`, on the poll thread.
    clock_ns : callable
        Clock that stamps states [ns].
    on_trouble : callable
        Called with a reason as soon as a fault is noticed, also while nothing moves.

    Attributes
    ----------
    identification : str
        Model and firmware; empty before the first `connect`.
    temperature_limit_c : float
        At which the servo shuts down [degree Celsius].
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        on_state: Callable[[TendonState], None],
        clock_ns: Callable[[], int],
        on_trouble: Callable[[str], None],
    ) -> None:
        self._config = config
        self._on_state, self._on_trouble = on_state, on_trouble
        self._clock_ns = clock_ns
        self._sign = -1 if config.reverse else 1
        self._bus: DynamixelBus | None = None
        self._monitor: ServoMonitor | None = None
        self._slack_counts = 0
        self._velocity_limit = 1
        self._number = 0  # grows with each goal written; a motion sees when its own is gone
        self.identification = ''
        self.temperature_limit_c = 0.0

    @property
    def state(self) -> TendonState | None:
        """The last state; None before the first poll."""
        return None if self._monitor is None else self._monitor.state

    @property
    def trouble(self) -> str:
        """The fault that has ended motion; empty when there is none."""
        return '' if self._monitor is None else self._monitor.trouble

    @property
    def max_speed_m_s(self) -> float:
        """The servo's velocity limit as tendon speed [m/s]."""
        return registers.velocity_to_m_s(self._velocity_limit, self._config.pulley_radius_m)

    @property
    def monitor(self) -> ServoMonitor:
        """What reads the servo's state.

        Raises
        ------
        MotionRefusedError
            When the servo is not connected.
        """
        return self._require_connection()[1]

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
        self.temperature_limit_c = float(servo.temperature_limit_c)
        self._bus = bus
        self._monitor = ServoMonitor(bus, config, self._to_state, self._on_state, self._on_trouble)
        self._monitor.start()
        self._monitor.wait_poll(POLL_WAIT_S)

    def close(self) -> None:
        """Switch the torque off, so that the tendon goes slack; harmless when called twice."""
        bus, monitor = self._bus, self._monitor
        if bus is None or monitor is None:
            return
        with bus.lock:
            self._number += 1  # ends a running pull
            self._bus = None
        monitor.close()
        with suppress(LinearGuideDriverError):
            bus.write(registers.TORQUE_ENABLE, 0)
            bus.write(registers.BUS_WATCHDOG, 0)
        bus.close()

    # -- goals ---------------------------------------------------------------------------

    def begin(
        self, displacement_m: float | None, speed_m_s: float, should_stop: Callable[[], bool]
    ) -> tuple[int, float]:
        """Write a new goal; return its number and where the tendon was then [m].

        Parameters
        ----------
        displacement_m : float or None
            [m]; None: where the tendon is.
        speed_m_s : float
            [m/s]
        should_stop : callable
            Asked last; nothing moves when it returns True.

        Raises
        ------
        MotionRefusedError, MotionStoppedError, DeviceConnectionError, DeviceRefusedError
        """
        bus, _ = self._require_sound()
        with bus.lock:
            # Asked under the lock that `hold_here` takes, too: a stop comes either before
            # the goal is written, and is seen here, or after it, and overrides it.
            if should_stop():
                raise MotionStoppedError('The pull was stopped before it began.')
            start_m = self._to_displacement_m(bus.read(registers.PRESENT_POSITION))
            counts = self._to_counts(start_m if displacement_m is None else displacement_m)
            velocity = registers.m_s_to_velocity(speed_m_s, self._config.pulley_radius_m)
            self._command(bus, lambda: self._write_goal(bus, counts, velocity))
            return self._number, start_m

    def watch(
        self, number: int, target: str, should_stop: Callable[[], bool]
    ) -> TendonState | None:
        """Return the next state of a goal that is still in force; None when none came in time.

        Raises
        ------
        MotionFailedError, MotionStoppedError
            When a fault, ``should_stop`` or a later goal has ended it.
        """
        _, monitor = self._require_connection()
        state = monitor.wait_poll(POLL_WAIT_S)
        if should_stop():
            self.hold(number)
            raise MotionStoppedError(self.describe_end(target))
        if monitor.trouble:
            raise MotionFailedError(f'The pull failed: {monitor.trouble}.')
        if number != self._number:
            raise MotionStoppedError(self.describe_end(target))
        return state

    def follow(self, number: int, displacement_m: float) -> bool:
        """Shift a goal that is still in force; return whether it is."""
        bus = self._bus
        if bus is None:
            return False
        with bus.lock:
            if number != self._number:
                return False
            try:
                bus.write(registers.GOAL_POSITION, self._to_counts(displacement_m))
            except DeviceRefusedError as error:
                self._require_watchdog_tripped(bus, error)
                raise DeviceRefusedError(describe_watchdog(self._config)) from error
            return True

    def hold(self, number: int) -> None:
        """Hold the tendon where it is, unless a later command has come."""
        bus = self._bus
        if bus is not None:
            with bus.lock:
                if number == self._number:
                    self._command(bus, lambda: self._write_hold(bus))

    def hold_here(self) -> None:
        """Hold the tendon where it is, at once; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        bus, _ = self._require_sound()
        with bus.lock:
            self._command(bus, lambda: self._write_hold(bus))

    def request_release(self) -> None:
        """Begin to let the tendon out as fast as the servo can; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        bus, _ = self._require_sound()
        with bus.lock:
            self._command(
                bus, lambda: self._write_goal(bus, self._slack_counts, self._velocity_limit)
            )

    def shift_zero(self, shift_m: float) -> None:
        """Count displacements from ``shift_m`` further in [m]."""
        self._slack_counts = self._to_counts(shift_m)

    def describe_end(self, target: str) -> str:
        """Return a sentence that says how far a pull came."""
        state = self.state
        at = 'an unknown position' if state is None else f'{state.displacement_m:.4f} m'
        return f'The pull ended at {at} on the way to {target}.'

    # -- inside --------------------------------------------------------------------------

    def _require_connection(self) -> tuple[DynamixelBus, ServoMonitor]:
        bus, monitor = self._bus, self._monitor
        if bus is None or monitor is None:
            raise MotionRefusedError('The tendon actuator is not connected; connect it first.')
        return bus, monitor

    def _require_sound(self) -> tuple[DynamixelBus, ServoMonitor]:
        bus, monitor = self._require_connection()
        if monitor.needs_connect:
            raise MotionRefusedError(
                f'The tendon actuator cannot move: {monitor.trouble}; remove the cause and '
                'configure the driver again.'
            )
        return bus, monitor

    def _command(self, bus: DynamixelBus, write: Callable[[], None]) -> None:
        """Carry out a fresh command, which may follow a fault: it frees the goals."""
        monitor = self.monitor
        if monitor.trouble:
            self._free_goals(bus, monitor)
        try:
            write()
        except DeviceRefusedError as error:
            # The watchdog may have acted since the last poll, on a host that was busy.
            self._require_watchdog_tripped(bus, error)
            monitor.fail(describe_watchdog(self._config))
            self._free_goals(bus, monitor)
            write()

    def _free_goals(self, bus: DynamixelBus, monitor: ServoMonitor) -> None:
        """Unlock the goals that a watchdog has locked, with the goal where the servo stands."""
        bus.write(registers.BUS_WATCHDOG, 0)
        self._write_hold(bus)
        arm_watchdog(bus, self._config.watchdog_s)
        monitor.clear()

    @staticmethod
    def _require_watchdog_tripped(bus: DynamixelBus, error: DeviceRefusedError) -> None:
        if bus.read(registers.BUS_WATCHDOG) != registers.WATCHDOG_TRIPPED:
            raise error

    def _write_goal(self, bus: DynamixelBus, counts: int, velocity: int) -> None:
        bus.write(registers.PROFILE_VELOCITY, velocity)
        bus.write(registers.GOAL_POSITION, counts)
        self._number += 1

    def _write_hold(self, bus: DynamixelBus) -> None:
        bus.write(registers.GOAL_POSITION, bus.read(registers.PRESENT_POSITION))
        self._number += 1

    def _to_state(self, servo: registers.ServoState) -> TendonState:
        radius_m = self._config.pulley_radius_m
        return TendonState(
            displacement_m=self._to_displacement_m(servo.position_counts),
            velocity_m_s=self._sign * registers.velocity_to_m_s(servo.velocity, radius_m),
            current_a=self._sign * registers.current_to_a(servo.current),
            voltage_v=servo.voltage * registers.VOLTAGE_UNIT_V,
            temperature_c=float(servo.temperature_c),
            received_at_ns=self._clock_ns(),
        )

    def _to_counts(self, displacement_m: float) -> int:
        return self._slack_counts + self._sign * registers.m_to_counts(
            displacement_m, self._config.pulley_radius_m
        )

    def _to_displacement_m(self, position_counts: int) -> float:
        return self._sign * registers.counts_to_m(
            position_counts - self._slack_counts, self._config.pulley_radius_m
        )
