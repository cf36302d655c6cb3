# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The control table of an XM430-W350: what can be read and written, and when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from linear_guide_driver.dynamixel import registers as known
from linear_guide_driver.dynamixel.registers import EEPROM_END, Register

ERROR_RANGE, ERROR_LENGTH, ERROR_LIMIT, ERROR_ACCESS = 4, 5, 6, 7
TABLE_END = 147
MODES = (0, 1, 3, 4, 5, 16)
FIRMWARE_VERSION = 45
ROOM_C = 30


class Field(NamedTuple):
    """A register with its value at power-up; without limits it is read-only."""

    register: Register
    initial: int
    lowest: int = 1
    highest: int = 0


DEVICE_ID = Register(7, 1)
MOVING_THRESHOLD = Register(24, 4)
PWM_LIMIT = Register(36, 2)
MAX_POSITION, MIN_POSITION = Register(48, 4), Register(52, 4)
SHUTDOWN = Register(63, 1)
REGISTERED = Register(69, 1)
GOAL_PWM, GOAL_VELOCITY = Register(100, 2, True), Register(104, 4, True)
MOVING, MOVING_STATUS = Register(122, 1), Register(123, 1)
GOALS = (GOAL_PWM, known.GOAL_CURRENT, GOAL_VELOCITY, known.GOAL_POSITION)

FIELDS = (
    Field(known.MODEL_NUMBER, 1020),
    Field(Register(2, 4), 0),
    Field(known.FIRMWARE, FIRMWARE_VERSION),
    Field(DEVICE_ID, 1, 0, 252),
    Field(Register(8, 1), 3, 0, 7),  # baud code: 1 M
    Field(Register(9, 1), 250, 0, 254),  # return delay
    Field(known.DRIVE_MODE, 0, 0, 13),
    Field(known.OPERATING_MODE, 3, 0, 16),
    Field(Register(12, 1), 255, 0, 255),  # secondary ID
    Field(Register(13, 1), 2, 1, 2),  # protocol
    Field(known.HOMING_OFFSET, 0, -1044479, 1044479),
    Field(MOVING_THRESHOLD, 10, 0, 1023),
    Field(Register(31, 1), 80, 0, 100),  # temperature limit
    Field(Register(32, 2), 160, 95, 160),  # voltage limits
    Field(Register(34, 2), 95, 95, 160),
    Field(PWM_LIMIT, 885, 0, 885),
    Field(known.CURRENT_LIMIT, 1193, 0, 1193),
    Field(known.VELOCITY_LIMIT, 200, 0, 1023),
    Field(MAX_POSITION, 4095, 0, 4095),
    Field(MIN_POSITION, 0, 0, 4095),
    Field(SHUTDOWN, 52, 0, 255),
    Field(known.TORQUE_ENABLE, 0, 0, 1),
    Field(Register(65, 1), 0, 0, 1),  # LED
    Field(known.STATUS_RETURN_LEVEL, 2, 0, 2),
    Field(REGISTERED, 0),
    Field(known.HARDWARE_ERROR, 0),
    Field(Register(76, 2), 1920, 0, 16383),  # gains
    Field(Register(78, 2), 100, 0, 16383),
    Field(Register(80, 2), 0, 0, 16383),
    Field(Register(82, 2), 0, 0, 16383),
    Field(Register(84, 2), 800, 0, 16383),
    Field(Register(88, 2), 0, 0, 16383),
    Field(Register(90, 2), 0, 0, 16383),
    Field(known.BUS_WATCHDOG, 0, 0, 127),
    Field(GOAL_PWM, 885, -885, 885),
    Field(known.GOAL_CURRENT, 1193, -1193, 1193),
    Field(GOAL_VELOCITY, 0, -1023, 1023),
    Field(known.PROFILE_ACCELERATION, 0, 0, 32767),
    Field(known.PROFILE_VELOCITY, 0, 0, 32767),
    Field(known.GOAL_POSITION, 0, -1048575, 1048575),
    Field(Register(120, 2), 0),
    Field(MOVING, 0),
    Field(MOVING_STATUS, 0),
    Field(Register(124, 2, True), 0),
    Field(known.PRESENT_CURRENT, 0),
    Field(known.PRESENT_VELOCITY, 0),
    Field(known.PRESENT_POSITION, 0),
    Field(Register(136, 4), 0),
    Field(Register(140, 4), 0),
    Field(known.PRESENT_VOLTAGE, 120),
    Field(known.PRESENT_TEMPERATURE, ROOM_C),
)
_BY_ADDRESS = {field.register.address: field for field in FIELDS}


class AccessError(Exception):
    """A read or write that the servo answers with an error number."""

    def __init__(self, error: int) -> None:
        super().__init__(f'status error {error}')
        self.error = error


class ControlTable:
    """Values by register."""

    def __init__(self) -> None:
        self._values = {field.register.address: field.initial for field in FIELDS}

    def __getitem__(self, register: Register) -> int:
        return self._values[register.address]

    def __setitem__(self, register: Register, value: int) -> None:
        self._values[register.address] = value

    def reset_ram(self) -> None:
        """Forget everything that a loss of power forgets."""
        for field in FIELDS:
            if field.register.address >= EEPROM_END:
                self[field.register] = field.initial

    def read(self, address: int, length: int) -> bytes:
        """Bytes of the table; gaps read as 0. AccessError beyond its end."""
        if address + length > TABLE_END:
            raise AccessError(ERROR_RANGE)
        table = bytearray(TABLE_END)
        for (start, size, signed), *_ in FIELDS:
            table[start : start + size] = self._values[start].to_bytes(
                size, 'little', signed=signed
            )
        return bytes(table[address : address + length])

    def check_write(self, address: int, data: bytes) -> Mapping[Register, int]:
        """Values that a write would set; nothing is set yet.

        Raises
        ------
        AccessError
            The write is refused as a whole.
        """
        values: dict[Register, int] = {}
        at = 0
        while at < len(data):
            field = _BY_ADDRESS.get(address + at)
            if field is None or field.lowest > field.highest:
                raise AccessError(ERROR_ACCESS)
            register = field.register
            part = data[at : at + register.size]
            if len(part) < register.size:
                raise AccessError(ERROR_LENGTH)
            if register.address < EEPROM_END and self[known.TORQUE_ENABLE]:
                raise AccessError(ERROR_ACCESS)
            value = int.from_bytes(part, 'little', signed=register.is_signed)
            self._check_value(field, value)
            values[register] = value
            at += register.size
        if not values:
            raise AccessError(ERROR_LENGTH)
        return values

    def _check_value(self, field: Field, value: int) -> None:
        register = field.register
        if not field.lowest <= value <= field.highest:
            raise AccessError(ERROR_RANGE)
        if register == known.OPERATING_MODE and value not in MODES:
            raise AccessError(ERROR_RANGE)
        if register in GOALS and self[known.BUS_WATCHDOG] == known.WATCHDOG_TRIPPED:
            raise AccessError(ERROR_RANGE)
        limits = {
            GOAL_PWM: PWM_LIMIT,
            known.GOAL_CURRENT: known.CURRENT_LIMIT,
            GOAL_VELOCITY: known.VELOCITY_LIMIT,
        }
        if register in limits and abs(value) > self[limits[register]]:
            raise AccessError(ERROR_LIMIT)
        one_turn = register == known.GOAL_POSITION and self[known.OPERATING_MODE] == 3
        if one_turn and not self[MIN_POSITION] <= value <= self[MAX_POSITION]:
            raise AccessError(ERROR_LIMIT)
