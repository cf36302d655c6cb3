# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader of MCAP files, including files that were not closed.

The library ``mcap`` decodes the records. This module locates the messages itself, because the
readers of the library return no messages of a truncated chunk, unpack chunks of any size, and take
10 times as long per message. The index of a file is not used; only the records themselves are. The
sizes of records are limited.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
import io
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple, TypeVar
import zlib

from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Header, Metadata, Schema, Statistics
import zstandard

from tactile_bags.errors import BagError

MAGIC = b'\x89MCAP0\r\n'

METADATA_NAME, METADATA_KEY = 'rosbag2', 'serialized_metadata'
"""Name and key of the metadata record in which rosbag2 stores a copy of ``metadata.yaml``."""

MAX_CHUNK_BYTES = 64 * 2**20
"""Largest chunk that is unpacked, and largest message [byte]; rosbag2 writes 0.75 to 4 MiB."""

MAX_DEFINITION_BYTES = 16 * 2**20
"""Largest total size of all definitions and channels of a file [byte]."""

MAX_METADATA_BYTES = 4 * 2**20
"""Largest ``metadata.yaml`` and largest copy of it within a file [byte]."""

MAX_SEGMENTS = 500_000
"""Largest number of segments in a file, each of which needs 200 bytes of memory; see `Segment`."""

MAX_CHANNELS = 1_000_000
"""Largest total size of the sets of channels of all segments; equal sets are counted once."""

RUN_BYTES = 2**20
"""Approximate size in which consecutive messages outside chunks are read at a time [byte]."""

MAX_RECORD_BYTES = 2**20
"""Largest message definition and largest description of a channel [byte]."""

MAX_NS = 2**63 - 1

MAX_OPCODE, MIN_PRIVATE_OPCODE = 0x0F, 0x80
"""Opcodes between these two are reserved. Records with larger, private opcodes are skipped."""

_RECORD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_PACKING_OFFSET = _RECORD.size + 28
_CHUNK_HEAD_BYTES = _PACKING_OFFSET + 4 + 8  # of a chunk without compression
_MESSAGE_CODE = int(Opcode.MESSAGE)
_TAKEN = {
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.CHUNK,
    Opcode.METADATA,
    Opcode.STATISTICS,
    Opcode.DATA_END,
}

Message = tuple[int, int, bytes]
"""Arrival time [ns], channel, serialised message."""

_Record = TypeVar('_Record')


@dataclass(frozen=True)
class StoredTopic:
    """A topic as stored in a bag.

    ``type_hash`` is empty if the recorder did not know it. ``definition`` is the text of the
    message definition and of all definitions that it uses. ``definition_format`` is ``ros2msg`` or
    ``ros2idl``. ``qos`` is the offered quality of service, as YAML.
    """

    name: str
    type_name: str
    type_hash: str = ''
    definition: str = ''
    definition_format: str = 'ros2msg'
    qos: str = ''
    serialization: str = 'cdr'


class Segment(NamedTuple):
    """A part of a file that is read at a time: a chunk, or consecutive messages outside chunks.

    ``first_ns`` and ``last_ns`` are the earliest and the latest arrival time [ns]. ``size`` is the
    uncompressed size [byte]. ``is_packed`` is True for a compressed chunk.
    """

    first_ns: int
    last_ns: int
    offset: int
    size: int
    is_packed: bool
    channels: frozenset[int]


class _Index(NamedTuple):
    """Summary of consecutive records.

    ``counts`` contains the number of messages of each channel. ``first_ns`` and ``last_ns`` are
    the earliest and the latest arrival time [ns]. ``size`` is the end of the last record [byte].
    """

    counts: Counter[int]
    first_ns: int
    last_ns: int
    size: int


class McapFile:
    """Reader of an MCAP file; raises `BagError` if it is not an MCAP file of ROS 2.

    Attributes
    ----------
    topics, counts, stated_counts : dict
        Topic, number of messages, and number of messages according to the statistics in the file.
        The keys are channels. ``stated_counts`` is None if the file has no statistics.
    segments : list of Segment
        The segments, in the order of the file.
    is_finished : bool
        True if the file was closed. If it was not, it is read up to its last complete record; the
        number of bytes after that is ``unread_bytes``.
    damage : str or None
        If a closed file is damaged, the position of the damage, up to which the file is read;
        otherwise None.
    metadata : str
        The copy of ``metadata.yaml`` in the file, or empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[int, StoredTopic] = {}
        self.counts: Counter[int] = Counter()
        self.segments: list[Segment] = []
        self.is_finished = False
        self.unread_bytes = 0
        self.metadata = ''
        self.damage: str | None = None
        self.stated_counts: Counter[int] | None = None
        self._schemas: dict[int, Schema] = {}
        self._definition_bytes = 0
        self._is_in_partial_chunk = False
        self._channel_sets: dict[frozenset[int], frozenset[int]] = {}
        self._channel_count = 0  # total size of all these sets
        self._file: BinaryIO = path.open('rb')
        try:
            self._size = self._file.seek(0, io.SEEK_END)
            self._file.seek(max(0, self._size - len(MAGIC)))
            self._claims_end = self._size > 2 * len(MAGIC) and self._file.read() == MAGIC
            self._check_start()
            self._scan()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file. May be called repeatedly."""
        self._file.close()

    def read_parts(self) -> Iterator[bytes]:
        """Yield the bytes of the whole file in parts of 1 MiB."""
        for offset in range(0, self._size, 2**20):
            yield self._read(offset, 2**20)

    @property
    def newest_ns(self) -> int:
        """Arrival time of the last message [ns]; 0 if there is none."""
        return min(max((s.last_ns for s in self.segments), default=0), MAX_NS)

    def _read(self, offset: int, size: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(size)

    def _head(self, position: int) -> tuple[int, int, int]:
        """Return opcode, length and end position of the record at a position."""
        head = self._read(position, _RECORD.size).ljust(_RECORD.size, b'\0')
        opcode, length = _RECORD.unpack(head)
        return opcode, length, position + _RECORD.size + length

    # -- one pass over the file ------------------------------------------------------

    def _check_start(self) -> None:
        if self._read(0, len(MAGIC)) != MAGIC:
            raise BagError('it does not begin with the magic bytes of an MCAP file')
        opcode, length, end = self._head(len(MAGIC))
        if opcode != Opcode.HEADER or length > MAX_RECORD_BYTES:
            raise BagError('it does not begin with the header of an MCAP file')
        if end > self._size:
            raise BagError('it ends within its header')
        header = _decode(Header.read, self._read(end - length, length))
        if header.profile != 'ros2':
            raise BagError('it is an MCAP file, but not of ROS 2')

    def _scan(self) -> None:
        position, has_data_end = len(MAGIC), False
        try:
            while not self.is_finished:
                opcode, length, end = self._head(position)
                if opcode == 0 or end > self._size:
                    if opcode != Opcode.CHUNK or not self._is_partial(position, end):
                        break
                    end = position + _CHUNK_HEAD_BYTES  # continue with the records in the chunk
                elif opcode == _MESSAGE_CODE:
                    end = self._take_run(position, length)
                elif opcode == Opcode.FOOTER:
                    if self._claims_end and (not has_data_end or end + len(MAGIC) != self._size):
                        raise BagError('the end of the data is missing')
                    self.is_finished = self._claims_end
                else:
                    has_data_end |= opcode == Opcode.DATA_END
                    try:
                        self._take(opcode, end - length, length)
                    except BagError:
                        if opcode != Opcode.CHUNK or not self._is_partial(position, end):
                            raise
                        end = position + _CHUNK_HEAD_BYTES
                position = end
            if self._claims_end and not self.is_finished:
                raise BagError('it extends beyond the end of the file, or is not a record')
        except BagError as error:
            if self._claims_end:
                self.is_finished = True
                self.damage = f'the record at byte {position} cannot be used: {error}'
        if not self.is_finished:
            self.unread_bytes = max(0, self._size - position)

    def _is_partial(self, position: int, end: int) -> bool:
        """Return True if only a part of an uncompressed chunk was written to the disk.

        The end of such a chunk is missing, or consists of zeros that the file system has added.
        Returns False for any other invalid chunk, because such a chunk was damaged later.
        """
        if self._claims_end or self._read(position + _PACKING_OFFSET, 4) != bytes(4):
            return False
        self._is_in_partial_chunk = end > self._size or not any(self._read(end - 1, RUN_BYTES))
        return self._is_in_partial_chunk

    def _take(self, opcode: int, offset: int, length: int) -> None:
        """Process the contents of a record that is not a message."""
        if opcode == Opcode.METADATA and length > MAX_METADATA_BYTES:
            return  # not written by rosbag2, whose metadata are shorter
        if opcode not in _TAKEN:
            if MAX_OPCODE < opcode < MIN_PRIVATE_OPCODE:
                raise BagError(f'records of type {opcode} are unknown')
            return
        is_chunk = opcode == Opcode.CHUNK
        _check_size('a record', length, MAX_CHUNK_BYTES if is_chunk else MAX_METADATA_BYTES)
        contents = self._read(offset, length)
        if is_chunk:
            chunk = _decode(Chunk.read, contents)
            packed = chunk.compression != ''
            start = offset - _RECORD.size if packed else offset + length - len(chunk.data)
            data = _unpack_chunk(chunk)
            index = _index_of(data, self._learn)
            if index.size < len(data):
                raise BagError('a chunk ends within a record')
            self._keep(start, index, packed)
        elif opcode == Opcode.METADATA:
            metadata = _decode(Metadata.read, contents)
            if metadata.name == METADATA_NAME:
                self.metadata = metadata.metadata.get(METADATA_KEY, '')
        elif opcode == Opcode.STATISTICS:
            counts = _decode(Statistics.read, contents).channel_message_counts
            self.stated_counts = +Counter(counts)  # the plus sign removes zero counts
        elif opcode == Opcode.DATA_END:
            self._check_data(offset - _RECORD.size, _decode(DataEnd.read, contents))
        else:
            self._learn(opcode, contents)

    def _take_run(self, position: int, length: int) -> int:
        """Process consecutive messages outside chunks; return the position after them."""
        _check_size('a message', length, MAX_CHUNK_BYTES)
        data = self._read(position, max(RUN_BYTES, length + _RECORD.size))
        index = _index_of(data)
        if not self._claims_end:
            behind = self._read(position + index.size, _RECORD.size)
            if not any(behind) and (behind or self._is_in_partial_chunk):
                # After a power cut, zeros may replace the end of the data, so the last message may
                # be incomplete.
                data = data[: index.size]
                there = len(data.rstrip(b'\0'))
                whole = max((e for _, _, e in _records(data) if e <= there), default=0)
                index = _index_of(data[:whole])
                if not whole:
                    raise BagError('its end was not written to the disk')
        self._keep(position, index, packed=False)
        return position + index.size

    def _keep(self, offset: int, index: _Index, packed: bool) -> None:
        """Store the position and the summary of a segment."""
        if not index.counts:
            return
        if unknown := sorted(index.counts.keys() - self.topics.keys()):
            raise BagError(f'messages use channel {unknown[0]}, which no channel record defines')
        channels = frozenset(index.counts)
        self._channel_count += 0 if channels in self._channel_sets else len(channels)
        channels = self._channel_sets.setdefault(channels, channels)
        if len(self.segments) >= MAX_SEGMENTS or self._channel_count > MAX_CHANNELS:
            raise BagError(f'it has too many chunks ({len(self.segments)})')
        self.segments.append(
            Segment(index.first_ns, index.last_ns, offset, index.size, packed, channels)
        )
        self.counts += index.counts

    def _learn(self, opcode: int, contents: bytes) -> None:
        _check_size('a definition', len(contents), MAX_RECORD_BYTES)
        if opcode == Opcode.SCHEMA:
            schema = _decode(Schema.read, contents)
            is_new = schema.id not in self._schemas
            is_same = self._schemas.setdefault(schema.id, schema) == schema
        else:
            channel = _decode(Channel.read, contents)
            topic = self._topic_of(channel)
            is_new = channel.id not in self.topics
            is_same = self.topics.setdefault(channel.id, topic) == topic
        if not is_same:  # a definition may be repeated after the data, or in each chunk
            raise BagError('a channel or a message is defined twice, with different contents')
        self._definition_bytes += len(contents) * is_new
        _check_size('all definitions', self._definition_bytes, MAX_DEFINITION_BYTES)

    def _topic_of(self, channel: Channel) -> StoredTopic:
        schema = self._schemas.get(channel.schema_id, Schema(0, b'', '', ''))
        return StoredTopic(
            channel.topic,
            schema.name,
            channel.metadata.get('topic_type_hash', ''),
            schema.data.decode(errors='replace'),
            schema.encoding,
            channel.metadata.get('offered_qos_profiles', ''),
            channel.message_encoding,
        )

    def _check_data(self, end: int, data_end: DataEnd) -> None:
        checksum, expected = 0, data_end.data_section_crc
        for offset in range(0, end if expected else 0, RUN_BYTES):
            checksum = zlib.crc32(self._read(offset, min(RUN_BYTES, end - offset)), checksum)
        if checksum != expected:
            self.damage = 'its checksum does not match its contents; the position is unknown'

    # -- messages -----------------------------------------------------------------------

    def messages_of(self, segment: Segment, channels: Collection[int]) -> Iterator[Message]:
        """Yield the messages of a segment that are on these channels, in the order of arrival."""
        if segment.is_packed:
            _, length, end = self._head(segment.offset)
            data = _unpack_chunk(_decode(Chunk.read, self._read(end - length, length)))
        else:
            data = self._read(segment.offset, segment.size)
        found = []
        for opcode, start, end in _records(data):
            if opcode == _MESSAGE_CODE:
                channel, _, received_at_ns, _ = _MESSAGE.unpack_from(data, start)
                if channel in channels:
                    found.append((received_at_ns, start + _MESSAGE.size, end, channel))
        found.sort()
        for received_at_ns, start, end, channel in found:
            yield min(received_at_ns, MAX_NS), channel, data[start:end]


class _Contents(io.BytesIO):
    """Contents of a record. Reading beyond the end raises an error."""

    def read(self, size: int | None = -1) -> bytes:
        if size is None or size > len(self.getbuffer()) - self.tell():
            raise BagError('a field extends beyond the end of its record')
        return super().read(size)


def _decode(read: Callable[[ReadDataStream], _Record], contents: bytes) -> _Record:
    """Return a record, decoded by the library ``mcap``."""
    try:
        return read(ReadDataStream(_Contents(contents)))
    except UnicodeDecodeError:
        raise BagError('a string in it is not UTF-8') from None


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode of each complete record, and the start and end of its contents."""
    position, last = 0, len(data) - _RECORD.size
    while position <= last:
        opcode, length = _RECORD.unpack_from(data, position)
        start = position + _RECORD.size
        position = start + length
        if position > len(data):
            return
        yield opcode, start, position


def _index_of(data: bytes, learn: Callable[[int, bytes], None] | None = None) -> _Index:
    """Return a summary of the records before the first incomplete record.

    ``learn`` is called with each schema and channel record. If it is None, the summary ends before
    the first record that is not a message.
    """
    counts: dict[int, int] = {}
    first_ns, last_ns, size = 2**64, 0, 0
    for opcode, start, end in _records(data):
        if opcode == _MESSAGE_CODE:
            if end - start < _MESSAGE.size:
                if learn is None and counts:
                    break  # the next call reports it
                raise BagError('a message is shorter than its own header')
            channel, _, received_at_ns, _ = _MESSAGE.unpack_from(data, start)
            counts[channel] = counts.get(channel, 0) + 1
            if received_at_ns < first_ns:
                first_ns = received_at_ns
            if received_at_ns > last_ns:
                last_ns = received_at_ns
        elif learn is None:
            break
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            learn(opcode, data[start:end])
        size = end
    return _Index(Counter(counts), first_ns, last_ns, size)


def _check_size(what: str, size: int, limit: int) -> None:
    if size > limit:
        raise BagError(f'it contains {what} of {size} bytes; the limit is {limit}')


def _unpack_chunk(chunk: Chunk) -> bytes:
    """Return the contents of a chunk. Not more than the stated size is unpacked."""
    size = chunk.uncompressed_size
    _check_size('a chunk', size, MAX_CHUNK_BYTES)
    try:
        unpack = _UNPACK[chunk.compression]
        data = unpack(chunk.data, size + 1)
    except KeyError:
        raise BagError(
            f'a chunk has the compression "{chunk.compression[:16]}"; use zstd, lz4 or none'
        ) from None
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise BagError(f'a chunk cannot be unpacked: {error}') from error
    if len(data) != size:
        raise BagError('the size of a chunk differs from the size that its header states')
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise BagError('the checksum of a chunk does not match its contents')
    return data


def unpack_zstd(packed: bytes, limit: int) -> bytes:
    """Return at most the first ``limit`` bytes of the uncompressed data."""
    window = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
    return window.stream_reader(packed).read(limit)


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    '': lambda packed, limit: packed[:limit],
    'zstd': unpack_zstd,
    'lz4': lambda packed, limit: LZ4FrameDecompressor().decompress(packed, max_length=limit),
}
