# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The records of an MCAP file, and how large each may be in an untrusted file.

After the specification at https://mcap.dev/spec. A record is an opcode, a length and that
many bytes; whoever wrote the file chose the length, so it is compared with a limit before
anything is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import struct

from tactile_bags.errors import BagError

MAGIC = b'\x89MCAP0\r\n'

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX, STATISTICS = 0x07, 0x08, 0x0B
METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0C, 0x0D, 0x0E, 0x0F

RECORD_START = struct.Struct('<BQ')
MESSAGE_START = struct.Struct('<HIQQ')
CHUNK_START = struct.Struct('<QQQI')

METADATA_NAME, METADATA_KEY = 'rosbag2', 'serialized_metadata'
"""Where rosbag2 keeps a copy of ``metadata.yaml`` in the file."""

MAX_CHUNK_BYTES = 64 * 2**20
"""Largest chunk that is unpacked, and largest message [byte]; rosbag2 writes 0.75 to 4 MiB."""

MAX_OPEN_BYTES = 256 * 2**20
"""Most that chunks which overlap in time may hold together [byte]."""

MAX_INDEX_BYTES = 256 * 2**20
"""Most memory for where the chunks of a file lie [byte]: six million chunks, which are six
terabytes of ours (1 MiB each), or 35 days of two chunks a second."""

MAX_SCHEMA_BYTES = 2**20
"""Longest message definition, and longest description of a channel [byte]."""

MAX_DEFINITION_BYTES = 16 * 2**20
"""Most that all definitions and channels of a file may hold together [byte]."""

MAX_METADATA_BYTES = 4 * 2**20
"""Longest ``metadata.yaml`` and longest copy of it within a file [byte]."""


@dataclass(frozen=True)
class StoredTopic:
    """A topic as a bag holds it.

    Attributes
    ----------
    name, type_name : str
    type_hash : str
        ``RIHS01_`` and 64 hex digits; empty when the recorder did not know it.
    definition : str
        Text of the message's definition with those that it needs.
    definition_format : str
        ``ros2msg`` or ``ros2idl``.
    qos : str
        The offered quality of service, as YAML.
    serialization : str
    """

    name: str
    type_name: str
    type_hash: str = ''
    definition: str = ''
    definition_format: str = 'ros2msg'
    qos: str = ''
    serialization: str = 'cdr'


class RecordFields:
    """Reads the fields of one record, and never beyond its end.

    Raises
    ------
    BagError
        When a field goes beyond the record, or a text is not UTF-8.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0

    def number(self, size: int) -> int:
        """Return an unsigned integer of ``size`` bytes."""
        return int.from_bytes(self._take(size), 'little')

    def text(self) -> str:
        """Return a text, which has its length in front."""
        try:
            return self._take(self.number(4)).decode()
        except UnicodeDecodeError as error:
            raise BagError('a text in it is not UTF-8') from error

    def texts(self) -> dict[str, str]:
        """Return texts by name."""
        inner = RecordFields(self._take(self.number(4)))
        found = {}
        while not inner.is_at_end:
            name = inner.text()
            found[name] = inner.text()
        return found

    @property
    def is_at_end(self) -> bool:
        return self._position == len(self._data)

    def _take(self, size: int) -> bytes:
        end = self._position + size
        if end > len(self._data):
            raise BagError('a field goes beyond the end of its record')
        taken = self._data[self._position : end]
        self._position = end
        return taken


def records_within(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the contents of each record in a chunk.

    Raises
    ------
    BagError
        When a record goes beyond the end of the chunk.
    """
    position, end = 0, len(data)
    while position < end:
        if position + RECORD_START.size > end:
            raise BagError('a chunk ends within a record')
        opcode, length = RECORD_START.unpack_from(data, position)
        start = position + RECORD_START.size
        position = start + length
        if position > end:
            raise BagError('a record goes beyond the end of its chunk')
        yield opcode, start, position


def pack_record(opcode: int, *parts: bytes) -> bytes:
    """Return one record made of its fields."""
    contents = b''.join(parts)
    return RECORD_START.pack(opcode, len(contents)) + contents


def pack_number(value: int, size: int) -> bytes:
    """Return an unsigned integer of ``size`` bytes."""
    return value.to_bytes(size, 'little')


def pack_text(text: str) -> bytes:
    """Return a text with its length in front."""
    return pack_bytes(text.encode())


def pack_bytes(data: bytes) -> bytes:
    """Return bytes with their length, of four bytes, in front."""
    return pack_number(len(data), 4) + data


def pack_texts(texts: dict[str, str]) -> bytes:
    """Return texts by name."""
    return pack_bytes(b''.join(pack_text(k) + pack_text(v) for k, v in texts.items()))
