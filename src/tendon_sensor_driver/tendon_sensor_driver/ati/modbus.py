# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of Modbus RTU, as far as an ATI Digital F/T speaks it."""

from __future__ import annotations

from collections.abc import Sequence
import struct

from tendon_sensor_driver.errors import LinkError

READ_REGISTERS = 3
WRITE_REGISTERS = 16
MOST_REGISTERS = 125
_FEWEST_BYTES = 4  # address, function, check
_EXCEPTION = 0x80


class ModbusError(LinkError):
    """A frame is damaged, is not the expected one, or carries a refusal."""


def compute_crc(data: bytes) -> int:
    """Return the check of a frame: polynomial 0xA001, from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def encode_frame(address: int, function: int, data: bytes) -> bytes:
    """Return a frame with its check, low byte first."""
    frame = bytes((address, function)) + data
    return frame + struct.pack('<H', compute_crc(frame))


def decode_frame(frame: bytes, address: int, function: int) -> bytes:
    """Return the data of the frame that answers a request.

    Raises
    ------
    ModbusError
        When it is damaged, from somebody else, or a refusal.
    """
    if len(frame) < _FEWEST_BYTES:
        raise ModbusError(f'{len(frame)} bytes are no Modbus frame')
    body, check = frame[:-2], struct.unpack('<H', frame[-2:])[0]
    if compute_crc(body) != check:
        raise ModbusError('a Modbus frame with a wrong check; look at baud, parity and wiring')
    if body[0] != address:
        raise ModbusError(f'a Modbus frame of device {body[0]} instead of {address}')
    if body[1] == function | _EXCEPTION:
        code = body[2] if len(body) > 2 else 0
        raise ModbusError(f'the device refuses Modbus function {function} with code {code}')
    if body[1] != function:
        raise ModbusError(f'a Modbus frame of function {body[1]} instead of {function}')
    return body[2:]


def encode_read(address: int, first: int, count: int) -> bytes:
    """Return the request for the values of registers."""
    return encode_frame(address, READ_REGISTERS, struct.pack('>HH', first, count))


def decode_read(frame: bytes, address: int, count: int) -> tuple[int, ...]:
    """Return the values from the answer to `encode_read`.

    Raises
    ------
    ModbusError
        When it is not that answer.
    """
    data = decode_frame(frame, address, READ_REGISTERS)
    if len(data) != 1 + 2 * count or data[0] != 2 * count:
        raise ModbusError(f'{len(data)} bytes are not the values of {count} registers')
    return struct.unpack(f'>{count}H', data[1:])


def encode_write(address: int, first: int, values: Sequence[int]) -> bytes:
    """Return the request to set registers."""
    header = struct.pack('>HHB', first, len(values), 2 * len(values))
    data = header + struct.pack(f'>{len(values)}H', *values)
    return encode_frame(address, WRITE_REGISTERS, data)


def decode_write(frame: bytes, address: int, first: int, count: int) -> None:
    """Check the answer to `encode_write`.

    Raises
    ------
    ModbusError
        When it is not that answer.
    """
    data = decode_frame(frame, address, WRITE_REGISTERS)
    if data != struct.pack('>HH', first, count):
        raise ModbusError(f'the device did not take {count} registers from {first}')
