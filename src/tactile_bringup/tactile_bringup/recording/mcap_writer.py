# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Writes an MCAP file that is readable up to its last chunk at any moment."""

from __future__ import annotations

import os
from pathlib import Path
import zlib

from tactile_bringup.recording.mcap_format import (
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


class McapWriter:
    """Writes messages into chunks, and their index behind them. Not thread-safe.

    Definitions and channels lie outside of chunks and go to the file at once: what a
    recorder leaves behind that is killed needs no index to be read.

    Parameters
    ----------
    path : pathlib.Path
        Must not exist yet.

    Attributes
    ----------
    counts : dict of int to int
        Messages by channel in the chunks that were cut.
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
        self._chunk_indexes: list[bytes] = []
        self._metadata_indexes: list[bytes] = []
        self.counts: dict[int, int] = {}
        self.first_ns, self.last_ns = 2**63 - 1, 0
        self._begin_chunk()
        self._append(MAGIC + pack_record(HEADER, pack_text('ros2'), pack_text('tactile_bringup')))

    def _begin_chunk(self) -> None:
        self._chunk = bytearray()
        self._index: dict[int, list[bytes]] = {}
        self._chunk_first_ns, self._chunk_last_ns = 2**63 - 1, 0

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
        entry = pack_number(received_at_ns, 8) + pack_number(len(self._chunk), 8)
        self._index.setdefault(channel, []).append(entry)
        self._chunk += RECORD_START.pack(MESSAGE, MESSAGE_START.size + len(data))
        self._chunk += MESSAGE_START.pack(channel, 0, received_at_ns, received_at_ns)
        self._chunk += data
        self._chunk_first_ns = min(self._chunk_first_ns, received_at_ns)
        self._chunk_last_ns = max(self._chunk_last_ns, received_at_ns)
        if len(self._chunk) >= CHUNK_BYTES:
            self.cut()

    def cut(self) -> None:
        """End the chunk: all that was written is with the operating system then.

        A chunk that cannot be written is dropped, and is not in the index nor in the counts.
        """
        if not self._chunk:
            return
        records, index = bytes(self._chunk), self._index
        first_ns, last_ns = self._chunk_first_ns, self._chunk_last_ns
        self._begin_chunk()
        size = pack_number(len(records), 8)
        times = pack_number(first_ns, 8) + pack_number(last_ns, 8)
        chunk = pack_record(
            CHUNK,
            CHUNK_START.pack(first_ns, last_ns, len(records), zlib.crc32(records)),
            pack_text(''),  # not compressed: a sample's noise hardly is, and time matters
            size,
            records,
        )
        offsets, indexes = b'', b''
        position = self._position
        for channel, entries in index.items():
            offset = position + len(chunk) + len(indexes)
            offsets += pack_number(channel, 2) + pack_number(offset, 8)
            indexes += pack_record(
                MESSAGE_INDEX, pack_number(channel, 2), pack_bytes(b''.join(entries))
            )
        self._append(chunk + indexes)
        self._chunk_indexes.append(
            pack_record(
                CHUNK_INDEX,
                times,
                pack_number(position, 8),
                pack_number(len(chunk), 8),
                pack_bytes(offsets),
                pack_number(len(indexes), 8),
                pack_text(''),
                size,
                size,
            )
        )
        for channel, entries in index.items():
            self.counts[channel] += len(entries)
        self.first_ns = min(self.first_ns, first_ns)
        self.last_ns = max(self.last_ns, last_ns)

    def write_metadata(self, text: str) -> None:
        """Write a copy of ``metadata.yaml``; the last one counts."""
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
            CHUNK_INDEX: self._chunk_indexes,
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
        return pack_record(
            STATISTICS,
            pack_number(sum(self.counts.values()), 8),
            pack_number(len(self._schemas), 2),
            pack_number(len(self._channels), 4),
            pack_number(0, 4),  # attachments
            pack_number(len(self._metadata_indexes), 4),
            pack_number(len(self._chunk_indexes), 4),
            pack_number(times[0], 8),
            pack_number(times[1], 8),
            pack_bytes(counts),
        )
