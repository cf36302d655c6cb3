# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated Dynamixel XM430-W350 servo. It answers packets, and its pulley winds the tendon."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linear_guide_driver.dynamixel import registers as known
from linear_guide_driver.dynamixel.registers import COUNTS_PER_TURN, EEPROM_END, Register
from tactile_sim.descriptions.description import TendonDrive
from tactile_sim.physics.motion import plan_move, plan_stop, Trajectory

FloatArray = NDArray[np.float64]
_EARLY_S = 1e-6

HEADER = b'\xff\xff\xfd\x00'
BROADCAST_ID = 254
MAX_LENGTH = 1024
_STATUS = 0x55
_STUFFED, _PLAIN = b'\xff\xff\xfd\xfd', b'\xff\xff\xfd'

ERROR_RANGE, ERROR_LENGTH, ERROR_LIMIT, ERROR_ACCESS = 4, 5, 6, 7
TABLE_END = 224
MODES = (0, 1, 3, 4, 5, 16)
GOALS = (known.GOAL_CURRENT, known.GOAL_POSITION)
FIRMWARE_VERSION = 45
ROOM_C = 30
DEVICE_ID = 1
PING, READ, WRITE, REBOOT = 0x01, 0x02, 0x03, 0x08
OVERHEATING = 0x04
ERROR_RESULT, ERROR_INSTRUCTION, ERROR_CRC = 1, 2, 3
VELOCITY_COUNTS_S = known.VELOCITY_UNIT_RPM / 60 * COUNTS_PER_TURN
ACCELERATION_COUNTS_S2 = 214.577 / 3600 * COUNTS_PER_TURN


class Instruction(NamedTuple):
    """One received instruction packet. Byte stuffing is removed from its parameters."""

    device_id: int
    code: int
    parameters: bytes
    is_intact: bool


def _make_crc_table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
        table.append(crc)
    return table


_CRC_TABLE = _make_crc_table()


def compute_crc(data: bytes) -> int:
    """Return the CRC-16 with polynomial 0x8005, initial value 0, not reflected.

    This function is used instead of the one in ROBOTIS's SDK, which takes a third longer, because
    the driver ignores an answer that is late.
    """
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ _CRC_TABLE[crc >> 8 ^ byte]
    return crc


def encode_status(device_id: int, error: int, parameters: bytes = b'') -> bytes:
    """Encode a status packet."""
    body = (bytes([_STATUS, error]) + parameters).replace(_PLAIN, _STUFFED)
    packet = HEADER + bytes([device_id]) + (len(body) + 2).to_bytes(2, 'little') + body
    return packet + compute_crc(packet).to_bytes(2, 'little')


class InstructionParser:
    """Parser of instruction packets in received bytes. It ignores garbage between packets."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Instruction]:
        """Add bytes; return the packets that are now complete."""
        self._buffer += data
        packets = []
        while (packet := self._next()) is not None:
            packets.append(packet)
        return packets

    def _next(self) -> Instruction | None:
        buffer = self._buffer
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                del buffer[: max(len(buffer) - len(HEADER) + 1, 0)]
                return None
            del buffer[:start]
            if len(buffer) < 7:
                return None
            length = int.from_bytes(buffer[5:7], 'little')
            end = 7 + length
            # Because of byte stuffing, a complete packet contains no second header. If there is
            # one, the first packet is truncated.
            broken = buffer.find(HEADER, 4, end - 2)
            if not 3 <= length <= MAX_LENGTH or buffer[4] > BROADCAST_ID:
                del buffer[0]
            elif broken > 0:
                del buffer[:broken]
            elif len(buffer) < end:
                return None
            else:
                packet = bytes(buffer[:end])
                del buffer[:end]
                intact = compute_crc(packet[:-2]) == int.from_bytes(packet[-2:], 'little')
                body = packet[7:-2].replace(_STUFFED, _PLAIN)
                return Instruction(packet[4], body[0], body[1:], intact)


class Field(NamedTuple):
    """A register, its value at power-up, and the limits of its values.

    A register without limits is read-only.
    """

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
    Field(known.MARK, known.NO_MARK, known.NO_MARK, known.OUR_MARK),
)
_BY_ADDRESS = {field.register.address: field for field in FIELDS}


class Foreseen(NamedTuple):
    """Motion of the servo, computed in advance for the case that the tension does not stop it.

    All arrays have shape (times,). Positions are in counts, velocities in counts/s.
    """

    times_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    displacement_m: FloatArray

    def shorten(self, count: int) -> Foreseen:
        """Return the motion at the first ``count`` times."""
        return Foreseen(*(values[:count] for values in self))


class AccessError(Exception):
    """A read or write instruction is invalid. The servo answers it with this error number."""

    def __init__(self, error: int) -> None:
        super().__init__(f'status error {error}')
        self.error = error


class ControlTable(dict[Register, int]):
    """The registers of the servo, and their values."""

    def __init__(self) -> None:
        super().__init__((field.register, field.initial) for field in FIELDS)

    def reset_ram(self) -> None:
        """Set the registers in RAM to their values at power-up."""
        for field in FIELDS:
            if field.register.address >= EEPROM_END:
                self[field.register] = field.initial

    def read(self, address: int, length: int) -> bytes:
        """Return ``length`` bytes at an address.

        Bytes that belong to no register are 0. Raises `AccessError` beyond the end of the table.
        """
        if address + length > TABLE_END:
            raise AccessError(ERROR_RANGE)
        table = bytearray(TABLE_END)
        for (start, size, signed), value in self.items():
            table[start : start + size] = value.to_bytes(size, 'little', signed=signed)
        return bytes(table[address : address + length])

    def check_write(self, address: int, data: bytes) -> list[tuple[Register, int]]:
        """Return the registers and values that a write instruction sets.

        One instruction can write several registers that follow each other without a gap. Raises
        `AccessError` if the instruction is invalid.
        """
        values: list[tuple[Register, int]] = []
        while data or not values:
            field = _BY_ADDRESS.get(address)
            if field is None or field.lowest > field.highest:
                raise AccessError(ERROR_ACCESS)
            size = field.register.size
            if len(data) < size:
                raise AccessError(ERROR_LENGTH)
            values.append((field.register, self._check_value(field, data[:size])))
            address, data = address + size, data[size:]
        return values

    def _check_value(self, field: Field, data: bytes) -> int:
        register = field.register
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
        return value


class DynamixelDevice:
    """The servo and its pulley.

    Positions are in counts. They increase when the servo tightens the tendon. The servo moves only
    in operating mode 5, current-based position control.
    """

    def __init__(self, drive: TendonDrive) -> None:
        self._drive = drive
        self._table = ControlTable()
        self._parser = InstructionParser()
        self._now_s = 0.0
        self._fed_s = 0.0
        self._silent_until_s = -math.inf
        self._tension_n = 0.0
        self._turns_off = 0  # whole turns forgotten at a restart [counts]
        self._stalled = False
        self._is_hot = False
        self._position = float(drive.slack_count)
        self._velocity = 0.0
        self._trajectory = Trajectory(self._position, [], self._position)
        self._table[known.GOAL_POSITION] = drive.slack_count

    # ---- physics ------------------------------------------------------------------------

    @property
    def _offset(self) -> int:
        """Value of the register for the present position, minus the pulley's position [counts]."""
        return self._turns_off + self._table[known.HOMING_OFFSET]

    @property
    def displacement_m(self) -> float:
        """Displacement of the tendon, which tightening increases [m].

        It is 0 at the position ``slack_count``, where the tendon is no longer slack.
        """
        return (self._position - self._drive.slack_count) * self._drive.m_per_count

    def advance(self, now_s: float, tension_n: float) -> None:
        """Simulate the motion up to ``now_s`` [s] under the tension ``tension_n`` [N]."""
        elapsed_s = now_s - self._now_s
        self._now_s, self._tension_n = now_s, tension_n
        self._check_watchdog()
        if self._is_hot:
            self.fail(OVERHEATING)
        if not self._table[known.TORQUE_ENABLE]:
            pull = max(tension_n - self._drive.back_drive_n, 0.0)
            slackened_m = pull / self._drive.back_drive_n_s_m * elapsed_s
            if slackened_m or not self._is_at_rest:
                self._rest_at(self._position - slackened_m / self._drive.m_per_count)
            return
        position, velocity = self._trajectory.state_at(now_s)
        overloaded = self._load_a(1.0) > self._limit_a()
        if velocity > 0.0 and overloaded:
            self._stalled = True
            self._rest_at(self._position)
        elif self._stalled and not overloaded:
            self._stalled = False
            self._go(self._table[known.GOAL_POSITION])
        else:
            self._position, self._velocity = position, velocity

    @property
    def _is_at_rest(self) -> bool:
        return self._velocity == 0.0 and self._trajectory.end_s == -math.inf

    def rests_until_s(self, tension_n: float) -> float:
        """Return the time until which the servo will not move under this tension [s].

        An instruction can move it earlier. While the servo moves, the result is minus infinity.
        """
        if not self._table[known.TORQUE_ENABLE]:
            return math.inf if tension_n <= self._drive.back_drive_n else -math.inf
        if self._stalled or self._trajectory.end_s > self._now_s:
            return -math.inf
        watchdog = self._table[known.BUS_WATCHDOG]
        if watchdog in (0, known.WATCHDOG_TRIPPED):
            return math.inf
        return self._fed_s + watchdog * known.WATCHDOG_STEP_S - _EARLY_S

    def rest(self, now_s: float, tension_n: float) -> None:
        """Set the time to ``now_s``, which must be before `rests_until_s`, without motion."""
        self._now_s, self._tension_n = now_s, tension_n

    def foresee(self, times_s: FloatArray) -> Foreseen:
        """Compute the motion at increasing times, as if the tension did not stop the servo.

        The result ends before the bus watchdog would trip.
        """
        watchdog = self._table[known.BUS_WATCHDOG]
        has_torque = bool(self._table[known.TORQUE_ENABLE])
        if has_torque and watchdog not in (0, known.WATCHDOG_TRIPPED):
            feeds = times_s - self._fed_s <= watchdog * known.WATCHDOG_STEP_S
            times_s = times_s[: int(np.argmin(np.append(feeds, False)))]
        if has_torque and not self._stalled:
            position, velocity = self._trajectory.states_at(times_s)
        else:
            position = np.full(len(times_s), self._position)
            velocity = np.zeros(len(times_s))
        displacement_m = (position - self._drive.slack_count) * self._drive.m_per_count
        return Foreseen(times_s, position, velocity, displacement_m)

    def follow(self, foreseen: Foreseen, tension_n: FloatArray) -> int:
        """Carry out a motion that `foresee` has computed, until the tension changes it.

        ``tension_n``, shape (times,), is the tension before each step [N]. Return the number of
        steps that were carried out.
        """
        if not self._table[known.TORQUE_ENABLE]:
            goes_on = tension_n <= self._drive.back_drive_n
        else:
            torque_nm = tension_n * self._drive.pulley_radius_m
            load_a = torque_nm / self._drive.torque_constant_nm_a + self._drive.friction_current_a
            overloaded = load_a > self._limit_a()
            goes_on = overloaded if self._stalled else ~((foreseen.velocity > 0.0) & overloaded)
        count = int(np.argmin(np.append(goes_on, False)))
        if count:
            self._now_s = float(foreseen.times_s[count - 1])
            self._tension_n = float(tension_n[count - 1])
            self._position = float(foreseen.position[count - 1])
            self._velocity = float(foreseen.velocity[count - 1])
        return count

    def fail(self, hardware_error: int) -> None:
        """Set a hardware error, such as overheating or overload, which switches the torque off."""
        self._table[known.HARDWARE_ERROR] |= hardware_error
        self._table[known.TORQUE_ENABLE] = 0

    def heat(self, temperature_c: int) -> None:
        """Set a temperature above the limit. A reboot does not end the error before `cool`."""
        self._is_hot = True
        self._table[known.PRESENT_TEMPERATURE] = temperature_c

    def cool(self) -> None:
        """Set the normal temperature. An error that is already set remains."""
        self._is_hot = False
        self._table[known.PRESENT_TEMPERATURE] = ROOM_C

    def restart(self) -> None:
        """Simulate a short interruption of the power supply."""
        self._parser = InstructionParser()
        self._reboot()

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Receive bytes from the bus and return the answers; call `advance` first."""
        if now_s < self._silent_until_s:
            return b''
        answers = bytearray()
        for packet in self._parser.feed(data):
            if packet.is_intact:
                self._fed_s = now_s
            answers += self._answer(packet)
            if packet.code == REBOOT and now_s < self._silent_until_s:
                self._parser = InstructionParser()
                break
        return bytes(answers)

    @property
    def due_s(self) -> float:
        """Infinite, because a servo sends only answers."""
        return math.inf

    def poll(self, now_s: float) -> bytes:
        """Return nothing, because a servo sends only answers."""
        return b''

    # ---- packets ------------------------------------------------------------------------

    def _answer(self, packet: Instruction) -> bytes:
        to_all = packet.device_id == BROADCAST_ID and packet.code == PING
        if packet.device_id != DEVICE_ID and not to_all:
            return b''
        if not packet.is_intact:
            return b'' if to_all else self._status(ERROR_CRC)
        try:
            return self._status(0, self._carry_out(packet))
        except AccessError as refusal:
            return self._status(refusal.error)

    def _status(self, error: int, parameters: bytes = b'') -> bytes:
        alert = known.STATUS_ALERT if self._table[known.HARDWARE_ERROR] else 0
        return encode_status(DEVICE_ID, error | alert, parameters)

    def _carry_out(self, packet: Instruction) -> bytes:
        """Execute one instruction; return the parameters of its answer."""
        given = packet.parameters
        address = int.from_bytes(given[:2], 'little')
        if packet.code == PING:
            return self._table.read(0, 2) + self._table.read(known.FIRMWARE.address, 1)
        if packet.code == READ:
            if len(given) != 4:
                raise AccessError(ERROR_LENGTH)
            self._refresh()
            return self._table.read(address, int.from_bytes(given[2:], 'little'))
        if packet.code == WRITE:
            self._write(address, given[2:])
        elif packet.code == REBOOT:
            self._reboot()
        else:
            raise AccessError(ERROR_INSTRUCTION)
        return b''

    def _write(self, address: int, data: bytes) -> None:
        for register, value in self._table.check_write(address, data):
            self._set(register, value)

    def _set(self, register: Register, value: int) -> None:
        if register == known.TORQUE_ENABLE and value and self._table[known.HARDWARE_ERROR]:
            raise AccessError(ERROR_RESULT)
        before = self._table[register]
        self._table[register] = value
        if register == known.OPERATING_MODE and value != before:
            self._table[known.PROFILE_ACCELERATION] = self._table[known.PROFILE_VELOCITY] = 0
            self._table[known.GOAL_CURRENT] = self._table[known.CURRENT_LIMIT]
        elif register == known.TORQUE_ENABLE and not value:
            self._rest_at(self._position)
        elif register == known.TORQUE_ENABLE and value != before:
            self._fed_s = self._now_s
            self._go(self._table[known.GOAL_POSITION])
        elif register == known.GOAL_POSITION and self._table[known.TORQUE_ENABLE]:
            self._go(value)

    def _reboot(self) -> None:
        temperature_c = self._table[known.PRESENT_TEMPERATURE]
        self._table.reset_ram()
        self._table[known.PRESENT_TEMPERATURE] = temperature_c
        self._rest_at(self._position)
        believed = round(self._position) + self._turns_off
        self._turns_off += believed % COUNTS_PER_TURN - believed
        self._table[known.GOAL_POSITION] = round(self._position) + self._offset
        self._silent_until_s = self._now_s + self._drive.reboot_s

    # ---- motion -------------------------------------------------------------------------

    def _rest_at(self, position: float) -> None:
        self._position, self._velocity = position, 0.0
        self._trajectory = Trajectory(position, [], position)

    def _go(self, goal: int) -> None:
        """Start a motion profile from the present position and velocity to a goal position."""
        if self._table[known.OPERATING_MODE] != known.MODE_CURRENT_BASED_POSITION:
            return
        per_m = 1 / self._drive.m_per_count
        fastest = min(
            self._table[known.VELOCITY_LIMIT] * VELOCITY_COUNTS_S,
            self._drive.max_speed_m_s * per_m,
        )
        strongest = self._drive.max_acceleration_m_s2 * per_m
        speed = self._table[known.PROFILE_VELOCITY] * VELOCITY_COUNTS_S or fastest
        acceleration = self._table[known.PROFILE_ACCELERATION] * ACCELERATION_COUNTS_S2
        speed, acceleration = min(speed, fastest), min(acceleration or strongest, strongest)
        target = float(goal - self._offset)
        segments = plan_move(
            self._now_s, self._position, self._velocity, target, speed, acceleration
        )
        self._trajectory = Trajectory(self._position, segments, target)

    def _check_watchdog(self) -> None:
        steps = self._table[known.BUS_WATCHDOG]
        if steps in (0, known.WATCHDOG_TRIPPED) or not self._table[known.TORQUE_ENABLE]:
            return
        if self._now_s - self._fed_s > steps * known.WATCHDOG_STEP_S:
            self._table[known.BUS_WATCHDOG] = known.WATCHDOG_TRIPPED
            self._stalled = False
            strongest = self._drive.max_acceleration_m_s2 / self._drive.m_per_count
            stop = plan_stop(self._now_s, self._position, self._velocity, strongest)
            end = stop[-1].end_position if stop else self._position
            self._trajectory = Trajectory(self._position, stop, end)

    def _load_a(self, direction: float) -> float:
        """Return the motor current that balances the tension and the friction of the gear [A].

        ``direction`` has the sign of the velocity.
        """
        torque_nm = self._tension_n * self._drive.pulley_radius_m
        friction_a = math.copysign(self._drive.friction_current_a, direction) if direction else 0.0
        return torque_nm / self._drive.torque_constant_nm_a + friction_a

    def _limit_a(self) -> float:
        limit = min(self._table[known.CURRENT_LIMIT], abs(self._table[known.GOAL_CURRENT]))
        return limit * known.CURRENT_UNIT_A

    def _refresh(self) -> None:
        """Write the present position, velocity, current and other values to their registers."""
        current_a = self._load_a(self._velocity) if self._table[known.TORQUE_ENABLE] else 0.0
        current_a = max(min(current_a, self._limit_a()), -self._limit_a())
        self._table[known.PRESENT_POSITION] = round(self._position) + self._offset
        self._table[known.PRESENT_VELOCITY] = round(self._velocity / VELOCITY_COUNTS_S)
        self._table[known.PRESENT_CURRENT] = round(current_a / known.CURRENT_UNIT_A)
