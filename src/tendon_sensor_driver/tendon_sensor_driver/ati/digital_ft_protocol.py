# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The registers and the 13-byte stream of an ATI Digital F/T (manual 9620-05-Digital FT).

Known through two public drivers that cite section 8 of the manual; not tried on hardware.
"""

from __future__ import annotations

from dataclasses import dataclass
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.ati.units import compute_si_per_count, unit_of_code
from tendon_sensor_driver.errors import LinkError

ADDRESS = 10
START_STREAM = 0x46
START_DATA = b'\x55'
LOCK_STORAGE = 0x6A
UNLOCK_DATA, LOCK_DATA = b'\xaa', b'\x18'
ACCEPTED = b'\x01'
JAM = bytes(72)
"""Any 14 bytes or more stop the stream; this many zeros are what is known to work."""

GAINS_REGISTER = 0x0000
STATUS_REGISTER = 0x001D
CALIBRATION_REGISTER = 0x00E3
CALIBRATION_STEP = 192
CALIBRATION_REGISTERS = 133
GAUGE_REGISTERS = 12  # gains and offsets

RECORD_BYTES = 13
_CONFIRMATIONS = 2
_GAUGE_ORDER = (0, 3, 1, 4, 2, 5)  # where gauge 0, 1, ... stands in a record

_STATUS_BITS = {
    0: 'watchdog reset',
    1: 'gauge excitation too high',
    2: 'gauge excitation too low',
    3: 'artificial ground out of range',
    4: 'supply too high',
    5: 'supply too low',
    7: 'EEPROM',
    8: 'invalid configuration',
    9: 'bridge current too high',
    10: 'bridge current too low',
    11: 'thermistor too high',
    12: 'thermistor too low',
    13: 'DAC reading out of range',
}


def describe_status(word: int) -> tuple[str, ...]:
    """Return what a status word says; nothing for a healthy sensor."""
    return tuple(_STATUS_BITS.get(bit, f'bit {bit}') for bit in range(16) if word >> bit & 1)


@dataclass(frozen=True, eq=False)
class DigitalCalibration:
    """One calibration from the device.

    Attributes
    ----------
    serial : str
        Of the transducer.
    matrix : ndarray
        Newtons and newton metres of the gauges' counts, float64, shape (6, 6).
    gauge_settings : tuple of int
        Six gains and six offsets that belong to it.
    """

    serial: str
    matrix: NDArray[np.float64]
    gauge_settings: tuple[int, ...]


def decode_calibration(registers: tuple[int, ...]) -> DigitalCalibration:
    """Return the calibration from its first 133 registers.

    Raises
    ------
    LinkError
        When the slot holds none.
    """
    data = struct.pack(f'>{len(registers)}H', *registers)
    if len(registers) != CALIBRATION_REGISTERS:
        raise LinkError(
            f'a calibration has {CALIBRATION_REGISTERS} registers, no {len(registers)}'
        )
    matrix = np.frombuffer(data, '>f4', 36, 2 * 32).astype(np.float64).reshape(6, 6)
    if not np.isfinite(matrix).all() or not matrix.any():
        raise LinkError('this calibration of the Digital F/T is empty; choose another slot')
    per_force, per_torque = struct.unpack_from('>ii', data, 2 * 117)
    si = compute_si_per_count(
        unit_of_code('force', data[2 * 104]),
        unit_of_code('torque', data[2 * 104 + 1]),
        per_force,
        per_torque,
    )
    return DigitalCalibration(
        serial=_text(data[:8]),
        matrix=matrix * si[:, np.newaxis],
        gauge_settings=registers[121:133],
    )


def _text(data: bytes) -> str:
    return data.split(b'\0')[0].decode('ascii', 'replace').strip()


class StreamPart(NamedTuple):
    """Consecutive records of the stream.

    Attributes
    ----------
    gauges : ndarray
        Counts of gauges 0 to 5, int64, shape (records, 6).
    has_error : ndarray
        Whether the device marks the record, bool, shape (records,).
    lost_before : int
        Records that the bytes dropped before these amount to; at least 1 when any were.
    """

    gauges: NDArray[np.int64]
    has_error: NDArray[np.bool_]
    lost_before: int


class StreamDecoder:
    """Finds the records in the stream, however it is cut or damaged.

    A record has no header and a check of 7 bits, which one in 128 wrong places passes too. So
    a record counts only when the two after it are right as well, and after every damage the
    first two right ones are passed over: they may be half of it. What is out of step slips
    through once in two million places; the price is a delay of two records. A record that is
    damaged without a byte too many or too few passes once in 128 times: there is no more in
    the format, and the parity of the line has to see it.

    Attributes
    ----------
    bytes, records, dropped_bytes : int
        Counters since construction.
    """

    def __init__(self) -> None:
        self.bytes = self.records = self.dropped_bytes = 0
        self._pending = b''
        self._dropped = 0  # before what is pending
        self._passed_over = _CONFIRMATIONS  # right records since the last damage

    def reset(self) -> None:
        """Forget what is pending: a stream that begins anew comes next."""
        self.dropped_bytes += len(self._pending)
        self._pending = b''
        self._dropped = 0
        self._passed_over = _CONFIRMATIONS

    def feed(self, data: bytes) -> list[StreamPart]:
        """Take bytes; return the records that they complete."""
        self.bytes += len(data)
        self._pending += data
        size = len(self._pending) - RECORD_BYTES + 1
        parts: list[StreamPart] = []
        if size <= 0:
            return parts
        array = np.frombuffer(self._pending, np.uint8)
        is_right = _check_all(array)
        start = 0
        while True:
            steps = is_right[start::RECORD_BYTES]
            wrong = np.flatnonzero(~steps)
            run = int(wrong[0]) if len(wrong) else len(steps)
            count = max(0, run - _CONFIRMATIONS)
            over = min(count, _CONFIRMATIONS - self._passed_over)
            self._passed_over += over
            start = self._skip(start, start + over * RECORD_BYTES)
            count -= over
            if count:
                parts.append(self._take(array[start : start + count * RECORD_BYTES]))
                start += count * RECORD_BYTES
            if not len(wrong):
                break
            start = self._skip(start, _find_start(is_right, start + 1))
            self._passed_over = 0
        self._pending = self._pending[start:]
        return parts

    def _skip(self, start: int, end: int) -> int:
        self._dropped += end - start
        self.dropped_bytes += end - start
        return end

    def _take(self, array: NDArray[np.uint8]) -> StreamPart:
        records = array.reshape(-1, RECORD_BYTES)
        words = records[:, :12].copy().view('>i2').astype(np.int64)
        lost = -(-self._dropped // RECORD_BYTES)
        self._dropped = 0
        self.records += len(records)
        return StreamPart(words[:, _GAUGE_ORDER], records[:, 12] >= 0x80, lost)


def _check_all(array: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Whether a record could begin at each place, shape (bytes - 12,).

    Zeros alone, the bytes of an idle or broken line, would pass the check and are no record.
    """
    sums = np.concatenate(([0], np.cumsum(array, dtype=np.int64)))
    is_right: NDArray[np.bool_] = (sums[12:-1] - sums[:-13] - array[12:]) & 0x7F == 0
    is_right &= sums[13:] > sums[:-13]
    return is_right


def _find_start(is_right: NDArray[np.bool_], begin: int) -> int:
    """First place from ``begin`` at which every record that is there to be seen is right."""
    places = np.arange(begin, len(is_right) + RECORD_BYTES - 1)
    fits = np.ones(len(places), dtype=np.bool_)
    for step in range(_CONFIRMATIONS + 1):
        shifted = places + step * RECORD_BYTES
        is_seen = shifted < len(is_right)
        fits[is_seen] &= is_right[shifted[is_seen]]
    chosen = np.flatnonzero(fits)
    return int(places[chosen[0]]) if len(chosen) else len(is_right) + RECORD_BYTES - 1
