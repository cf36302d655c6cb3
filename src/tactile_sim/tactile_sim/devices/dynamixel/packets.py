# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Dynamixel Protocol 2.0, the servo's side: instruction packets in, status packets out."""

from __future__ import annotations

from typing import NamedTuple

HEADER = b'\xff\xff\xfd\x00'
BROADCAST_ID = 254
MAX_LENGTH = 1024
_STATUS = 0x55
_STUFFED, _PLAIN = b'\xff\xff\xfd\xfd', b'\xff\xff\xfd'


class Instruction(NamedTuple):
    """One instruction packet.

    Attributes
    ----------
    device_id, code
        Addressee, and what to do.
    parameters
        Without stuffing.
    is_intact
        Whether the checksum is right.
    """

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
    """CRC-16 with polynomial 0x8005, start 0, not reflected."""
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
    """Finds instruction packets in bytes of any chunking, between any garbage."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Instruction]:
        """Take bytes and return the packets that they complete."""
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
            # Stuffing keeps headers out of a body: one inside means that this packet broke off.
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
