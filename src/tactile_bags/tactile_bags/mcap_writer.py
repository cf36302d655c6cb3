# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of MCAP files without chunks, as rosbag2 writes them with the preset ``fastwrite``.

If the process is killed, every complete message in the file can still be read. There is no index
that grows in memory. The library ``mcap`` encodes the records. Its own writer is not used: it
counts a message before the message is in the file, so its statistics are wrong if the disk is
full.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
import os
from pathlib import Path
import zlib

from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from tactile_bags.mcap_reader import MAGIC, METADATA_KEY, METADATA_NAME, StoredTopic

BUFFER_BYTES = 2**20
"""Largest amount of data that is buffered before it is written to the file [byte]."""

_FOOTER_CHECKSUM_BYTES = 4


class McapWriter:
    """Writer of a new MCAP file; raises `OSError` when the file cannot be written.

    ``counts`` maps each channel to its number of messages in the file. ``first_ns`` and
    ``last_ns`` are the earliest and the latest arrival time of these messages [ns]; 0 before the
    first message.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)
        self._size = self._checksum = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self.counts: Counter[int] = Counter()
        self.first_ns = self.last_ns = 0
        self._new = RecordBuilder()
        self._new_counts: Counter[int] = Counter()
        self._new_ns: list[int] = []
        self._append(MAGIC + _encode([Header('ros2', 'tactile_bags')]))

    def _append(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            # An incomplete record would make all later records unreadable, so it is removed. The
            # file then has a valid end, and there may be enough space for the closing records.
            self._file.seek(self._size)
            self._file.truncate()
            raise
        self._size += len(data)
        self._checksum = zlib.crc32(data, self._checksum)

    def add_channel(self, topic: StoredTopic) -> int:
        """Add a topic; return the number of its channel."""
        self.flush()
        records: list[McapRecord] = []
        schema = self._schemas.get(topic.type_name)
        if schema is None:
            definition = topic.definition.encode()
            number = len(self._schemas) + 1
            schema = Schema(number, definition, topic.definition_format, topic.type_name)
            records.append(schema)
        facts = {'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash}
        number = len(self._channels) + 1
        channel = Channel(number, topic.name, topic.serialization, facts, schema.id)
        self._append(_encode([*records, channel]))
        self._schemas[topic.type_name] = schema
        self._channels.append(channel)
        self.counts[number] = 0
        return number

    def write(self, channel: int, received_at_ns: int, data: bytes) -> None:
        """Write one serialised message."""
        Message(channel, received_at_ns, data, received_at_ns, 0).write(self._new)
        self._new_counts[channel] += 1
        self._new_ns.append(received_at_ns)
        if self._new.count > BUFFER_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the buffered data to the file, but do not wait until they are on the disk.

        If the data cannot be written, they are dropped and not counted.
        """
        data, counts, times_ns = self._new.end(), self._new_counts, self._new_ns
        self._new_counts, self._new_ns = Counter(), []
        if not times_ns:
            return
        self._append(data)
        self.first_ns = min(times_ns + [self.first_ns] * any(self.counts.values()))
        self.last_ns = max(*times_ns, self.last_ns)
        self.counts.update(counts)

    def write_metadata(self, text: str) -> None:
        """Write a copy of ``metadata.yaml``; readers use the last copy."""
        self.flush()
        data = _encode([Metadata(METADATA_NAME, {METADATA_KEY: text})])
        index = MetadataIndex(self._size, len(data), METADATA_NAME)
        self._append(data)
        self._metadata_indexes.append(index)

    def sync(self) -> None:
        """Wait until the written data are on the disk. Meanwhile, other threads may write."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write statistics and the end of the file. May be called repeatedly."""
        if self._file.closed:
            return
        try:
            self.flush()
            self._append(_encode([DataEnd(self._checksum)]))
            parts = *self._schemas.values(), *self._channels, self._statistics()
            summary = _encode([*parts, *self._metadata_indexes])
            footer = _encode([Footer(self._size, 0, 0)])[:-_FOOTER_CHECKSUM_BYTES]
            checksum = zlib.crc32(summary + footer).to_bytes(_FOOTER_CHECKSUM_BYTES, 'little')
            self._append(summary + footer + checksum + MAGIC)
        finally:
            self._file.close()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self.counts),
            chunk_count=0,
            message_count=self.counts.total(),
            message_end_time=self.last_ns,
            message_start_time=self.first_ns,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )


def _encode(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())
