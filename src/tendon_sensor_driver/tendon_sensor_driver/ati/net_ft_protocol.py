# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bytes and bits of ATI's RDT protocol (manual 9620-05-NET FT): requests, records, status."""

from __future__ import annotations

from enum import IntEnum
import struct

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.errors import TendonSensorError

RECORD_BYTES = 36
MOST_RECORDS = 40
"""The most records in one datagram, in buffered mode."""
INTERNAL_RATE_HZ = 7000
SATURATED = 1 << 17
CONDITION_LATCHED = 1 << 16
ERROR_SUMMARY = 1 << 31

_HEADER = 0x1234
_REQUEST = struct.Struct('>HHI')

RECORD = np.dtype(
    [('rdt_sequence', '>u4'), ('ft_sequence', '>u4'), ('status', '>u4'), ('counts', '>i4', (6,))]
)
"""One RDT record; big-endian as it travels."""

_NET_FT_BITS = {
    30: 'CPU or RAM',
    29: 'digital board',
    28: 'analog board',
    27: 'serial link between transducer and board',
    26: 'program memory',
    25: 'halted by configuration errors',
    24: 'settings',
    23: 'configuration does not fit the calibration',
    22: 'network',
    21: 'CAN',
    20: 'RDT',
    19: 'EtherNet/IP',
    18: 'DeviceNet',
    17: 'transducer saturated or A/D error',
    16: 'monitor condition latched',
    14: 'watchdog timeout',
    13: 'stack check',
    12: 'serial EEPROM',
    11: 'serial flash',
    10: 'analog board watchdog',
    9: 'gauge excitation current too high',
    8: 'gauge excitation current too low',
    7: 'artificial ground out of range',
    6: 'analog supply too high',
    5: 'analog supply too low',
    4: 'serial link data unavailable',
    3: 'reference voltage or power monitor',
    2: 'temperature',
    1: 'HTTP',
}
_AXIA_BITS = {
    30: 'force or torque out of range',
    29: 'calibration checksum',
    28: 'simulated error',
    27: 'gauge out of range',
    16: 'monitor condition latched',
    5: 'other error',
    3: 'busy',
    2: 'broken gauge',
    1: 'supply',
    0: 'temperature',
}
_AXIA_SATURATED = 1 << 27 | 1 << 30


class RdtError(TendonSensorError):
    """A datagram is no whole number of records."""


class Command(IntEnum):
    """Command code of an RDT request."""

    STOP = 0x0000
    START_REALTIME = 0x0002
    START_BUFFERED = 0x0003


def encode_request(command: Command) -> bytes:
    """Return a request, for samples without end."""
    return _REQUEST.pack(_HEADER, command, 0)


def decode_records(datagram: bytes) -> NDArray[np.void]:
    """Return the records of a datagram, or of several good ones joined.

    Returns
    -------
    ndarray
        Of `RECORD`, shape (records,); a view of the bytes.

    Raises
    ------
    RdtError
        When the length is no positive multiple of 36 bytes.
    """
    if not datagram or len(datagram) % RECORD_BYTES:
        raise RdtError(f'{len(datagram)} bytes are no whole RDT records of {RECORD_BYTES}')
    return np.frombuffer(datagram, dtype=RECORD)


def classify_status(words: NDArray[np.uint32], *, is_axia: bool) -> NDArray[np.uint32]:
    """Return the bits of `StrainStatus` for each status word.

    The latch of a monitor condition is no error: it says that a threshold of the user's was
    passed. Saturation alone is not called a device error.

    Parameters
    ----------
    words : ndarray
        uint32, shape (samples,).
    is_axia : bool
        Whether the words are those of an Ethernet Axia, whose bits differ.
    """
    if not words.any():
        return np.zeros(len(words), dtype=np.uint32)
    saturated = np.uint32(_AXIA_SATURATED if is_axia else SATURATED)
    harmless = saturated | np.uint32(CONDITION_LATCHED | ERROR_SUMMARY)
    is_saturated = (words & saturated) != 0
    # The summary alone, without any bit that explains it, is an error too.
    is_unexplained = words == ERROR_SUMMARY
    is_error = ((words & ~harmless) != 0) | is_unexplained
    status = np.where(is_saturated, int(StrainStatus.SATURATED), 0)
    status |= np.where(is_error, int(StrainStatus.DEVICE_ERROR), 0)
    return status.astype(np.uint32)


def describe_status(word: int, *, is_axia: bool) -> tuple[str, ...]:
    """Return what a status word says, highest bit first; nothing for a healthy sensor."""
    bits = _AXIA_BITS if is_axia else _NET_FT_BITS
    words = [bits.get(bit, f'bit {bit}') for bit in range(30, -1, -1) if word >> bit & 1]
    if word & ERROR_SUMMARY and not words:
        words = ['an error without a reason']
    return tuple(words)


def compute_rate_hz(asked_hz: float, internal_hz: float = INTERNAL_RATE_HZ) -> float:
    """Return the rate that a box makes of the rate that is asked: the next 7000 / n above it."""
    return internal_hz / max(1, int(internal_hz / asked_hz + 1e-9))
