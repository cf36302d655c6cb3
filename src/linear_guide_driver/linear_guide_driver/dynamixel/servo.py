# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon's servo: set up so that it may pull, then moved in lengths of tendon."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import logging
import math
import time
from typing import NamedTuple

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import DynamixelBus, SilentServoError
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState

SETTLING_S = 3.0
SETTLING_PERIOD_S = 0.1
SETTLED_COUNTS = 2

CONNECT_S = 3.0
"""A servo that does not answer at once is asked again for so long: it may be restarting."""

CONNECT_PAUSE_S = 0.2

REBOOT_S = 3.0
"""A restarted servo is silent for some 0.3 s."""

SLACK_BELOW_M = 0.001
"""A tendon found this far below its zero cannot be one that was wound in from it."""

ZERO_COUNTS = 2
"""A zero that is off by so little is not written again: the EEPROM wears out."""

_logger = logging.getLogger(__name__)


class ServoSetup(NamedTuple):
    """A servo that is ready and holds its position; its count is 0 where the tendon is slack.

    ``was_held`` tells that the servo was holding a tendon: a driver has ended without letting it
    out. ``is_zero_kept`` tells that the zero is the one that this driver has written, and the
    servo has not lost power since. Otherwise it is where the tendon came to rest with the torque
    off.
    """

    identification: str  # model and firmware
    velocity_limit: int  # in the servo's units
    temperature_limit_c: int
    was_held: bool
    is_zero_kept: bool


def open_servo(config: TendonActuatorConfig) -> tuple[DynamixelBus, ServoSetup]:
    """Open the bus and set the servo up; ask again for `CONNECT_S` if it does not answer.

    Raises `DeviceConnectionError`, and what `set_up_servo` raises; the bus is closed then.
    """
    deadline_s = time.monotonic() + CONNECT_S
    while True:
        bus = DynamixelBus(config.port, config.baud, config.device_id)
        try:
            return bus, set_up_servo(bus, config)
        except DeviceConnectionError as error:
            bus.close()
            if time.monotonic() > deadline_s:
                raise
            _logger.warning('%s; asking again', error)
        except DeviceRefusedError:
            with suppress(LinearGuideDriverError):
                bus.write(registers.TORQUE_ENABLE, 0)
            bus.close()
            raise
        time.sleep(CONNECT_PAUSE_S)


def set_up_servo(bus: DynamixelBus, config: TendonActuatorConfig) -> ServoSetup:
    """Check the servo, set its mode, limits and zero, hold it where it stands.

    Raises `DeviceRefusedError` when it is not a supported servo, is too old, reports a hardware
    error that a restart does not end, or its limits are below those of the configuration.
    """
    identification = _check_servo(bus, config.device_id)
    velocity_limit = bus.read(registers.VELOCITY_LIMIT)
    if registers.m_s_to_velocity(config.speed_m_s, config.pulley_radius_m) > velocity_limit:
        fastest_m_s = registers.velocity_to_m_s(velocity_limit, config.pulley_radius_m)
        raise DeviceRefusedError(
            f'speed_m_s is {config.speed_m_s} and the servo allows {fastest_m_s:.4f} m/s; lower it'
        )
    temperature_limit_c = bus.read(registers.TEMPERATURE_LIMIT)
    current = registers.a_to_current(config.current_limit_a)
    current_limit = bus.read(registers.CURRENT_LIMIT)
    if current > current_limit:
        raise DeviceRefusedError(
            f'current_limit_a is {config.current_limit_a} and the servo allows '
            f'{registers.current_to_a(current_limit):.3f} A; lower it'
        )

    was_held = bus.read(registers.TORQUE_ENABLE) != 0
    is_zero_kept = was_held and _is_zero_kept(bus, config)
    bus.write(registers.BUS_WATCHDOG, 0)  # a tripped watchdog locks the goals
    if not is_zero_kept:
        if was_held:
            bus.write(registers.TORQUE_ENABLE, 0)
        _wait_settled(bus)  # also with the torque off already: it may be off since just now
        for register, value in (
            (registers.DRIVE_MODE, 0),
            (registers.OPERATING_MODE, registers.MODE_CURRENT_BASED_POSITION),
        ):
            if bus.read(register) != value:  # EEPROM wears out
                bus.write(register, value)
        _write_zero(bus)
    # A change of mode resets these, so they come after it.
    bus.write(registers.GOAL_CURRENT, current)
    bus.write(registers.PROFILE_ACCELERATION, 0)
    bus.write(registers.GOAL_POSITION, bus.read(registers.PRESENT_POSITION))
    if not is_zero_kept:
        bus.write(registers.TORQUE_ENABLE, 1)
    arm_watchdog(bus, config.watchdog_s)  # works only with the torque on
    return ServoSetup(identification, velocity_limit, temperature_limit_c, was_held, is_zero_kept)


def _write_zero(bus: DynamixelBus, zero_counts: int | None = None) -> None:
    """Make a position the servo's zero, in its homing offset; the torque must be off.

    The servo keeps its position over turns for as long as it has power, and its torque is off
    after it has lost it. So a torque that is on proves that the zero still holds.
    ``zero_counts`` is in the present count; the present position when left out.
    """
    if zero_counts is None:
        zero_counts = bus.read(registers.PRESENT_POSITION)
    if abs(zero_counts) > ZERO_COUNTS:
        bus.write(registers.HOMING_OFFSET, bus.read(registers.HOMING_OFFSET) - zero_counts)


def _is_zero_kept(bus: DynamixelBus, config: TendonActuatorConfig) -> bool:
    """Return whether a servo with its torque on was set up by this driver and kept its zero."""
    if (
        bus.read(registers.OPERATING_MODE) != registers.MODE_CURRENT_BASED_POSITION
        or bus.read(registers.BUS_WATCHDOG) == 0
    ):
        return False
    counts = bus.read(registers.PRESENT_POSITION) * (-1 if config.reverse else 1)
    displacement_m = registers.counts_to_m(counts, config.pulley_radius_m)
    return -SLACK_BELOW_M <= displacement_m <= config.max_displacement_m + SLACK_BELOW_M


def arm_watchdog(bus: DynamixelBus, watchdog_s: float) -> None:
    """Make the servo stop by itself when it hears nothing for ``watchdog_s`` [s]."""
    bus.write(registers.BUS_WATCHDOG, math.ceil(watchdog_s / registers.WATCHDOG_STEP_S - 1e-9))


def _check_servo(bus: DynamixelBus, device_id: int) -> str:
    model = bus.ping()
    if model not in registers.MODELS:
        raise DeviceRefusedError(
            f'servo {device_id} has model number {model}; supported are '
            f'{", ".join(registers.MODELS.values())}'
        )
    firmware = bus.read(registers.FIRMWARE)
    if firmware < registers.FIRMWARE_WITH_WATCHDOG:
        raise DeviceRefusedError(
            f'servo {device_id} has firmware {firmware} without bus watchdog; update it to '
            f'{registers.FIRMWARE_WITH_WATCHDOG} or later'
        )
    if word := bus.read(registers.HARDWARE_ERROR):
        _reboot(bus, device_id, registers.format_hardware_error(word))
    if bus.read(registers.STATUS_RETURN_LEVEL) != registers.STATUS_ALWAYS:
        raise DeviceRefusedError(
            f'servo {device_id} does not answer every instruction; set its status return level '
            f'to {registers.STATUS_ALWAYS}'
        )
    return f'Dynamixel {registers.MODELS[model]} firmware {firmware}'


def _reboot(bus: DynamixelBus, device_id: int, words: str) -> None:
    """Restart a servo that has shut down; only that ends it, and what ails it comes again."""
    _logger.warning('servo %d has shut down: %s; restarting it', device_id, words)
    bus.reboot()
    deadline_s = time.monotonic() + REBOOT_S
    while True:
        time.sleep(SETTLING_PERIOD_S)
        try:
            word = bus.read(registers.HARDWARE_ERROR)
            break
        except SilentServoError:
            if time.monotonic() > deadline_s:
                raise
    if word:
        raise DeviceRefusedError(
            f'servo {device_id} has shut down: {registers.format_hardware_error(word)}, and a '
            'restart did not help; remove the cause, let it cool, and configure the driver again'
        )


def _wait_settled(bus: DynamixelBus) -> None:
    # The finger's spring unwinds a tendon that was held; slack is where that ends.
    deadline_s = time.monotonic() + SETTLING_S
    last = bus.read(registers.PRESENT_POSITION)
    while time.monotonic() < deadline_s:
        time.sleep(SETTLING_PERIOD_S)
        now = bus.read(registers.PRESENT_POSITION)
        if abs(now - last) <= SETTLED_COUNTS:
            return
        last = now
    raise DeviceRefusedError('the tendon does not come to rest with the torque off')


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
        return self._to_displacement_m(self._read_counts())

    def is_locked(self) -> bool:
        """Return whether the servo's watchdog has locked its goals."""
        return self.bus.read(registers.BUS_WATCHDOG) == registers.WATCHDOG_TRIPPED

    def write_goal(
        self, displacement_m: float, velocity: int | None = None, *, lets_out: bool = False
    ) -> None:
        """Wind to a displacement [m] at a velocity in the servo's units.

        With ``lets_out`` a tendon that is further out already is held there.
        """
        if velocity is not None:
            self.bus.write(registers.PROFILE_VELOCITY, velocity)
        goal = self._to_counts(displacement_m)

        def find() -> int:
            if not lets_out:
                return goal
            return self._sign * min(self._sign * goal, self._sign * self._read_counts())

        self._write_counts(find, lets_out=lets_out)

    def write_hold(self) -> None:
        """Hold where the servo stands."""
        self._write_counts(self._read_counts, lets_out=True)

    def has_missed_goal(self, goal_counts: int) -> bool:
        """Return whether the servo, polled after the last write, holds another goal than that.

        The protocol does not number its packets. If the answer to one write comes late and the
        packet of the next write is lost, the late answer seems to acknowledge that one.
        """
        return self._goal_counts not in (None, goal_counts)

    def repeat_goal(self, *, lets_out: bool) -> None:
        """Write the last goal again; with ``lets_out`` do not wind in, whatever it was."""
        if self._goal_counts is not None:
            displacement_m = self._to_displacement_m(self._goal_counts)
            self.write_goal(displacement_m, lets_out=lets_out or self._lets_out)

    def unlock(self) -> None:
        """Unlock goals that the watchdog has locked, with the goal where the servo stands."""
        self.bus.write(registers.BUS_WATCHDOG, 0)
        self.write_hold()
        arm_watchdog(self.bus, self._config.watchdog_s)

    def restore(self) -> ServoSetup | None:
        """Open a lost line again; set the servo up if its torque went off, and return that.

        A torque that has stayed on proves that the servo kept its zero.
        """
        self.bus.open()
        is_kept = (
            self.bus.read(registers.TORQUE_ENABLE) != 0
            and self.bus.read(registers.OPERATING_MODE) == registers.MODE_CURRENT_BASED_POSITION
        )
        if is_kept or self.bus.read(registers.HARDWARE_ERROR):  # the poll tells the error
            return None
        self._goal_counts = None  # or it would seem to be missed, and be written again
        return set_up_servo(self.bus, self._config)

    def switch_off(self) -> None:
        """Switch the torque off and close the bus."""
        with suppress(LinearGuideDriverError):
            self.bus.write(registers.TORQUE_ENABLE, 0)
            self.bus.write(registers.BUS_WATCHDOG, 0)
        self.bus.close()

    def write_zero(self, displacement_m: float) -> None:
        """Make a displacement the servo's zero [m]; the torque is off for some milliseconds."""
        self.bus.write(registers.BUS_WATCHDOG, 0)
        self.bus.write(registers.TORQUE_ENABLE, 0)
        _write_zero(self.bus, self._to_counts(displacement_m))
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

    def _write_counts(self, find: Callable[[], int], *, lets_out: bool) -> None:
        self._goal_counts = None  # not known if the servo does not answer
        self._lets_out = lets_out
        self._goal_counts = self.bus.write_fresh(registers.GOAL_POSITION, find)

    def _read_counts(self) -> int:
        return self.bus.read(registers.PRESENT_POSITION)

    def _to_counts(self, displacement_m: float) -> int:
        return self._sign * registers.m_to_counts(displacement_m, self._config.pulley_radius_m)

    def _to_displacement_m(self, position_counts: int) -> float:
        return self._sign * registers.counts_to_m(position_counts, self._config.pulley_radius_m)
