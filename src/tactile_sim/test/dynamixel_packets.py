# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Instruction packets for a Dynamixel servo."""

import dynamixel_sdk

_HEADER = b'\xff\xff\xfd\x00'


def encode_instruction(device_id: int, code: int, parameters: bytes = b'') -> bytes:
    """Return an instruction packet, with byte stuffing and checksum from ROBOTIS's SDK."""
    sdk = dynamixel_sdk.PacketHandler(2.0)
    length = (len(parameters) + 3).to_bytes(2, 'little')
    packet = sdk.addStuffing([*_HEADER, device_id, *length, code, *parameters, 0, 0])
    crc = sdk.updateCRC(0, packet, len(packet) - 2)
    return bytes(packet[:-2]) + crc.to_bytes(2, 'little')
