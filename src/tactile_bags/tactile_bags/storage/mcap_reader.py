# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads an MCAP file from its beginning, whether or not it was ever finished.

The index at the end of a file is not used: it is absent where a recorder was killed, and
need not be true in an untrusted file. The index behind each chunk says which topics are in it;
where the statistics at the end of a finished file say otherwise, all chunks are looked into. What
is read is bounded by `mcap_format`.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
import io
from pathlib import Path
from typing import BinaryIO
import zlib

from lz4.frame import LZ4FrameDecompressor
import numpy as np
import zstandard

from tactile_bags.errors import BagError
from tactile_bags.storage.mcap_format import (
    CHANNEL,
    CHUNK,
    CHUNK_START,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MAX_CHUNK_BYTES,
    MAX_DEFINITION_BYTES,
    MAX_METADATA_BYTES,
    MAX_SCHEMA_BYTES,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_START,
    METADATA,
    METADATA_KEY,
    METADATA_NAME,
    RECORD_START,
    RecordFields,
    records_within,
    SCHEMA,
    STATISTICS,
    StoredTopic,
)
from tactile_bags.storage.mcap_segments import PACKINGS, Segment, SegmentTable

RUN_BYTES = 2**20
"""Messages outside of chunks are read in runs of about this size [byte]."""


Message = tuple[int, int, bytes]
"""Time of arrival [ns], channel, serialised message."""


class McapFile:
    """An MCAP file for reading.

    Attributes
    ----------
    topics : dict of int to StoredTopic
        By channel.
    counts : Counter of int
        Messages by channel.
    is_finished : bool
        Whether its writer came to the end. Otherwise the file is read up to its last
        whole record.
    segments : SegmentTable
        In the order of the file.
    metadata : str
        The copy of ``metadata.yaml`` in it; empty when there is none.
    stated_counts : Counter of int or None
        Messages by channel as the statistics of a finished file state them; None: they do not.

    Raises
    ------
    BagError
        When it is no MCAP file of ROS 2, is damaged, or goes beyond a limit.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[int, StoredTopic] = {}
        self.counts: Counter[int] = Counter()
        self.is_finished = False
        self.segments = SegmentTable()
        self.metadata = ''
        self.stated_counts: Counter[int] | None = None
        self._last: Segment | None = None  # the newest, which is not in the table yet
        self._last_counts: Counter[int] | None = None
        self._is_cut = False
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._definition_bytes = 0
        self._file: BinaryIO = path.open('rb')
        try:
            self._size = self._file.seek(0, io.SEEK_END)
            self._scan()
            self._look_into_chunks()
            if self.stated_counts not in (None, self.counts):
                self.segments.forget_counts()
                self._look_into_chunks()
            if unknown := sorted(self.counts.keys() - self.topics.keys()):
                raise BagError(
                    f'messages are on channel {unknown[0]}, which no channel record defines'
                )
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file. Harmless when called twice."""
        self._file.close()

    @property
    def newest_ns(self) -> int:
        """No later than the arrival of the last message [ns]."""
        return self.segments.newest_ns

    # -- one pass over the file ------------------------------------------------------

    def _scan(self) -> None:
        self._file.seek(max(0, self._size - len(MAGIC)))
        claims_end = self._size > 2 * len(MAGIC) and self._file.read() == MAGIC
        self._file.seek(0)
        if self._file.read(len(MAGIC)) != MAGIC:
            raise BagError('it does not begin as an MCAP file does')
        position, has_data_end = len(MAGIC), False
        while position + RECORD_START.size <= self._size:
            self._file.seek(position)
            opcode, length = RECORD_START.unpack(self._file.read(RECORD_START.size))
            contents = position + RECORD_START.size
            if contents + length > self._size:
                if opcode == CHUNK and not claims_end:
                    self._take_chunk(contents, self._size - contents, is_cut=True)
                break
            if position == len(MAGIC):
                self._check_header(opcode, length)
            elif opcode == 0:
                break  # a file system gives zeros where the data did not come to the disk
            elif opcode == FOOTER:
                self.is_finished = has_data_end and claims_end
                break
            has_data_end |= opcode == DATA_END
            self._take(opcode, contents, length)
            position = contents + length
        if self._last is None and position == len(MAGIC):
            raise BagError('it ends before its header does')
        if claims_end and not self.is_finished:
            raise BagError(f'the record at byte {position} cannot be read')
        if not self.is_finished:
            self._drop_damaged_end()
            # The index of the last chunk may be incomplete: its messages are counted instead.
            self._last_counts = None
        self._keep_last()

    def _check_header(self, opcode: int, length: int) -> None:
        if opcode != HEADER or length > MAX_SCHEMA_BYTES:
            raise BagError('it does not begin with the header of an MCAP file')
        profile = RecordFields(self._file.read(length)).text()
        if profile != 'ros2':
            raise BagError('it is an MCAP file, but not one of ROS 2')

    def _take(self, opcode: int, offset: int, length: int) -> None:
        if opcode == MESSAGE:
            self._take_loose_message(offset, length)
        elif opcode == CHUNK:
            self._take_chunk(offset, length)
        elif opcode == MESSAGE_INDEX:
            self._take_index()
        elif opcode in (SCHEMA, CHANNEL):
            _check_size('a definition', length, MAX_SCHEMA_BYTES)
            self._learn(opcode, self._file.read(length))
        elif opcode == METADATA:
            self._take_metadata(length)
        elif opcode == STATISTICS:
            self._take_statistics(length)

    def _take_loose_message(self, offset: int, length: int) -> None:
        _check_size('a message', length, MAX_CHUNK_BYTES)
        if length < MESSAGE_START.size:
            raise BagError('a message is shorter than its own header')
        channel, _, received_at_ns, _ = MESSAGE_START.unpack(self._file.read(MESSAGE_START.size))
        start, whole = offset - RECORD_START.size, length + RECORD_START.size
        last = self._last
        if (
            last is None
            or self._last_counts is None  # a chunk without an index
            or last.offset + last.stored_bytes != start
            or last.size + whole > RUN_BYTES
        ):
            self._keep_last()
            last = self._last = Segment(received_at_ns, received_at_ns, start, 0, 0)
            self._last_counts = Counter()
        last.first_ns = min(last.first_ns, received_at_ns)
        last.last_ns = max(last.last_ns, received_at_ns)
        last.stored_bytes += whole
        last.size += whole
        assert self._last_counts is not None
        self._last_counts[channel] += 1

    def _take_chunk(self, offset: int, length: int, *, is_cut: bool = False) -> None:
        """Take a chunk; of one whose end is not there, what is there."""
        _check_size('a packed chunk', length, 2 * MAX_CHUNK_BYTES)
        head = self._file.read(min(length, CHUNK_START.size + 4 + 32 + 8))
        fields = RecordFields(head)
        try:
            first_ns, last_ns, size = fields.number(8), fields.number(8), fields.number(8)
            checksum, compression = fields.number(4), fields.text()
            stored_bytes = fields.number(8)
        except BagError:
            if is_cut:
                return  # within its head
            raise
        if compression not in PACKINGS:
            raise BagError(
                f'a chunk is packed as "{compression[:16]}"; known are zstd, lz4 and none'
            )
        start = offset + CHUNK_START.size + 4 + len(compression.encode()) + 8
        if is_cut and compression:
            return
        if is_cut:
            size = stored_bytes = offset + length - start
        _check_size('a chunk', size, MAX_CHUNK_BYTES)
        if start + stored_bytes != offset + length:
            raise BagError('the length of a chunk is not that of its record')
        self._keep_last()
        self._last = Segment(first_ns, last_ns, start, stored_bytes, size, compression, checksum)
        self._last_counts, self._is_cut = None, is_cut

    def _keep_last(self) -> None:
        if self._last is not None:
            self.segments.add(self._last, self._last_counts)
        self._last = None

    def _take_index(self) -> None:
        head = RecordFields(self._file.read(6))
        channel, array_bytes = head.number(2), head.number(4)
        if self._last is not None and array_bytes:
            self._last_counts = self._last_counts or Counter()
            self._last_counts[channel] += array_bytes // 16

    def _take_metadata(self, length: int) -> None:
        if length > MAX_METADATA_BYTES:
            return  # anything may stand there; what rosbag2 writes is shorter
        fields = RecordFields(self._file.read(length))
        if fields.text() == METADATA_NAME:
            self.metadata = fields.texts().get(METADATA_KEY, '')

    def _take_statistics(self, length: int) -> None:
        _check_size('the statistics', length, MAX_METADATA_BYTES)
        fields = RecordFields(self._file.read(length))
        for size in (8, 2, 4, 4, 4, 4, 8, 8):  # totals and times
            fields.number(size)
        fields.number(4)  # bytes of the counts
        counts: Counter[int] = Counter()
        while not fields.is_at_end:
            channel = fields.number(2)
            counts[channel] = fields.number(8)
        self.stated_counts = +counts  # without those that are zero

    def _learn(self, opcode: int, contents: bytes) -> None:
        fields = RecordFields(contents)
        number = fields.number(2)
        known = self._schemas if opcode == SCHEMA else self.topics
        if number in known:
            return  # the copy behind the data, or one for each chunk
        self._definition_bytes += len(contents)
        _check_size('all definitions', self._definition_bytes, MAX_DEFINITION_BYTES)
        if opcode == SCHEMA:
            name, form, text = fields.text(), fields.text(), fields.text()
            self._schemas[number] = (name, form, text)
            return
        name, form, text = self._schemas.get(fields.number(2), ('', '', ''))
        topic, serialization, facts = fields.text(), fields.text(), fields.texts()
        self.topics[number] = StoredTopic(
            topic,
            name,
            facts.get('topic_type_hash', ''),
            text,
            form,
            facts.get('offered_qos_profiles', ''),
            serialization,
        )

    def _look_into_chunks(self) -> None:
        """Unpack those chunks whose channels or counts are not known without."""
        for i, has_counts in self.segments.unknown(self.topics.keys()):
            counts: Counter[int] = Counter()
            for opcode, data, start, end in self._records(self.segments[i]):
                if opcode in (SCHEMA, CHANNEL):
                    self._learn(opcode, data[start:end])
                elif opcode == MESSAGE and not has_counts:
                    counts[_message_start(data, start, end)[0]] += 1
            if not has_counts:
                self.segments.set_counts(i, counts)
        self.counts = self.segments.counts

    def _drop_damaged_end(self) -> None:
        """Of the last chunk, keep what came to the disk."""
        last = self._last
        if last is None:
            return
        if not self._is_cut:
            try:
                for _ in self._records(last):
                    pass
                return
            except BagError:
                self._last = None
        if last.compression:
            return
        self._file.seek(last.offset)
        data = self._file.read(last.stored_bytes)
        # A file system gives zeros where data did not come to the disk; a record that ends in
        # them may lack its own end. Damage of another kind can lie anywhere.
        there = len(data.rstrip(b'\0'))
        last.size = 0
        with suppress(BagError):
            for _, _, end in records_within(data):
                if end > there:
                    break
                last.size = end
        last.stored_bytes, last.checksum = last.size, 0
        is_known = last.size and (self._is_cut or there < len(data))
        self._last = last if is_known else None

    # -- messages -----------------------------------------------------------------------

    def messages_of(self, segment: Segment, channels: Collection[int]) -> Iterator[Message]:
        """Yield the messages of a segment that are on these channels, by time of arrival."""
        times_ns, starts = array('q'), array('q')
        data = b''
        for opcode, data, start, end in self._records(segment):
            if opcode == MESSAGE:
                channel, received_at_ns = _message_start(data, start, end)
                if channel in channels:
                    times_ns.append(min(received_at_ns, 2**63 - 1))
                    starts.append(start)
        for i in np.argsort(np.frombuffer(times_ns, np.int64), kind='stable'):
            start = starts[i]
            (_, length) = RECORD_START.unpack_from(data, start - RECORD_START.size)
            (channel,) = MESSAGE_START.unpack_from(data, start)[:1]
            yield times_ns[i], channel, data[start + MESSAGE_START.size : start + length]

    def _records(self, segment: Segment) -> Iterator[tuple[int, bytes, int, int]]:
        self._file.seek(segment.offset)
        data = unpack_chunk(
            self._file.read(segment.stored_bytes), segment.compression, segment.size
        )
        if segment.checksum and zlib.crc32(data) != segment.checksum:
            raise BagError('the checksum of a chunk is not that of its contents')
        for opcode, start, end in records_within(data):
            yield opcode, data, start, end


def _message_start(data: bytes, start: int, end: int) -> tuple[int, int]:
    if end - start < MESSAGE_START.size:
        raise BagError('a message is shorter than its own header')
    channel, _, received_at_ns, _ = MESSAGE_START.unpack_from(data, start)
    return channel, received_at_ns


def _check_size(what: str, size: int, limit: int) -> None:
    if size > limit:
        raise BagError(f'{what} of {size} bytes is in it, the limit is {limit}')


def unpack_chunk(packed: bytes, compression: str, size: int) -> bytes:
    """Return the contents of a chunk, of which there must be exactly ``size`` bytes.

    No more than that is ever unpacked, whatever the packed data say of themselves.

    Raises
    ------
    BagError
        When they are more or less, or cannot be unpacked.
    """
    try:
        data = _UNPACK[compression](packed, size + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise BagError(f'a chunk cannot be unpacked: {error}') from error
    if len(data) != size:
        raise BagError('a chunk holds more or less than is written on it')
    return data


def unpack_zstd(packed: bytes, limit: int) -> bytes:
    """Return what is packed, cut off at ``limit`` bytes."""
    window = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
    return window.stream_reader(packed).read(limit)


def _unpack_lz4(packed: bytes, limit: int) -> bytes:
    data: bytes = LZ4FrameDecompressor().decompress(packed, max_length=limit)
    return data


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    '': lambda packed, limit: packed[:limit],
    'zstd': unpack_zstd,
    'lz4': _unpack_lz4,
}
