# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One servo on a Dynamixel bus through ``dynamixel_sdk``, made safe to share and to unplug."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import threading
import time
from typing import Any

import dynamixel_sdk
import serial

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.registers import (
    INSTRUCTION_PING,
    INSTRUCTION_READ,
    INSTRUCTION_REBOOT,
    INSTRUCTION_WRITE,
    Register,
)
from linear_guide_driver.errors import DeviceConnectionError, DeviceRefusedError
from linear_guide_driver.serial_link import LINE_ERRORS

READ_WAIT_S = 0.002

ATTEMPTS = 3
"""At a ping, or at reading or writing one register. All registers hold absolute values, so to
write one twice does no harm."""

READ_LENGTHS = 4
"""Lengths of successive reads of one block: an answer that is late by fewer reads is noticed."""

WRITE_WAIT_S = 0.1
"""Longest time for the port to take a packet; then the packet counts as lost."""

LATE_S = 0.02
"""Rest before the next attempt: an answer that is merely late arrives in it and is dropped."""


class SilentServoError(DeviceConnectionError):
    """No valid answer to one instruction; the line itself is there."""


class DynamixelBus:
    """Reads and writes registers of one servo; thread-safe. Closes its port when the line is lost.

    Its calls raise `SilentServoError` without a valid answer, `DeviceRefusedError` when the servo
    refuses, and `DeviceConnectionError` when the port cannot be opened or is lost.

    ``name`` names servo and port in messages. ``lock`` is held during each call; hold it to keep
    several calls together.
    """

    def __init__(self, port: str, baud: int, device_id: int) -> None:
        self.name = f'servo {device_id} on {port} at {baud} baud'
        self._id, self._baud = device_id, baud
        self.lock = threading.RLock()
        self._packets: Any = dynamixel_sdk.PacketHandler(2.0)
        self._port: Any = dynamixel_sdk.PortHandler(port)
        self._reads = 0
        self.open()

    def open(self) -> None:
        """Open the port; harmless when it is open."""
        with self.lock:
            if self._is_open:
                return
            try:
                # Not openPort(): that opens at 1 Mbaud whatever is asked for.
                if not self._port.setBaudRate(self._baud):
                    raise DeviceConnectionError(
                        f'dynamixel_sdk does not know {self._baud} baud; use one of its speeds'
                    )
                self._port.ser.exclusive = True
                # The SDK asks for bytes in a loop; let each request sleep a little.
                self._port.ser.timeout = READ_WAIT_S
                self._port.ser.write_timeout = WRITE_WAIT_S
            except (*LINE_ERRORS, ValueError) as error:
                self.close()
                raise DeviceConnectionError(
                    f'cannot open {self._port.getPortName()}: {error}; check that the device is '
                    'plugged in, that the parameter port names it and that no other program uses '
                    'it'
                ) from error

    def ping(self) -> int:
        """Return the servo's model number.

        Asks twice: a driver that was killed may have left a question, and its answer comes first.
        """
        with self.lock:
            self._insist(self._ping_once)
            time.sleep(LATE_S)
            return int(self._insist(self._ping_once))

    def read_block(self, block: Register) -> bytes:
        """Return the bytes of a register or of a run of registers, asking once.

        The protocol does not number its packets. So that a late answer to one read is not taken
        for the answer to the next one, the length varies: up to three registers before the block
        are read as well.
        """
        with self.lock:
            self._reads += 1
            extra = min(self._reads % READ_LENGTHS, block.address)
            address, size = block.address - extra, block.size + extra
            parameters = address.to_bytes(2, 'little') + size.to_bytes(2, 'little')
            action = f'reading register {block.address}'
            return self._exchange(action, INSTRUCTION_READ, parameters, size)[extra:]

    def read(self, register: Register) -> int:
        """Return a register's value, signed where the register is; try more than once."""
        data = self._insist(lambda: self.read_block(register))
        return registers.decode_register(register, data, register.address)

    def write_block(self, block: Register, data: bytes) -> None:
        """Write the bytes of a register or of a run of registers, once."""
        parameters = block.address.to_bytes(2, 'little') + data
        action = f'writing register {block.address}'
        self._exchange(action, INSTRUCTION_WRITE, parameters, 0)

    def write_once(self, register: Register, value: int) -> None:
        """Write a register's value, signed where the register is, once."""
        self.write_block(register, registers.encode_register(register, value))

    def write(self, register: Register, value: int) -> None:
        """Write a register's value, signed where the register is; try more than once."""
        self._insist(lambda: self.write_once(register, value))

    def reboot(self) -> None:
        """Restart the servo, which then is silent for a while."""
        self._exchange('restarting', INSTRUCTION_REBOOT, b'', 0)

    def close(self) -> None:
        """Close the port. Harmless when called twice."""
        if self._is_open:
            with suppress(*LINE_ERRORS):
                self._port.closePort()

    # -- inside --------------------------------------------------------------------------

    @property
    def _is_open(self) -> bool:
        return self._port.ser is not None and bool(self._port.ser.is_open)

    def _ping_once(self) -> int:
        try:
            data = self._exchange('asking', INSTRUCTION_PING, b'', 3)
        except SilentServoError as error:
            raise SilentServoError(
                f'no answer from {self.name}; check ID, baud, wiring and power'
            ) from error
        return int.from_bytes(data[:2], 'little')

    def _exchange(self, action: str, instruction: int, parameters: bytes, size: int) -> bytes:
        """Send one instruction and return the data of its answer, which must have this size."""
        length = len(parameters) + 3
        packet = [0, 0, 0, 0, self._id, length & 0xFF, length >> 8, instruction]
        answer, result, error = self._call(
            lambda: self._packets.txRxPacket(self._port, [*packet, *parameters, 0, 0])
        )
        self._check(action, result, error)
        # The SDK cuts a longer answer, as one that comes late, to the length that was asked for.
        end = 7 + answer[5] + 256 * answer[6]
        data = bytes(answer[9 : end - 2])
        if len(data) != size:
            raise SilentServoError(
                f'{action} of {self.name} failed: the answer has {len(data)} bytes instead of '
                f'{size}'
            )
        return data

    def _insist(self, transaction: Callable[[], Any]) -> Any:
        with self.lock:  # throughout: an old goal must not follow a newer one
            for _ in range(ATTEMPTS - 1):
                with suppress(SilentServoError):
                    return transaction()
                time.sleep(LATE_S)
            return transaction()

    def _call(self, transaction: Callable[[], Any]) -> Any:
        with self.lock:
            try:
                if not self._is_open:
                    raise DeviceConnectionError(f'the line to {self.name} is lost; plug it in')
                # The SDK before 4.0.5 leaves late answers in the buffer, for the next to take.
                self._port.ser.reset_input_buffer()
                return transaction()
            except serial.SerialTimeoutException as error:
                with suppress(*LINE_ERRORS):  # what was not sent yet must not be sent later
                    self._port.ser.reset_output_buffer()
                raise SilentServoError(
                    f'the port of {self.name} took no bytes for {WRITE_WAIT_S} s'
                ) from error
            except LINE_ERRORS as error:
                self.close()  # `open` then finds the device that is plugged in again
                raise DeviceConnectionError(f'the line to {self.name} is lost: {error}') from error
            except IndexError as error:
                # A well-formed packet that is shorter than its kind: the SDK runs off its end.
                raise SilentServoError(f'{self.name} sent a packet that is too short') from error
            finally:
                # An exception leaves the flag set, and every later call would say "busy".
                self._port.is_using = False

    def _check(self, action: str, result: int, error: int) -> None:
        if result != dynamixel_sdk.COMM_SUCCESS:
            text = self._packets.getTxRxResult(result).removeprefix('[TxRxResult] ')
            raise SilentServoError(f'{action} of {self.name} failed: {text}')
        if error & ~registers.STATUS_ALERT == registers.STATUS_DAMAGED:
            raise SilentServoError(f'{action} of {self.name} failed: the packet was damaged')
        if error & ~registers.STATUS_ALERT:
            raise DeviceRefusedError(
                f'{action} of {self.name} was refused: {registers.format_status_error(error)}'
            )
