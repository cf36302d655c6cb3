# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads bags: ours, rosbag2's, and those that were never closed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
import hashlib
import heapq
import json
import logging
from pathlib import Path
import tempfile
from typing import Any

from rosbags.typesys.store import Typestore
import zstandard

from tactile_bags.bag_metadata import (
    BagMetadata,
    FILE_NAME,
    parse_metadata,
    read_metadata,
)
from tactile_bags.bag_writer import METADATA_KEY
from tactile_bags.errors import BagDamageError, BagError
from tactile_bags.mcap_reader import (
    MAX_CHUNK_BYTES,
    McapFile,
    Message,
    Segment,
    StoredTopic,
    unpack_zstd,
)
from tactile_bags.message_types import message_store
from tactile_bags.sqlite_reader import SqliteFile
from tactile_bags.stored_definitions import complete_message, store_of_definition
from tactile_ros.errors import TactileError
from tactile_ros.topics import EVENT, join_topic, STRAIN, STRAIN_TOPIC

MAX_UNPACKED_BYTES = 4 * 2**30
"""Largest data file that is unpacked from a bag of compressed files [byte], onto the disk."""

MAX_OPEN_BYTES = 256 * 2**20
"""Most that chunks which overlap in time may hold together [byte]."""

_Place = tuple[int, int]
"""Number of a file, and of a part in it."""

_SUFFIXES: dict[str, type[McapFile] | type[SqliteFile]] = {'.mcap': McapFile, '.db3': SqliteFile}


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag: topic, arrival time, bytes, and how to read them."""

    topic: str
    type_name: str
    received_at_ns: int
    data: bytes
    store: Typestore

    def decode(self) -> Any:
        """Return the message with the fields of the installed definition.

        Bytes of another definition are decoded by the one that the bag stores: fields that the
        installed definition does not have are left out, and fields that the bag lacks have their
        defaults. `BagError` when the message is damaged.
        """
        try:
            message = self.store.deserialize_cdr(self.data, self.type_name)
        except Exception as error:  # the decoder trusts what it reads
            raise BagError(f'a message on {self.topic} is damaged: {error}') from error
        if not self.is_of_another_release:
            return message
        return complete_message(message, self.type_name, self.store)

    @property
    def is_of_another_release(self) -> bool:
        """True if the definition of its type in the bag differs from the installed one."""
        return self.store is not message_store()


class TactileBag:
    """A bag of tactile recordings, for reading. A context manager.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag, or one data file (``.mcap``, ``.db3``).
    needs_strain : bool
        Refuse a bag without strain blocks.
    needs_all : bool
        Refuse a bag that was closed in order and does not hold what it then held.

    Attributes
    ----------
    metadata : dict
        What the recorder noted about the recording; empty where it was another's.
    recovered : str
        Empty, or a sentence that says that the bag was never finished, or is damaged, and what it
        may lack. It is also logged as a warning.
    damage : str
        Where closed files are damaged; empty: nowhere.

    Raises
    ------
    BagError
        When there is no readable bag at ``path``, or none with strain blocks.
    """

    def __init__(self, path: Path, *, needs_strain: bool = True, needs_all: bool = True) -> None:
        self.path = Path(path)
        self._needs_strain = needs_strain
        self._store = message_store()
        self._files: list[McapFile | SqliteFile] = []
        self._merged = _MergedFiles(self._files)
        self._foreign: dict[str, str] = {}  # sentences by type that cannot be decoded here
        self._stored: dict[str, Typestore] = {}  # by topic of another definition
        self._stack = ExitStack()
        try:
            metadata = self._open()
            self._check_types(metadata)
            damaged = [f'{file.path.name}: {file.damage}' for file in self._files if file.damage]
            self.damage = '; '.join(damaged)
            if damaged:
                self.damage = f'it was damaged after it was closed: {self.damage}'
            difference = self.damage or self._compare_counts(metadata)
            if difference and needs_all:
                raise BagError(f'{difference}. `tactile repair` copies what is there')
            self.metadata = _read_metadata(metadata.custom)
        except (BagError, OSError) as error:
            self.close()
            raise BagError(f'{self.path} is not a readable bag: {error}') from error
        except BaseException:
            self.close()
            raise
        self._file_metadata = metadata
        self.recovered = difference or self._format_recovery()
        if self.recovered:
            logging.getLogger(__name__).warning('%s', self.recovered)

    def __enter__(self) -> TactileBag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. Harmless when called twice."""
        self._stack.close()

    # -- opening -------------------------------------------------------------------------

    def _open(self) -> BagMetadata:
        if not self.path.exists():
            raise BagError('it does not exist')
        self._has_metadata = self.path.is_dir() and not _is_blank(self.path / FILE_NAME)
        metadata = read_metadata(self.path / FILE_NAME) if self._has_metadata else BagMetadata()
        self._packing = metadata.packing
        for path in self._data_files(metadata):
            try:
                self._files.append(self._open_file(path))
            except (BagError, OSError) as error:
                raise BagError(f'{path.name}: {error}') from error
            self._stack.callback(self._files[-1].close)
        copies = [file.metadata for file in self._files if file.metadata]
        if copies and not self._has_metadata:
            try:
                metadata = parse_metadata(copies[-1])
            except TactileError as error:
                # Of a file that was never closed, this too may have come to the disk in part.
                if all(file.is_finished for file in self._files):
                    raise BagError(f'its copy of {FILE_NAME} cannot be used: {error}') from error
        return metadata

    def _data_files(self, metadata: BagMetadata) -> list[Path]:
        if not self.path.is_dir():
            return [self.path]
        if self._has_metadata:
            return [self.path / name for name in metadata.files]
        found = sorted(p for p in self.path.iterdir() if p.suffix in _SUFFIXES)
        if not found:
            raise BagError(f'there is neither a {FILE_NAME} nor a .mcap or .db3 file in it')
        return found

    def _open_file(self, path: Path) -> McapFile | SqliteFile:
        if self._packing == 'file':
            path = self._unpack_file(path)
        kind = _SUFFIXES.get(path.suffix)
        if kind is None:
            raise BagError(f'files of the kind "{path.suffix}" are not known')
        if not path.is_file():  # a pipe would wait for its other end
            raise BagError('it is no file' if path.exists() else 'it does not exist')
        return kind(path)

    def _unpack_file(self, path: Path) -> Path:
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        target, left = folder / path.stem, MAX_UNPACKED_BYTES
        unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
        with path.open('rb') as packed, target.open('xb') as file:
            try:
                for part in unpacker.read_to_iter(packed):
                    left -= len(part)
                    if left < 0:
                        raise BagError(f'unpacked it has more than {MAX_UNPACKED_BYTES} bytes')
                    file.write(part)
            except zstandard.ZstdError as error:
                raise BagError(f'it cannot be unpacked: {error}') from error
        return target

    def _check_types(self, metadata: BagMetadata) -> None:
        types = set(metadata.topics.values()) | {t.type_name for t in self.stored_topics}
        if self._needs_strain and STRAIN not in types:
            raise BagError('no topic of type tactile_msgs/msg/StrainBlock in it')
        for topic in self.stored_topics:
            if topic.serialization != 'cdr':
                raise BagError(f'{topic.name} is in the form {topic.serialization[:16]}, not cdr')
            type_hash = metadata.type_hashes.get(topic.name) or topic.type_hash
            if topic.type_name not in self._store.fielddefs or not type_hash.startswith('RIHS01_'):
                continue
            if type_hash != self._store.hash_rihs01(topic.type_name):
                reason = (
                    f'{topic.name} was recorded with another definition of '
                    f'{topic.type_name} than the one installed here'
                )
                if topic.type_name in (STRAIN, EVENT):
                    raise BagError(reason)
                store = store_of_definition(topic, type_hash)
                if store is None:
                    self._foreign[topic.type_name] = reason
                else:
                    self._stored[topic.name] = store

    def _compare_counts(self, metadata: BagMetadata) -> str:
        """Return where finished files hold other messages than they or the metadata state."""
        if not all(file.is_finished for file in self._files):
            return ''  # it is told what an unfinished one may lack
        there: Counter[str] = Counter()
        for file in self._files:
            stated = file.counts if file.stated_counts is None else file.stated_counts
            for number in sorted({*file.topics, *stated}, key=str):
                topic = file.topics.get(number)
                name = topic.name if topic else f'no known topic (number {number})'
                there[name] += file.counts[number]
                if stated[number] != file.counts[number]:
                    return (
                        f'{file.path.name} holds {file.counts[number]} messages on {name}, and '
                        f'its own statistics say {stated[number]}: it was damaged after it was '
                        'closed'
                    )
        # The copy in a data file may be of the whole bag, or of a part.
        for name, count in (metadata.counts if self._has_metadata else {}).items():
            if there[name] != count:
                return (
                    f'it holds {there[name]} messages on {name}, and its {FILE_NAME} says '
                    f'{count}: it was damaged after it was closed'
                )
        return ''

    def _format_recovery(self) -> str:
        unfinished = [file.path.name for file in self._files if not file.is_finished]
        if unfinished:
            count = sum(sum(file.counts.values()) for file in self._files)
            lost = max(0, sum(self._file_metadata.counts.values()) - count)
            missing = (
                f'{lost} that it once held are missing: the file was cut off later'
                if lost
                else 'what came in its last second may be missing'
            )
            unread_bytes = sum(file.unread_bytes for file in self._files)
            if unread_bytes:
                missing += f'; {unread_bytes} bytes at the end of the data are no whole messages'
            return (
                f'{self.path} was never closed, as when its recorder is killed, or still '
                f'writes. Its {count} whole messages are read; {missing}. '
                '`tactile repair` writes a closed copy.'
            )
        if self.path.is_dir() and not self._has_metadata:
            return (
                f'{self.path} has no {FILE_NAME}, or an empty one, so it was not closed in order; '
                'its data files are whole. `tactile repair` writes a closed copy.'
            )
        return ''

    # -- what is in it ---------------------------------------------------------------------

    @property
    def stored_topics(self) -> list[StoredTopic]:
        """The topics as the data files hold them, each once."""
        return list({t.name: t for file in self._files for t in file.topics.values()}.values())

    @property
    def topics(self) -> dict[str, tuple[str, int]]:
        """Type and number of messages by topic."""
        types = {**self._file_metadata.topics, **{t.name: t.type_name for t in self.stored_topics}}
        counts: Counter[str] = Counter()
        for file in self._files:
            for number, topic in file.topics.items():
                counts[topic.name] += file.counts[number]
        return {name: (type_name, counts[name]) for name, type_name in types.items()}

    @property
    def namespaces(self) -> tuple[str, ...]:
        """Namespaces of the fingers that were recorded; the root is ``''``."""
        suffix = f'/{STRAIN_TOPIC.name}'
        names = {name for name in self.topics if name.endswith(suffix)}
        return tuple(sorted(name[: -len(suffix)].strip('/') for name in names))

    def _finger_of(self, topic: str, namespaces: tuple[str, ...]) -> str | None:
        """Return the innermost finger's namespace that a topic lies in."""
        around = [name for name in namespaces if topic.startswith(join_topic(name, ''))]
        return max(around, key=len, default=None)

    def choose_topics(self, type_names: Collection[str], namespace: str | None) -> set[str]:
        """Return the topics of these types, of any when none is named, and of a finger or all."""
        finger = None if namespace is None else namespace.strip('/')
        namespaces = self.namespaces
        return {
            topic.name
            for topic in self.stored_topics
            if (not type_names or topic.type_name in type_names)
            and (finger is None or self._finger_of(topic.name, namespaces) == finger)
        }

    def messages(
        self, *type_names: str, namespace: str | None = None, since_ns: int = 0
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their arrival.

        Parameters
        ----------
        *type_names : str
            Only messages of these types; all of them when left out.
        namespace : str, optional
            Only topics of the finger with this namespace; not of one within it.
        since_ns : int
            Only what arrived then or later [ns]; what comes before it is not read.

        Raises
        ------
        BagDamageError
            When the file is damaged; what came before has been given.
        BagError
            When one of the types is named and was recorded with another definition, which the bag
            does not store. A bag with another definition of samples or events is not opened.
        """
        for type_name in type_names:
            if type_name in self._foreign:
                raise BagError(
                    f'{self.path}: {self._foreign[type_name]}; use the release that recorded it'
                )
        chosen = self.choose_topics(type_names, namespace)
        try:
            for received_at_ns, topic, data in self._merged.messages(chosen, since_ns):
                if received_at_ns < since_ns:
                    continue
                if self._packing == 'message':
                    data = _unpack_message(data)
                store = self._stored.get(topic.name, self._store)
                yield BagMessage(topic.name, topic.type_name, received_at_ns, data, store)
        except (BagError, OSError) as error:
            raise BagDamageError(f'{self.path} is damaged: {error}') from error
        if self.damage:
            raise BagDamageError(f'{self.path}: {self.damage}')

    @property
    def end_ns(self) -> int:
        """When the last message arrived [ns]; 0: there is none."""
        return max((file.newest_ns for file in self._files), default=0)

    def sha256(self) -> str:
        """Return the hash of the bag's data files, as hex digits."""
        digest = hashlib.sha256()
        for file in self._files:
            for part in file.read_parts():
                digest.update(part)
        return digest.hexdigest()


def _unpack_message(data: bytes) -> bytes:
    try:
        unpacked = unpack_zstd(data, MAX_CHUNK_BYTES + 1)
    except zstandard.ZstdError as error:
        raise BagError(f'a message cannot be unpacked: {error}') from error
    if len(unpacked) > MAX_CHUNK_BYTES:
        raise BagError(f'a message of more than {MAX_CHUNK_BYTES} bytes is in it')
    return unpacked


def _is_blank(path: Path) -> bool:
    """Return whether a file is missing, or holds nothing as after a power failure."""
    if not path.is_file():
        return not path.exists()
    with path.open('rb') as file:
        return not file.read(65536).strip(b'\0 \t\r\n')


def _read_metadata(custom: dict[str, str]) -> dict[str, Any]:
    try:
        metadata = json.loads(custom.get(METADATA_KEY, '{}'))
    except (ValueError, RecursionError) as error:
        raise BagError(f'the custom data of its metadata.yaml are no JSON: {error}') from error
    if not isinstance(metadata, dict):
        raise BagError('the custom data of its metadata.yaml are not a JSON object')
    return metadata


class _MergedFiles:
    """Merges open data files by time of arrival; what is open at once is bounded."""

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
