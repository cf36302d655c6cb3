# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The control table of an XM430-W350, as far as mode 5 needs it; other addresses read as 0."""

from __future__ import annotations

from typing import NamedTuple

from linear_guide_driver.dynamixel import registers as known
from linear_guide_driver.dynamixel.registers import EEPROM_END, Register

ERROR_RANGE, ERROR_LENGTH, ERROR_LIMIT, ERROR_ACCESS = 4, 5, 6, 7
TABLE_END = 147
MODES = (0, 1, 3, 4, 5, 16)
GOALS = (known.GOAL_CURRENT, known.GOAL_POSITION)
FIRMWARE_VERSION = 45
ROOM_C = 30


class Field(NamedTuple):
    """A register with its value at power-up; without limits it is read-only."""

    register: Register
    initial: int
    lowest: int = 1
    highest: int = 0


FIELDS = (
    Field(known.MODEL_NUMBER, 1020),
    Field(known.FIRMWARE, FIRMWARE_VERSION),
    Field(known.DRIVE_MODE, 0, 0, 13),
    Field(known.OPERATING_MODE, 3, 0, 16),
    Field(known.HOMING_OFFSET, 0, -1044479, 1044479),
    Field(known.TEMPERATURE_LIMIT, 80, 0, 100),
    Field(known.CURRENT_LIMIT, 1193, 0, 1193),
    Field(known.VELOCITY_LIMIT, 200, 0, 1023),
    Field(known.TORQUE_ENABLE, 0, 0, 1),
    Field(known.STATUS_RETURN_LEVEL, known.STATUS_ALWAYS),
    Field(known.HARDWARE_ERROR, 0),
    Field(known.BUS_WATCHDOG, 0, 0, 127),
    Field(known.GOAL_CURRENT, 1193, -1193, 1193),
    Field(known.PROFILE_ACCELERATION, 0, 0, 32767),
    Field(known.PROFILE_VELOCITY, 0, 0, 32767),
    Field(known.GOAL_POSITION, 0, -1048575, 1048575),
    Field(known.PRESENT_CURRENT, 0),
    Field(known.PRESENT_VELOCITY, 0),
    Field(known.PRESENT_POSITION, 0),
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

    def check_write(self, address: int, data: bytes) -> tuple[Register, int]:
        """Return the register and the value that a write would set; nothing is set yet.

        Raises
        ------
        AccessError
            The write is refused.
        """
        field = _BY_ADDRESS.get(address)
        if field is None or field.lowest > field.highest:
            raise AccessError(ERROR_ACCESS)
        register = field.register
        if len(data) != register.size:
            raise AccessError(ERROR_LENGTH)
        if register.address < EEPROM_END and self[known.TORQUE_ENABLE]:
            raise AccessError(ERROR_ACCESS)
        value = int.from_bytes(data, 'little', signed=register.is_signed)
        if not field.lowest <= value <= field.highest:
            raise AccessError(ERROR_RANGE)
        if register == known.OPERATING_MODE and value not in MODES:
            raise AccessError(ERROR_RANGE)
        if register in GOALS and self[known.BUS_WATCHDOG] == known.WATCHDOG_TRIPPED:
            raise AccessError(ERROR_RANGE)
        if register == known.GOAL_CURRENT and abs(value) > self[known.CURRENT_LIMIT]:
            raise AccessError(ERROR_LIMIT)
        return register, value
