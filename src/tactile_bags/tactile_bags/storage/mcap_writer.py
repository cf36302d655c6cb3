# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes an MCAP file that is readable up to its last chunk at any moment."""

from __future__ import annotations

import os
from pathlib import Path
import struct
import zlib

from tactile_bags.storage.mcap_format import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    CHUNK_START,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_START,
    METADATA,
    METADATA_INDEX,
    METADATA_KEY,
    METADATA_NAME,
    pack_bytes,
    pack_number,
    pack_record,
    pack_text,
    pack_texts,
    RECORD_START,
    SCHEMA,
    STATISTICS,
    StoredTopic,
    SUMMARY_OFFSET,
)

CHUNK_BYTES = 2**20
"""A chunk is cut when it holds this much [byte]."""

INDEX_ENTRY = struct.Struct('<QQ')
"""Time of arrival of a message, and where it begins in its chunk."""

STATISTICS_START = struct.Struct('<QHIIIIQQ')

CHUNK_HEAD_BYTES = RECORD_START.size + CHUNK_START.size + 4 + 8
"""Length of what stands before the records of a chunk that is not compressed [byte]."""


class _Part:
    """Records of a chunk, or the newest of them, with their index by channel."""

    def __init__(self) -> None:
        self.records = bytearray()
        self.size = 0
        self.index: dict[int, bytearray] = {}
        self.first_ns, self.last_ns = 2**63 - 1, 0

    def add(self, channel: int, received_at_ns: int, offset: int, data: bytes) -> None:
        entry = INDEX_ENTRY.pack(received_at_ns, offset + self.size)
        self.index.setdefault(channel, bytearray()).extend(entry)
        self.records += RECORD_START.pack(MESSAGE, MESSAGE_START.size + len(data))
        self.records += MESSAGE_START.pack(channel, 0, received_at_ns, received_at_ns)
        self.records += data
        self.size = len(self.records)
        self.first_ns = min(self.first_ns, received_at_ns)
        self.last_ns = max(self.last_ns, received_at_ns)

    def extend(self, other: _Part) -> None:
        """Take in the index of a later part, whose records follow in the file."""
        for channel, entries in other.index.items():
            self.index.setdefault(channel, bytearray()).extend(entries)
        self.size += other.size
        self.first_ns = min(self.first_ns, other.first_ns)
        self.last_ns = max(self.last_ns, other.last_ns)


def _chunk_head(chunk: _Part, checksum: int) -> bytes:
    """Return what stands before the records of a chunk.

    They are not compressed: a sample's noise hardly is, and time matters.
    """
    return (
        RECORD_START.pack(CHUNK, CHUNK_HEAD_BYTES - RECORD_START.size + chunk.size)
        + CHUNK_START.pack(chunk.first_ns, chunk.last_ns, chunk.size, checksum)
        + pack_text('')
        + pack_number(chunk.size, 8)
    )


class McapWriter:
    """Writes messages into chunks, and their index behind them. Not thread-safe.

    Definitions and channels lie outside of chunks and go to the file at once: what a
    recorder leaves behind that is killed needs no index to be read. The last chunk grows in
    the file: its head states what `flush` has brought there. So the number of chunks, and
    the memory for their index, goes by the bytes that are recorded and not by time.

    Parameters
    ----------
    path : pathlib.Path
        Must not exist yet.

    Attributes
    ----------
    counts : dict of int to int
        Messages by channel that are in the file.
    first_ns, last_ns : int
        Earliest and latest time of arrival; ``first_ns > last_ns`` before the first message.

    Raises
    ------
    OSError
        When the file cannot be made, or not be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)
        self._position = 0
        self._schemas: dict[str, tuple[int, bytes]] = {}
        self._channels: list[bytes] = []
        self._chunk_indexes = bytearray()
        self._chunk_count = 0
        self._metadata_indexes: list[bytes] = []
        self.counts: dict[int, int] = {}
        self.first_ns, self.last_ns = 2**63 - 1, 0
        self._chunk: _Part | None = None
        self._chunk_start = self._checksum = 0
        self._new = _Part()
        self._append(MAGIC + pack_record(HEADER, pack_text('ros2'), pack_text('tactile_bringup')))

    def _append(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            # Half a record would make all that follows unreadable. Without it, the file ends
            # well, and what it took may be room enough for the index.
            self._file.seek(self._position)
            self._file.truncate()
            raise
        self._position += len(data)

    def add_channel(self, topic: StoredTopic) -> int:
        """Announce a topic; return the number of its channel."""
        self.cut()
        if topic.type_name not in self._schemas:
            number = len(self._schemas) + 1
            schema = pack_record(
                SCHEMA,
                pack_number(number, 2),
                pack_text(topic.type_name),
                pack_text(topic.definition_format),
                pack_text(topic.definition),
            )
            self._schemas[topic.type_name] = (number, schema)
            self._append(schema)
        channel = len(self._channels) + 1
        record = pack_record(
            CHANNEL,
            pack_number(channel, 2),
            pack_number(self._schemas[topic.type_name][0], 2),
            pack_text(topic.name),
            pack_text(topic.serialization),
            pack_texts({'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash}),
        )
        self._channels.append(record)
        self.counts[channel] = 0
        self._append(record)
        return channel

    def write(self, channel: int, received_at_ns: int, data: bytes) -> None:
        """Write one serialised message."""
        new, size = self._new, self._chunk.size if self._chunk else 0
        new.add(channel, received_at_ns, size, data)
        if size + new.size >= CHUNK_BYTES:
            self.cut()

    def flush(self) -> None:
        """Bring all that was written into the file: it is with the operating system then.

        What cannot be written is dropped, and is not in the index nor in the counts.
        """
        new, self._new = self._new, _Part()
        if not new.size:
            return
        records = bytes(new.records)
        if self._chunk is None:
            start, self._checksum = self._position, zlib.crc32(records)
            self._append(_chunk_head(new, self._checksum) + records)
            self._chunk, self._chunk_start = new, start
        else:
            self._append(records)
            self._chunk.extend(new)
            self._checksum = zlib.crc32(records, self._checksum)
            # Only now that its records are there does the head count them.
            head = _chunk_head(self._chunk, self._checksum)
            os.pwrite(self._file.fileno(), head, self._chunk_start)
        new.records.clear()
        for channel, entries in new.index.items():
            self.counts[channel] += len(entries) // INDEX_ENTRY.size
        self.first_ns = min(self.first_ns, new.first_ns)
        self.last_ns = max(self.last_ns, new.last_ns)

    def cut(self) -> None:
        """End the chunk, with what was written since `flush`."""
        try:
            self.flush()
        finally:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if self._chunk is None:
            return
        chunk, self._chunk = self._chunk, None
        offsets, indexes = b'', b''
        for channel, entries in chunk.index.items():
            offset = self._position + len(indexes)
            offsets += pack_number(channel, 2) + pack_number(offset, 8)
            indexes += pack_record(
                MESSAGE_INDEX, pack_number(channel, 2), pack_bytes(bytes(entries))
            )
        chunk_bytes = self._position - self._chunk_start
        self._append(indexes)
        self._chunk_count += 1
        self._chunk_indexes += pack_record(
            CHUNK_INDEX,
            pack_number(chunk.first_ns, 8),
            pack_number(chunk.last_ns, 8),
            pack_number(self._chunk_start, 8),
            pack_number(chunk_bytes, 8),
            pack_bytes(offsets),
            pack_number(len(indexes), 8),
            pack_text(''),
            pack_number(chunk.size, 8),
            pack_number(chunk.size, 8),
        )

    def write_metadata(self, text: str) -> None:
        """Write a copy of ``metadata.yaml``; the last one counts."""
        self.cut()
        record = pack_record(METADATA, pack_text(METADATA_NAME), pack_texts({METADATA_KEY: text}))
        position = self._position
        self._append(record)
        self._metadata_indexes.append(
            pack_record(
                METADATA_INDEX,
                pack_number(position, 8),
                pack_number(len(record), 8),
                pack_text(METADATA_NAME),
            )
        )

    def sync(self) -> None:
        """Wait until what was written is on the disk; other threads may go on writing."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write the index and the end. Harmless when called twice."""
        if self._file.closed:
            return
        try:
            self.cut()
            self._append(pack_record(DATA_END, bytes(4)))
            self._append_summary()
        finally:
            self._file.close()

    def _append_summary(self) -> None:
        groups = {
            SCHEMA: [record for _, record in self._schemas.values()],
            CHANNEL: self._channels,
            CHUNK_INDEX: [bytes(self._chunk_indexes)],
            METADATA_INDEX: self._metadata_indexes,
            STATISTICS: [self._statistics()],
        }
        summary_start, summary, offsets = self._position, b'', b''
        for opcode, records in groups.items():
            group = b''.join(records)
            if group:
                offsets += pack_record(
                    SUMMARY_OFFSET,
                    pack_number(opcode, 1),
                    pack_number(summary_start + len(summary), 8),
                    pack_number(len(group), 8),
                )
            summary += group
        start = pack_number(summary_start, 8) + pack_number(summary_start + len(summary), 8)
        # The checksum covers the footer's own fields as well.
        footer = RECORD_START.pack(FOOTER, 20) + start
        checksum = pack_number(zlib.crc32(summary + offsets + footer), 4)
        self._append(summary + offsets + footer + checksum + MAGIC)

    def _statistics(self) -> bytes:
        times = (self.first_ns, self.last_ns) if any(self.counts.values()) else (0, 0)
        counts = b''.join(
            pack_number(channel, 2) + pack_number(count, 8)
            for channel, count in self.counts.items()
        )
        totals = STATISTICS_START.pack(
            sum(self.counts.values()),
            len(self._schemas),
            len(self._channels),
            0,  # attachments
            len(self._metadata_indexes),
            self._chunk_count,
            *times,
        )
        return pack_record(STATISTICS, totals, pack_bytes(counts))
