# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access to one servo on a Dynamixel bus: ``dynamixel_sdk`` with locking and reconnection."""

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
"""Number of attempts to ping, or to read or write one register. Writing a register twice is
harmless, because all registers contain absolute values."""

READ_LENGTHS = 4
"""Number of different lengths with which a block of registers is read in turn. A late answer to
one of the previous three reads has another length than expected, and is thus detected."""

WRITE_WAIT_S = 0.1
"""Longest time [s] until the port has accepted a packet; after that, the packet counts as lost."""

LATE_S = 0.02
"""Pause [s] before an instruction is repeated. A late answer that arrives meanwhile is dropped."""


class SilentServoError(DeviceConnectionError):
    """The servo did not give a valid answer to an instruction; the port is still open."""


class DynamixelBus:
    """Reads and writes registers of one servo; thread-safe.

    Methods raise `SilentServoError` if the servo gives no valid answer, `DeviceRefusedError` if
    it refuses an instruction, and `DeviceConnectionError` if the port cannot be opened or is
    lost. A lost port is closed.

    Parameters
    ----------
    port : str
        Name of the serial port.
    baud : int
        Speed [bit/s].
    device_id : int
        ID of the servo.

    Attributes
    ----------
    name : str
        Description of servo and port for messages.
    lock : RLock
        Lock that each method acquires. Acquire it around several calls that other threads must
        not interrupt.
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
        """Open the port, unless it is open."""
        with self.lock:
            if self._is_open:
                return
            try:
                # `openPort` is not used, because it always opens the port at 1 Mbaud.
                if not self._port.setBaudRate(self._baud):
                    raise DeviceConnectionError(
                        f'dynamixel_sdk does not support {self._baud} baud; set baud to a '
                        'supported speed'
                    )
                self._port.ser.exclusive = True
                # The SDK reads bytes in a busy loop. With this timeout, each read waits for bytes,
                # so that the loop needs less processor time.
                self._port.ser.timeout = READ_WAIT_S
                self._port.ser.write_timeout = WRITE_WAIT_S
            except (*LINE_ERRORS, ValueError) as error:
                self.close()
                raise DeviceConnectionError(
                    f'cannot open {self._port.getPortName()}: {error}; check that the device is '
                    'plugged in, that the parameter port is correct and that no other program '
                    'uses the port'
                ) from error

    def ping(self) -> int:
        """Return the servo's model number.

        Two pings are sent, because the first answer may belong to an instruction of a driver that
        was killed.
        """
        with self.lock:
            self._retry(self._ping_once)
            time.sleep(LATE_S)
            return int(self._retry(self._ping_once))

    def read_block(self, block: Register) -> bytes:
        """Return the bytes of a register or of a range of registers, in one attempt.

        The protocol does not number its packets. To distinguish a late answer from the answer to
        the next read, the length varies: up to three bytes before the block are also read.
        """
        with self.lock:
            self._reads += 1
            extra = min(self._reads % READ_LENGTHS, block.address)
            address, size = block.address - extra, block.size + extra
            parameters = address.to_bytes(2, 'little') + size.to_bytes(2, 'little')
            action = f'reading register {block.address}'
            return self._exchange(action, INSTRUCTION_READ, parameters, size)[extra:]

    def read(self, register: Register) -> int:
        """Return the value of a register; retry if the servo is silent."""
        data = self._retry(lambda: self.read_block(register))
        return registers.decode_register(register, data, register.address)

    def write_block(self, block: Register, data: bytes) -> None:
        """Write the bytes of a register or of a range of registers, in one attempt."""
        parameters = block.address.to_bytes(2, 'little') + data
        action = f'writing register {block.address}'
        self._exchange(action, INSTRUCTION_WRITE, parameters, 0)

    def write_once(self, register: Register, value: int) -> None:
        """Write the value of a register, in one attempt."""
        self.write_block(register, registers.encode_register(register, value))

    def write(self, register: Register, value: int) -> None:
        """Write the value of a register; retry if the servo is silent."""
        self._retry(lambda: self.write_once(register, value))

    def reboot(self) -> None:
        """Restart the servo. It does not answer until it has restarted."""
        self._exchange('restarting', INSTRUCTION_REBOOT, b'', 0)

    def close(self) -> None:
        """Close the port; idempotent."""
        if self._is_open:
            with suppress(*LINE_ERRORS):
                self._port.closePort()

    # -- inside --------------------------------------------------------------------------

    @property
    def _is_open(self) -> bool:
        return self._port.ser is not None and bool(self._port.ser.is_open)

    def _ping_once(self) -> int:
        try:
            data = self._exchange('ping', INSTRUCTION_PING, b'', 3)
        except SilentServoError as error:
            raise SilentServoError(
                f'no answer from {self.name}; check ID, baud, wiring and power'
            ) from error
        return int.from_bytes(data[:2], 'little')

    def _exchange(self, action: str, instruction: int, parameters: bytes, size: int) -> bytes:
        """Send one instruction; return the data of its answer, which must have ``size`` bytes."""
        length = len(parameters) + 3
        packet = [0, 0, 0, 0, self._id, length & 0xFF, length >> 8, instruction]
        answer, result, error = self._call(
            lambda: self._packets.txRxPacket(self._port, [*packet, *parameters, 0, 0])
        )
        self._check(action, result, error)
        # The length is checked here, because the SDK's functions for reading registers silently
        # truncate an answer that is too long, such as a late answer to an earlier read.
        end = 7 + answer[5] + 256 * answer[6]
        data = bytes(answer[9 : end - 2])
        if len(data) != size:
            raise SilentServoError(
                f'{action} of {self.name} failed: the answer has {len(data)} bytes instead of '
                f'{size}'
            )
        return data

    def _retry(self, transaction: Callable[[], Any]) -> Any:
        # The lock is held during all attempts, so that no other thread can write a newer goal
        # before an older goal is written again.
        with self.lock:
            for _ in range(ATTEMPTS - 1):
                with suppress(SilentServoError):
                    return transaction()
                time.sleep(LATE_S)
            return transaction()

    def _call(self, transaction: Callable[[], Any]) -> Any:
        with self.lock:
            try:
                if not self._is_open:
                    raise DeviceConnectionError(
                        f'the connection to {self.name} is lost; check the cable'
                    )
                # Drop late answers, which versions of the SDK before 4.0.5 leave in the buffer.
                self._port.ser.reset_input_buffer()
                return transaction()
            except serial.SerialTimeoutException as error:
                with suppress(*LINE_ERRORS):  # unsent bytes must not be sent later
                    self._port.ser.reset_output_buffer()
                raise SilentServoError(
                    f'the port of {self.name} accepted no bytes for {WRITE_WAIT_S} s'
                ) from error
            except LINE_ERRORS as error:
                self.close()  # `open` then connects to a device that is plugged in again
                raise DeviceConnectionError(
                    f'the connection to {self.name} is lost: {error}'
                ) from error
            except IndexError as error:
                # The SDK raises IndexError if a packet with a valid checksum is too short.
                raise SilentServoError(f'{self.name} sent a packet that is too short') from error
            finally:
                # The SDK does not reset this flag after an exception. It would refuse every later
                # call, because the port would seem to be in use.
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
