# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes goals to the tendon's servo, and carries out what safety orders."""

from __future__ import annotations

from collections.abc import Callable
import time

from linear_guide_driver.dynamixel.servo_monitor import describe_watchdog
from linear_guide_driver.dynamixel.tendon_servo import TendonServo
from linear_guide_driver.errors import DeviceRefusedError
from linear_guide_driver.records import TendonActuatorConfig
from linear_guide_driver.safety.states import Order, Zero
from linear_guide_driver.safety.tendon_safety import TendonSafety


class GoalWriter:
    """Numbers the goals and remembers the order in force. Call it under the bus's lock.

    Parameters
    ----------
    on_alarm : callable
        Called with the reason when an order of safety is an alarm.
    on_written : callable
        Called when the servo has taken the goal of a new command.

    Attributes
    ----------
    number : int
        Grows with each goal written. A motion sees by it that its own goal has been replaced.
    velocity_limit : int
        Of the servo [velocity units].
    recoveries : int
        How often the servo's watchdog had stopped it and its goals were unlocked again.
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        safety: TendonSafety,
        on_alarm: Callable[[str], None],
        on_written: Callable[[], None],
    ) -> None:
        self._config, self._safety = config, safety
        self._on_alarm, self._on_written = on_alarm, on_written
        self._applied = Order.FOLLOW  # the last order that was carried out
        self.number = 0
        self.velocity_limit = 1
        self.recoveries = 0

    def begin(self, velocity_limit: int) -> None:
        """Start with a servo that has just been set up: no goal and no order are in force."""
        self.number += 1
        self.velocity_limit = velocity_limit
        self._applied = Order.FOLLOW

    def write_pull(
        self, servo: TendonServo, displacement_m: float, velocity: int, *, lets_out: bool = False
    ) -> None:
        """Write the goal of a pull that safety has admitted [m, velocity units]."""
        self._applied = Order.FOLLOW  # also if only the servo's answer is lost
        self.write(servo, lambda: servo.write_goal(displacement_m, velocity, lets_out=lets_out))

    def command(self, servo: TendonServo, order: Order) -> None:
        """Write the order of safety; where it has none, the one that was asked for."""
        self._applied = Order.FOLLOW  # a goal that is kept up may be in force
        if self.carry_out(servo) is Order.FOLLOW:
            self._apply(servo, order)

    def carry_out(self, servo: TendonServo, displacement_m: float | None = None) -> Order:
        """Ask safety for its order and write it, if it is not in force already; return it."""
        if displacement_m is None:
            displacement_m = servo.read_displacement_m()
        order = self._safety.decide(displacement_m, time.monotonic_ns())
        if order is not self._applied:
            self._apply(servo, order)
            if order is not Order.FOLLOW and self._safety.is_alarm:
                self._on_alarm(self._safety.reason)
        return order

    def _apply(self, servo: TendonServo, order: Order) -> None:
        if order is Order.HOLD:
            self.write(servo, servo.write_hold)
        elif order is Order.RELEASE:
            slack_m, velocity = self._safety.slack_m, self.velocity_limit
            self.write(servo, lambda: servo.write_goal(slack_m, velocity, lets_out=True))
        elif self._applied is Order.RELEASE and self._safety.zero is Zero.UNKNOWN:
            self.write(servo, servo.write_hold)  # slack by the sensor, before the goal
        self._applied = order

    def recover(self, servo: TendonServo) -> None:
        """Unlock the goals that the servo's watchdog has locked; the tendon is held there."""
        self.recoveries += 1
        if self._safety.is_pulling:
            self._safety.lose(f'{describe_watchdog(self._config)}.', time.monotonic_ns())
            self.number += 1
        servo.unlock()
        self._applied = Order.FOLLOW  # so that the present order is written again

    def write(self, servo: TendonServo, write: Callable[[], None]) -> None:
        """Write the goal of a new command, also when the watchdog has just acted."""
        self.number += 1
        try:
            write()
        except DeviceRefusedError:
            if not servo.is_locked():
                raise
            self.recoveries += 1
            servo.unlock()
            write()
        self._on_written()
