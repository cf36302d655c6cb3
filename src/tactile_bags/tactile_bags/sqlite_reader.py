# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader of the SQLite storage of rosbag2 (``.db3``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
import sqlite3
from urllib.parse import quote

from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import MAX_CHUNK_BYTES, Message, StoredTopic

MAX_TOPICS = 65_536
"""Largest number of topics in a file, as in MCAP."""

_MESSAGES = (
    'FROM messages WHERE typeof(timestamp) = "integer" AND typeof(data) = "blob" '
    f'AND length(data) <= {MAX_CHUNK_BYTES}'
)
_FAULTS = (sqlite3.Error, TypeError, ValueError, OverflowError)


class SqliteFile:
    """Reader of a ``.db3`` file, with the attributes of `McapFile`.

    ``counts`` are the numbers of rows that are valid messages; ``stated_counts`` are the numbers
    of all rows. If the file is damaged or has another format, the constructor raises `BagError`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[int, StoredTopic] = {}
        self.counts: Counter[int] = Counter()
        self.stated_counts: Counter[int] = Counter()
        self.is_finished = True  # SQLite rolls back unfinished transactions
        self.metadata = ''
        self.damage: str | None = None
        self.newest_ns = self.unread_bytes = 0
        # Read-only: opening must not change the file.
        self._database = sqlite3.connect(
            f'file:{quote(str(path.resolve()))}?mode=ro', uri=True, check_same_thread=False
        )
        try:
            self._read_topics()
        except _FAULTS as error:
            self._database.close()
            raise BagError(f'SQLite cannot read it: {error}') from error
        except BaseException:
            self._database.close()
            raise

    def close(self) -> None:
        """Close the file. May be called repeatedly."""
        self._database.close()

    def read_parts(self) -> Iterator[bytes]:
        """Yield the bytes of the whole file in parts of 1 MiB."""
        with self.path.open('rb') as data:
            while part := data.read(2**20):
                yield part

    def _read_topics(self) -> None:
        # The file is untrusted: its views, triggers and functions must not run.
        self._database.execute('PRAGMA trusted_schema = OFF')
        kinds = dict(
            self._database.execute(
                "SELECT name, type FROM sqlite_master WHERE name IN ('topics', 'messages')"
            )
        )
        if kinds != {'topics': 'table', 'messages': 'table'}:
            raise BagError('it does not have the tables of a bag')
        query = f'SELECT id, name, type, serialization_format FROM topics LIMIT {MAX_TOPICS}'
        for number, name, type_name, serialization in self._database.execute(query):
            self.topics[int(number)] = StoredTopic(
                str(name), str(type_name), serialization=str(serialization)
            )
        count = 'SELECT topic_id, COUNT(*), MAX(timestamp)'
        rows = f'{count} FROM messages GROUP BY topic_id'
        self.stated_counts = Counter({i: n for i, n, _ in self._database.execute(rows)})
        usable = f'{count} {_MESSAGES} GROUP BY topic_id'
        for number, messages, newest_ns in self._database.execute(usable):
            if number in self.topics:
                self.counts[number] = messages
                self.newest_ns = max(self.newest_ns, newest_ns)

    def messages(self, channels: Collection[int]) -> Iterator[Message]:
        """Yield the messages on these channels, in the order of arrival."""
        query = f'SELECT timestamp, topic_id, data {_MESSAGES} ORDER BY timestamp, id'
        try:
            for received_at_ns, number, data in self._database.execute(query):
                if number in channels:
                    yield received_at_ns, number, data
        except _FAULTS as error:
            raise BagError(f'SQLite cannot read it: {error}') from error
