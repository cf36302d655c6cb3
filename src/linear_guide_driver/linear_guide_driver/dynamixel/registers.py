# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Control table of the Dynamixel XM430 servos: addresses, units and error codes.

Source: ROBOTIS e-Manual, XM430-W350 and XM430-W210 control tables, Protocol 2.0.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Register(NamedTuple):
    """One entry of the control table; values are little-endian."""

    address: int
    size: int
    is_signed: bool = False


MODEL_NUMBER = Register(0, 2)
FIRMWARE = Register(6, 1)
DRIVE_MODE = Register(10, 1)
OPERATING_MODE = Register(11, 1)
HOMING_OFFSET = Register(20, 4, True)
TEMPERATURE_LIMIT = Register(31, 1)
CURRENT_LIMIT = Register(38, 2)
VELOCITY_LIMIT = Register(44, 4)
STARTUP_CONFIGURATION = Register(60, 1)
TORQUE_ENABLE = Register(64, 1)
STATUS_RETURN_LEVEL = Register(68, 1)
HARDWARE_ERROR = Register(70, 1)
BUS_WATCHDOG = Register(98, 1)
GOAL_CURRENT = Register(102, 2, True)
PROFILE_ACCELERATION = Register(108, 4)
PROFILE_VELOCITY = Register(112, 4)
GOAL_POSITION = Register(116, 4, True)
PRESENT_CURRENT = Register(126, 2, True)
PRESENT_VELOCITY = Register(128, 4, True)
PRESENT_POSITION = Register(132, 4, True)
PRESENT_VOLTAGE = Register(144, 2)
PRESENT_TEMPERATURE = Register(146, 1)
MARK = Register(220, 4)
"""Register of the driver's mark: the indirect addresses 27 and 28, which have no effect unless a
program uses indirect access. The register can be written while the torque is off. It loses its
value without power."""

MODELS = {1020: 'XM430-W350', 1030: 'XM430-W210'}
"""Names of the supported models by model number; their control tables are identical."""

FIRMWARE_WITH_WATCHDOG = 38
MODE_CURRENT_BASED_POSITION = 5
EEPROM_END = 64
"""Registers below this address keep their values without power. They can be written only while
the torque is off."""

STATUS_ALWAYS = 2
STARTUP_TORQUE_ON = 0x01
WATCHDOG_STEP_S = 0.02
WATCHDOG_OFF, WATCHDOG_TRIPPED = 0, 255
OUR_MARK = 375 | 515 << 16
"""Value of `MARK` in a servo that this driver has set up. It consists of two valid addresses."""
NO_MARK = 250 | 251 << 16
"""Value of `MARK` at power-up."""

INSTRUCTION_PING, INSTRUCTION_READ, INSTRUCTION_WRITE, INSTRUCTION_REBOOT = 1, 2, 3, 8

COUNTS_PER_TURN = 4096
VELOCITY_UNIT_RPM = 0.229
CURRENT_UNIT_A = 2.69e-3
VOLTAGE_UNIT_V = 0.1

STATUS_ALERT = 0x80
STATUS_DAMAGED = 3
STATUS_ERRORS = {
    1: 'the instruction could not be carried out',
    2: 'unknown instruction',
    3: 'the checksum of the instruction is wrong',
    4: 'the value is out of range or the register is locked',
    5: 'the data is too short',
    6: 'the value is beyond a limit register',
    7: 'the register cannot be written now',
}
HARDWARE_ERRORS = {
    0x01: 'supply voltage out of range',
    0x04: 'overheating',
    0x08: 'encoder failure',
    0x10: 'electrical shock or too little power',
    0x20: 'overload',
}


def format_status_error(error: int) -> str:
    """Return the meaning of the error byte of a status packet, without the alert bit."""
    code = error & ~STATUS_ALERT
    return STATUS_ERRORS.get(code, f'unknown error {code}')


def format_hardware_error(word: int) -> str:
    """Return the errors in a hardware error word, joined by "and"."""
    names = [name for bit, name in HARDWARE_ERRORS.items() if word & bit]
    unknown = word & ~sum(HARDWARE_ERRORS)
    if unknown:
        names.append(f'unknown bits 0x{unknown:02x}')
    return ' and '.join(names)


def encode_register(register: Register, value: int) -> bytes:
    """Return the value of a register as bytes."""
    return value.to_bytes(register.size, 'little', signed=register.is_signed)


def decode_register(register: Register, block: bytes, block_address: int) -> int:
    """Return the value of a register in a block that was read from ``block_address``."""
    start = register.address - block_address
    return int.from_bytes(
        block[start : start + register.size], 'little', signed=register.is_signed
    )


# -- units ---------------------------------------------------------------------------------


def counts_to_m(counts: float, pulley_radius_m: float) -> float:
    """Return the tendon length [m] of a rotation by ``counts``: 2 pi r counts / 4096."""
    return counts / COUNTS_PER_TURN * math.tau * pulley_radius_m


def m_to_counts(length_m: float, pulley_radius_m: float) -> int:
    """Return the rotation [counts] nearest to a tendon length [m]."""
    return round(length_m / (math.tau * pulley_radius_m) * COUNTS_PER_TURN)


def velocity_to_m_s(velocity: int, pulley_radius_m: float) -> float:
    """Return the tendon speed [m/s] of a velocity in units of 0.229 rpm."""
    return velocity * VELOCITY_UNIT_RPM / 60 * math.tau * pulley_radius_m


def m_s_to_velocity(speed_m_s: float, pulley_radius_m: float) -> int:
    """Return the velocity in units of 0.229 rpm nearest to a tendon speed [m/s], at least 1.

    0 is never returned, because a profile velocity of 0 means "as fast as possible".
    """
    return max(1, round(speed_m_s / (math.tau * pulley_radius_m) * 60 / VELOCITY_UNIT_RPM))


def velocity_to_counts_s(velocity: int) -> float:
    """Convert a velocity in units of 0.229 rpm to counts per second."""
    return velocity * VELOCITY_UNIT_RPM / 60 * COUNTS_PER_TURN


def current_to_a(current: int) -> float:
    """Convert a current in units of 2.69 mA to amperes."""
    return current * CURRENT_UNIT_A


def a_to_current(current_a: float) -> int:
    """Return the current in units of 2.69 mA nearest to a current in amperes."""
    return round(current_a / CURRENT_UNIT_A)


# -- blocks of registers ---------------------------------------------------------------------


class ServoState(NamedTuple):
    """Values of the registers in `STATE_BLOCK`, in the servo's units."""

    is_torque_on: bool
    status_return_level: int
    hardware_error: int
    watchdog: int
    goal_current: int
    profile_acceleration: int
    profile_velocity: int
    goal_counts: int
    current: int
    velocity: int
    position_counts: int
    voltage: int
    temperature_c: int


STATE_BLOCK = Register(
    TORQUE_ENABLE.address, PRESENT_TEMPERATURE.address + 1 - TORQUE_ENABLE.address
)
"""All registers from torque enable to present temperature. One read takes 94 bytes on the wire,
or 0.9 ms at 1 Mbaud."""


def decode_state(block: bytes) -> ServoState:
    """Decode the bytes of a whole `STATE_BLOCK`."""

    def value(register: Register) -> int:
        return decode_register(register, block, STATE_BLOCK.address)

    return ServoState(
        is_torque_on=value(TORQUE_ENABLE) != 0,
        status_return_level=value(STATUS_RETURN_LEVEL),
        hardware_error=value(HARDWARE_ERROR),
        watchdog=value(BUS_WATCHDOG),
        goal_current=value(GOAL_CURRENT),
        profile_acceleration=value(PROFILE_ACCELERATION),
        profile_velocity=value(PROFILE_VELOCITY),
        goal_counts=value(GOAL_POSITION),
        current=value(PRESENT_CURRENT),
        velocity=value(PRESENT_VELOCITY),
        position_counts=value(PRESENT_POSITION),
        voltage=value(PRESENT_VOLTAGE),
        temperature_c=value(PRESENT_TEMPERATURE),
    )


class ServoSettings(NamedTuple):
    """Values of the registers in `SETTINGS_BLOCK`. The servo keeps them without power."""

    firmware: int
    drive_mode: int
    operating_mode: int
    homing_offset: int
    temperature_limit_c: int
    current_limit: int
    velocity_limit: int
    startup_configuration: int


SETTINGS_BLOCK = Register(FIRMWARE.address, STARTUP_CONFIGURATION.address + 1 - FIRMWARE.address)


def decode_settings(block: bytes) -> ServoSettings:
    """Decode the bytes of a whole `SETTINGS_BLOCK`."""

    def value(register: Register) -> int:
        return decode_register(register, block, SETTINGS_BLOCK.address)

    return ServoSettings(
        firmware=value(FIRMWARE),
        drive_mode=value(DRIVE_MODE),
        operating_mode=value(OPERATING_MODE),
        homing_offset=value(HOMING_OFFSET),
        temperature_limit_c=value(TEMPERATURE_LIMIT),
        current_limit=value(CURRENT_LIMIT),
        velocity_limit=value(VELOCITY_LIMIT),
        startup_configuration=value(STARTUP_CONFIGURATION),
    )


GOAL_BLOCK = Register(
    PROFILE_ACCELERATION.address,
    GOAL_POSITION.address + GOAL_POSITION.size - PROFILE_ACCELERATION.address,
)
"""Registers of profile acceleration, profile velocity and goal position. They are written in one
packet, so that the servo never approaches a goal with the velocity of another goal."""


def encode_goal(velocity: int, goal_counts: int) -> bytes:
    """Return the bytes of a whole `GOAL_BLOCK`, with unlimited acceleration."""
    return (
        encode_register(PROFILE_ACCELERATION, 0)
        + encode_register(PROFILE_VELOCITY, velocity)
        + encode_register(GOAL_POSITION, goal_counts)
    )
