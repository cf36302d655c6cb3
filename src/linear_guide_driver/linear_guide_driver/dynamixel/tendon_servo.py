# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The servo in lengths of tendon: what is written to it and read from it."""

from __future__ import annotations

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import DynamixelBus
from linear_guide_driver.dynamixel.tendon_setup import arm_watchdog, write_zero
from linear_guide_driver.records import TendonActuatorConfig, TendonState


class TendonServo:
    """Registers of one servo as displacements; its count is 0 where the tendon is slack.

    Hold ``bus.lock`` around calls that belong together.
    """

    def __init__(self, bus: DynamixelBus, config: TendonActuatorConfig) -> None:
        self.bus = bus
        self._config = config
        self._sign = -1 if config.reverse else 1
        self._goal_counts: int | None = None  # the last one, if the servo has acknowledged it
        self._lets_out = False  # whether the last goal must not wind in

    def read_displacement_m(self) -> float:
        """Return the present displacement [m]."""
        return self._to_displacement_m(self.bus.read(registers.PRESENT_POSITION))

    def is_locked(self) -> bool:
        """Return whether the servo's watchdog has locked its goals."""
        return self.bus.read(registers.BUS_WATCHDOG) == registers.WATCHDOG_TRIPPED

    def write_goal(
        self, displacement_m: float, velocity: int | None = None, *, lets_out: bool = False
    ) -> None:
        """Wind to a displacement.

        Parameters
        ----------
        displacement_m : float
            [m]
        velocity : int, optional
            In the servo's units.
        lets_out : bool
            A tendon that is further out already is held there.
        """
        if velocity is not None:
            self.bus.write(registers.PROFILE_VELOCITY, velocity)
        if lets_out:
            displacement_m = min(displacement_m, self.read_displacement_m())
        self._write_counts(self._to_counts(displacement_m), lets_out=lets_out)

    def write_hold(self) -> None:
        """Hold where the servo stands."""
        self._write_counts(self.bus.read(registers.PRESENT_POSITION), lets_out=True)

    def has_missed_goal(self, goal_counts: int) -> bool:
        """Return whether the servo holds another goal than it has acknowledged.

        The protocol does not number its packets. If the answer to one write comes late and the
        packet of the next write is lost, the late answer seems to acknowledge that one.

        Parameters
        ----------
        goal_counts : int
            The goal that the servo holds, polled after the last write [counts].
        """
        return self._goal_counts not in (None, goal_counts)

    def forget_goal(self) -> None:
        """Forget the last goal: somebody else has written another one."""
        self._goal_counts = None

    def repeat_goal(self, *, lets_out: bool) -> None:
        """Write the last goal again; the servo may have moved on meanwhile.

        Parameters
        ----------
        lets_out : bool
            Whatever the goal was, do not wind in.
        """
        if self._goal_counts is not None:
            displacement_m = self._to_displacement_m(self._goal_counts)
            self.write_goal(displacement_m, lets_out=lets_out or self._lets_out)

    def unlock(self) -> None:
        """Unlock goals that the watchdog has locked, with the goal where the servo stands."""
        self.bus.write(registers.BUS_WATCHDOG, 0)
        self.write_hold()
        arm_watchdog(self.bus, self._config.watchdog_s)

    def write_zero(self, displacement_m: float) -> None:
        """Make a displacement the servo's zero [m]; the torque is off for some milliseconds."""
        self.bus.write(registers.BUS_WATCHDOG, 0)
        self.bus.write(registers.TORQUE_ENABLE, 0)
        write_zero(self.bus, self._to_counts(displacement_m))
        self.write_hold()
        self.bus.write(registers.TORQUE_ENABLE, 1)
        arm_watchdog(self.bus, self._config.watchdog_s)

    def to_state(self, servo: registers.ServoState, received_at_ns: int) -> TendonState:
        """Return a polled state in lengths of tendon."""
        radius_m = self._config.pulley_radius_m
        return TendonState(
            displacement_m=self._to_displacement_m(servo.position_counts),
            velocity_m_s=self._sign * registers.velocity_to_m_s(servo.velocity, radius_m),
            current_a=self._sign * registers.current_to_a(servo.current),
            voltage_v=servo.voltage * registers.VOLTAGE_UNIT_V,
            temperature_c=float(servo.temperature_c),
            received_at_ns=received_at_ns,
        )

    def _write_counts(self, goal_counts: int, *, lets_out: bool) -> None:
        self._goal_counts = None  # not known if the servo does not answer
        self._lets_out = lets_out
        self.bus.write(registers.GOAL_POSITION, goal_counts)
        self._goal_counts = goal_counts

    def _to_counts(self, displacement_m: float) -> int:
        return self._sign * registers.m_to_counts(displacement_m, self._config.pulley_radius_m)

    def _to_displacement_m(self, position_counts: int) -> float:
        return self._sign * registers.counts_to_m(position_counts, self._config.pulley_radius_m)
