# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where the messages of an MCAP file lie: a table of few bytes a chunk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
import struct

import numpy as np
from numpy.typing import NDArray

from tactile_bags.errors import BagError
from tactile_bags.storage.mcap_format import MAX_INDEX_BYTES

PACKINGS = ('', 'lz4', 'zstd')
"""Compressions of a chunk; empty: none."""

_ROW = struct.Struct('<QQQIIIIB')
_ROW_TYPE = np.dtype(
    {
        'names': ['first_ns', 'last_ns', 'group'],
        'formats': ['<u8', '<u8', '<u4'],
        'offsets': [0, 8, 36],
        'itemsize': _ROW.size,
    }
)
_GROUP_BYTES, _CHANNEL_BYTES = 1000, 300
"""Memory of a set of channels, and of each of its channels [byte]."""


@dataclass
class Segment:
    """A part of the file whose messages are read at once: a chunk, or a run without one.

    Attributes
    ----------
    first_ns, last_ns : int
        Times of arrival, as its writer states them for a chunk.
    offset, stored_bytes : int
        Where its contents lie in the file, packed as they are.
    size : int
        Bytes when unpacked.
    compression : str
        One of `PACKINGS`.
    checksum : int
        CRC-32 of the unpacked contents; 0: none given.
    """

    first_ns: int
    last_ns: int
    offset: int
    stored_bytes: int
    size: int
    compression: str = ''
    checksum: int = 0


class SegmentTable:
    """The segments of a file in its order, with the channels of each.

    Segments with the same channels share one set of them, so a segment takes 41 bytes.

    Raises
    ------
    BagError
        When it would take more memory than `MAX_INDEX_BYTES`.
    """

    def __init__(self) -> None:
        self._rows = bytearray()
        self._groups: dict[frozenset[int], int] = {}
        self._counts: list[Counter[int]] = []
        self._group_bytes = 0

    def __len__(self) -> int:
        return len(self._rows) // _ROW.size

    def add(self, segment: Segment, counts: Counter[int] | None) -> None:
        """Add a segment; ``counts``: its messages by channel, None when they are not known."""
        self._rows += _ROW.pack(
            segment.first_ns,
            segment.last_ns,
            segment.offset,
            segment.stored_bytes,
            segment.size,
            segment.checksum,
            self._group_of(counts),
            PACKINGS.index(segment.compression),
        )
        if len(self._rows) + self._group_bytes > MAX_INDEX_BYTES:
            raise BagError(
                f'it has so many chunks ({len(self)}) that their index would take more than '
                f'{MAX_INDEX_BYTES} bytes'
            )

    def _group_of(self, counts: Counter[int] | None) -> int:
        """Return the number of a set of channels, from 1; 0 when it is not known."""
        if counts is None:
            return 0
        channels = frozenset(counts)
        if channels not in self._groups:
            self._groups[channels] = len(self._groups) + 1
            self._counts.append(Counter())
            self._group_bytes += _GROUP_BYTES + len(channels) * _CHANNEL_BYTES
        number = self._groups[channels]
        self._counts[number - 1] += counts
        return number

    def __getitem__(self, i: int) -> Segment:
        *numbers, checksum, _, packing = _ROW.unpack_from(self._rows, i * _ROW.size)
        first_ns, last_ns, offset, stored_bytes, size = numbers
        return Segment(first_ns, last_ns, offset, stored_bytes, size, PACKINGS[packing], checksum)

    @property
    def counts(self) -> Counter[int]:
        """Messages by channel in all segments whose channels are known."""
        return sum(self._counts, Counter())

    def unknown(self, topics: Collection[int]) -> Iterator[tuple[int, bool]]:
        """Yield those segments that hold other channels than these, or are not known to.

        With each: whether its channels are known. What is learnt on the way counts.
        """
        names = {number: channels for channels, number in self._groups.items()}
        for i in np.flatnonzero(~np.isin(self._column('group'), self._within(topics))).tolist():
            group = _ROW.unpack_from(self._rows, i * _ROW.size)[6]
            if not group or not names[group] <= set(topics):
                yield i, bool(group)

    def set_counts(self, i: int, counts: Counter[int]) -> None:
        """Set the messages by channel of a segment of which they were not known."""
        struct.pack_into('<I', self._rows, i * _ROW.size + 36, self._group_of(counts))

    def forget_counts(self) -> None:
        """Let the channels of all segments be unknown."""
        for i in range(len(self)):
            struct.pack_into('<I', self._rows, i * _ROW.size + 36, 0)
        self._groups.clear()
        self._counts.clear()
        self._group_bytes = 0

    def in_time(self, channels: Collection[int], since_ns: int) -> Iterator[tuple[int, int]]:
        """Yield start and number of those segments with any of some channels, by their start.

        Those that end before ``since_ns`` are left out.
        """
        wanted = [n for names, n in self._groups.items() if not names.isdisjoint(channels)]
        first_ns = self._column('first_ns')
        is_due = np.isin(self._column('group'), wanted) & (self._column('last_ns') >= since_ns)
        (numbers,) = np.nonzero(is_due)
        for i in numbers[np.argsort(first_ns[numbers], kind='stable')].tolist():
            yield int(first_ns[i]), i

    @property
    def newest_ns(self) -> int:
        """When the last of the segments began [ns]; 0: there is none."""
        return int(self._column('first_ns').max(initial=0))

    def _within(self, topics: Collection[int]) -> list[int]:
        return [number for names, number in self._groups.items() if names <= set(topics)]

    def _column(self, name: str) -> NDArray[np.uint64]:
        # While this view lives, the table cannot grow: it is read when the file is known.
        return np.ndarray(len(self), _ROW_TYPE, self._rows)[name]
