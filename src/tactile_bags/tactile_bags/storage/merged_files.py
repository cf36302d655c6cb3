# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages of several data files in the order of their arrival."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
import heapq

from tactile_bags.errors import BagError
from tactile_bags.storage.mcap_reader import McapFile, Message, Segment, StoredTopic
from tactile_bags.storage.sqlite_reader import SqliteFile

MAX_OPEN_BYTES = 256 * 2**20
"""Most that chunks which overlap in time may hold together [byte]."""

_Place = tuple[int, int]
"""Number of a file, and of a part in it."""


class MergedFiles:
    """Merges open data files by time of arrival; what is open at once is bounded.

    Parameters
    ----------
    files : sequence of McapFile or SqliteFile
    """

    def __init__(self, files: Sequence[McapFile | SqliteFile]) -> None:
        self._files = files
        self._open_bytes = 0

    def messages(
        self, names: Collection[str], since_ns: int
    ) -> Iterator[tuple[int, StoredTopic, bytes]]:
        """Yield arrival time [ns], topic and bytes of the messages on some topics."""
        sources = (self._sources(n, file, names, since_ns) for n, file in enumerate(self._files))
        # Of a source, the number is unique: what comes behind it is never compared.
        waiting = heapq.merge(*sources, key=lambda source: source[:2])
        due = next(waiting, None)
        opened: list[tuple[int, _Place, Message, Iterator[Message]]] = []
        while due is not None or opened:
            if due is not None and (not opened or due[:2] <= opened[0][:2]):
                _, place, messages = due
                due = next(waiting, None)
            else:
                received_at_ns, place, message, messages = heapq.heappop(opened)
                yield received_at_ns, self._files[place[0]].topics[message[1]], message[2]
            following = next(messages, None)
            if following is not None:
                heapq.heappush(opened, (following[0], place, following, messages))

    def _sources(
        self, number: int, file: McapFile | SqliteFile, names: Collection[str], since_ns: int
    ) -> Iterator[tuple[int, _Place, Iterator[Message]]]:
        """Yield what of a file is to be read, by its start: start, place, messages."""
        channels = {n for n, topic in file.topics.items() if topic.name in names}
        if isinstance(file, SqliteFile):
            yield 0, (number, 0), file.messages(channels)
            return
        due = [
            (segment.first_ns, i, segment)
            for i, segment in enumerate(file.segments)
            if segment.last_ns >= since_ns and not segment.channels.isdisjoint(channels)
        ]
        for first_ns, i, segment in sorted(due):
            yield first_ns, (number, i), self._open_segment(file, segment, channels)

    def _open_segment(
        self, file: McapFile, segment: Segment, channels: Collection[int]
    ) -> Iterator[Message]:
        self._open_bytes += segment.size
        try:
            if self._open_bytes > MAX_OPEN_BYTES:
                raise BagError(
                    'its chunks overlap in time so much that more than '
                    f'{MAX_OPEN_BYTES} bytes would have to be read at once'
                )
            yield from file.messages_of(segment, channels)
        finally:
            self._open_bytes -= segment.size
