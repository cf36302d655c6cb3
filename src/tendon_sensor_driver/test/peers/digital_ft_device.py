# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated ATI Digital F/T: Modbus registers, and a stream of gauge counts."""

from __future__ import annotations

from collections.abc import Callable
import struct

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.ati.digital_ft_protocol import (
    ACCEPTED,
    ADDRESS,
    CALIBRATION_REGISTER,
    CALIBRATION_REGISTERS,
    GAINS_REGISTER,
    LOCK_DATA,
    LOCK_STORAGE,
    START_DATA,
    START_STREAM,
    STATUS_REGISTER,
    UNLOCK_DATA,
)
from tendon_sensor_driver.ati.modbus import (
    decode_frame,
    encode_frame,
    ModbusError,
    READ_REGISTERS,
    WRITE_REGISTERS,
)

STREAM_HZ = 600.0
_JAM_BYTES = 14
_COUNTS_PER_UNIT = 100
_GAIN = 0x1234
_OFFSET = 0x5678


class DigitalFtDevice:
    """Answers and streams; told the time.

    Its stream rate is assumed, the real one is not known. A tension stands for the force
    along z; its matrix mixes it into all gauges.

    Parameters
    ----------
    force : callable
        Axial force [N] at a time [s].
    generator : Generator
        Source of the noise, of one count.
    serial : str
        Of the transducer, at most 8 characters.

    Attributes
    ----------
    status : int
        Status word; its records are marked while it is not 0.
    is_streaming : bool
    registers : dict of int to int
    """

    def __init__(
        self,
        force: Callable[[float], float],
        generator: np.random.Generator,
        serial: str = 'FT000001',
    ) -> None:
        self._force = force
        self._generator = generator
        mixed, _ = np.linalg.qr(np.random.default_rng(6).standard_normal((6, 6)))
        self._matrix = mixed.astype(np.float32)
        self.registers = self._store(serial)
        self.status = 0
        self.is_streaming = False
        self._is_locked = True
        self._input = bytearray()
        self._begun_s = 0.0
        self._sent = 0

    def _store(self, serial: str) -> dict[int, int]:
        block = bytearray(2 * CALIBRATION_REGISTERS)
        block[0:8] = serial.encode('ascii').ljust(8, b'\0')
        block[8:24] = b'SI-125-3 (sim.)\0'
        block[64:208] = self._matrix.astype('>f4').tobytes()
        block[208:210] = bytes((2, 3))  # N, N m
        struct.pack_into('>ii', block, 2 * 117, _COUNTS_PER_UNIT, _COUNTS_PER_UNIT)
        struct.pack_into('>12H', block, 2 * 121, *[_GAIN] * 6, *[_OFFSET] * 6)
        values = struct.unpack(f'>{CALIBRATION_REGISTERS}H', block)
        return {CALIBRATION_REGISTER + i: value for i, value in enumerate(values)}

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes; return the answers."""
        self._input += data
        if self.is_streaming:
            if len(self._input) >= _JAM_BYTES:
                self.is_streaming = False
                self._input.clear()
            return b''
        output = b''
        while (size := self._frame_size()) <= len(self._input):
            frame = bytes(self._input[:size])
            del self._input[:size]
            output += self._answer(frame, now_s)
        return output

    def _frame_size(self) -> int:
        head = self._input
        while head and (head[0] != ADDRESS or (len(head) > 1 and head[1] not in _SIZES)):
            del head[0]  # a real device waits for a pause instead
        if len(head) < 2:
            return 2
        if head[1] == WRITE_REGISTERS:
            return 9 + head[6] if len(head) > 6 else 7
        return _SIZES[head[1]]

    def _answer(self, frame: bytes, now_s: float) -> bytes:
        if len(frame) < 5:
            return b''
        function = frame[1]
        try:
            data = decode_frame(frame, ADDRESS, function)
        except ModbusError:
            return b''
        if function == READ_REGISTERS:
            first, count = struct.unpack('>HH', data)
            values = [self._read(register) for register in range(first, first + count)]
            body = bytes((2 * count,)) + struct.pack(f'>{count}H', *values)
            return encode_frame(ADDRESS, function, body)
        if function == WRITE_REGISTERS:
            first, count = struct.unpack('>HH', data[:4])
            if self._is_locked:
                return encode_frame(ADDRESS, function | 0x80, b'\x04')
            for i, value in enumerate(struct.unpack(f'>{count}H', data[5:])):
                self.registers[first + i] = value
            return encode_frame(ADDRESS, function, data[:4])
        if function == LOCK_STORAGE and data in (UNLOCK_DATA, LOCK_DATA):
            self._is_locked = data == LOCK_DATA
            return encode_frame(ADDRESS, function, ACCEPTED)
        if function == START_STREAM and data == START_DATA:
            self.is_streaming = True
            self._begun_s, self._sent = now_s, 0
            return encode_frame(ADDRESS, function, ACCEPTED)
        return encode_frame(ADDRESS, function, b'\x00')

    def _read(self, register: int) -> int:
        return self.status if register == STATUS_REGISTER else self.registers.get(register, 0)

    def poll(self, now_s: float) -> bytes:
        """Records that are due since the last call."""
        output = b''
        if not self.is_streaming:
            return output
        while self._sent < (now_s - self._begun_s) * STREAM_HZ:
            output += self._measure(self._begun_s + self._sent / STREAM_HZ)
            self._sent += 1
        return output

    def _measure(self, time_s: float) -> bytes:
        counts = np.zeros(6)
        if [self.registers.get(GAINS_REGISTER + i) for i in (0, 6)] == [_GAIN, _OFFSET]:
            counts[2] = self._force(time_s) * _COUNTS_PER_UNIT
        gauges = self._matrix.T @ counts + self._generator.standard_normal(6)
        clipped = np.clip(np.rint(gauges), -(2**15), 2**15 - 1).astype(np.int64)
        return encode_record(clipped, has_error=self.status != 0)


def encode_record(gauges: NDArray[np.int64], *, has_error: bool = False) -> bytes:
    """Return one record of the stream: gauges 0, 2, 4, 1, 3, 5, and a checksum of seven bits."""
    body = struct.pack('>6h', *gauges[[0, 2, 4, 1, 3, 5]])
    return body + bytes(((sum(body) & 0x7F) | (0x80 if has_error else 0),))


_SIZES = {READ_REGISTERS: 8, WRITE_REGISTERS: 0, START_STREAM: 5, LOCK_STORAGE: 5}
