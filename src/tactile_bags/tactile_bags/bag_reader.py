# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader of bags written by this package or by rosbag2, including bags that were not closed."""

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
"""Largest data file that is unpacked to disk from a bag of compressed files [byte]."""

MAX_OPEN_BYTES = 256 * 2**20
"""Largest total size of chunks that are open at the same time, because they overlap [byte]."""

_Place = tuple[int, int]
"""Position of a `Segment`: index of the file, and index of the segment in the file."""

_SUFFIXES: dict[str, type[McapFile] | type[SqliteFile]] = {'.mcap': McapFile, '.db3': SqliteFile}


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag: topic, arrival time, bytes, and how to decode them."""

    topic: str
    type_name: str
    received_at_ns: int
    data: bytes
    store: Typestore

    def decode(self) -> Any:
        """Return the message with the fields of the installed definition.

        If the message was recorded with another definition, it is decoded with the definition that
        the bag contains. Fields that the installed definition does not have are dropped. Fields
        that the recorded definition does not have get their defaults. Raises `BagError` when the
        message is damaged.
        """
        try:
            message = self.store.deserialize_cdr(self.data, self.type_name)
        except Exception as error:  # invalid input can raise any error
            raise BagError(f'a message on {self.topic} is damaged: {error}') from error
        if not self.is_of_another_release:
            return message
        return complete_message(message, self.type_name, self.store)

    @property
    def is_of_another_release(self) -> bool:
        """True if the definition of the message in the bag differs from the installed one."""
        return self.store is not message_store()


class TactileBag:
    """Reader of a bag of tactile recordings. A context manager.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag, or one data file (``.mcap``, ``.db3``).
    needs_strain : bool
        If True, refuse a bag without strain blocks.
    needs_all : bool
        If True, refuse a closed bag that was damaged or has lost messages after it was closed.

    Attributes
    ----------
    metadata : dict
        Metadata of the recording, written by the recorder; empty for bags of other software.
    recovered : str or None
        If the bag was never closed or is damaged, a sentence that describes which messages may be
        missing; otherwise None. The sentence is also logged as a warning.
    damage : str or None
        Description of the damage in closed files; None if there is none.

    Raises
    ------
    BagError
        When there is no readable bag at ``path``, or a requirement of ``needs_strain`` or
        ``needs_all`` is not met.
    """

    def __init__(self, path: Path, *, needs_strain: bool = True, needs_all: bool = True) -> None:
        self.path = Path(path)
        self._needs_strain = needs_strain
        self._store = message_store()
        self._files: list[McapFile | SqliteFile] = []
        self._merged = _MergedFiles(self._files)
        self._foreign: dict[str, str] = {}  # maps each type that cannot be decoded to the reason
        self._stored: dict[str, Typestore] = {}  # for topics whose definition in the bag differs
        self._stack = ExitStack()
        try:
            metadata = self._open()
            self._check_types(metadata)
            damaged = [f'{file.path.name}: {file.damage}' for file in self._files if file.damage]
            self.damage: str | None = None
            if damaged:
                self.damage = f'it was damaged after it was closed: {"; ".join(damaged)}'
            difference = self.damage or self._compare_counts(metadata)
            if difference and needs_all:
                raise BagError(f'{difference}. `tactile repair` copies the readable messages')
            self.metadata = _read_metadata(metadata.custom)
        except (BagError, OSError) as error:
            self.close()
            raise BagError(f'{self.path} is not a readable bag: {error}') from error
        except BaseException:
            self.close()
            raise
        self._file_metadata = metadata
        self.recovered = difference or self._format_recovery()
        if self.recovered is not None:
            logging.getLogger(__name__).warning('%s', self.recovered)

    def __enter__(self) -> TactileBag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. May be called repeatedly."""
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
                # In a file that was never closed, the copy of metadata.yaml may be incomplete. It
                # is ignored.
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
            raise BagError(f'it contains neither {FILE_NAME} nor a .mcap or .db3 file')
        return found

    def _open_file(self, path: Path) -> McapFile | SqliteFile:
        if self._packing == 'file':
            path = self._unpack_file(path)
        kind = _SUFFIXES.get(path.suffix)
        if kind is None:
            raise BagError(f'files of type "{path.suffix}" are not supported')
        if not path.is_file():  # opening a pipe would block
            raise BagError('it is not a file' if path.exists() else 'it does not exist')
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
                        raise BagError(
                            f'after unpacking, it has more than {MAX_UNPACKED_BYTES} bytes'
                        )
                    file.write(part)
            except zstandard.ZstdError as error:
                raise BagError(f'it cannot be unpacked: {error}') from error
        return target

    def _check_types(self, metadata: BagMetadata) -> None:
        types = set(metadata.topics.values()) | {t.type_name for t in self.stored_topics}
        if self._needs_strain and STRAIN not in types:
            raise BagError('it has no topic of type tactile_msgs/msg/StrainBlock')
        for topic in self.stored_topics:
            if topic.serialization != 'cdr':
                raise BagError(
                    f'{topic.name} is serialized as {topic.serialization[:16]}, not cdr'
                )
            type_hash = metadata.type_hashes.get(topic.name) or topic.type_hash
            if topic.type_name not in self._store.fielddefs or not type_hash.startswith('RIHS01_'):
                continue
            if type_hash != self._store.hash_rihs01(topic.type_name):
                reason = (
                    f'{topic.name} was recorded with a definition of '
                    f'{topic.type_name} that differs from the installed one'
                )
                if topic.type_name in (STRAIN, EVENT):
                    raise BagError(reason)
                store = store_of_definition(topic, type_hash)
                if store is None:
                    self._foreign[topic.type_name] = reason
                else:
                    self._stored[topic.name] = store

    def _compare_counts(self, metadata: BagMetadata) -> str | None:
        """Compare the numbers of messages in the files with the statistics and the metadata.

        Returns a sentence about the first difference, or None if they agree.
        """
        if not all(file.is_finished for file in self._files):
            return None  # `_format_recovery` describes what may be missing in an unfinished file
        there: Counter[str] = Counter()
        for file in self._files:
            stated = file.counts if file.stated_counts is None else file.stated_counts
            for number in sorted({*file.topics, *stated}, key=str):
                topic = file.topics.get(number)
                name = topic.name if topic else f'an unknown topic (number {number})'
                there[name] += file.counts[number]
                if stated[number] != file.counts[number]:
                    return (
                        f'{file.path.name} contains {file.counts[number]} messages on {name}, but '
                        f'its statistics state {stated[number]}: it was damaged after it was '
                        'closed'
                    )
        # Without metadata.yaml, counts are not compared: the copy of it in a data file may
        # describe the whole bag or only a part of it.
        for name, count in (metadata.counts if self._has_metadata else {}).items():
            if there[name] != count:
                return (
                    f'it contains {there[name]} messages on {name}, but its {FILE_NAME} states '
                    f'{count}: it was damaged after it was closed'
                )
        return None

    def _format_recovery(self) -> str | None:
        unfinished = [file.path.name for file in self._files if not file.is_finished]
        if unfinished:
            count = sum(sum(file.counts.values()) for file in self._files)
            lost = max(0, sum(self._file_metadata.counts.values()) - count)
            missing = (
                f'{lost} recorded messages are missing: the file was truncated later'
                if lost
                else 'messages of its last second may be missing'
            )
            unread_bytes = sum(file.unread_bytes for file in self._files)
            if unread_bytes:
                missing += f'; the last {unread_bytes} bytes are an incomplete message'
            return (
                f'{self.path} was never closed: its recorder was killed or is still '
                f'writing. Its {count} complete messages are read; {missing}. '
                '`tactile repair` writes a closed copy.'
            )
        if self.path.is_dir() and not self._has_metadata:
            return (
                f'{self.path} has no {FILE_NAME}, or an empty one, so it was not closed properly; '
                'its data files are complete. `tactile repair` writes a closed copy.'
            )
        return None

    # -- contents --------------------------------------------------------------------------

    @property
    def stored_topics(self) -> list[StoredTopic]:
        """The topics of all data files; each topic occurs once."""
        return list({t.name: t for file in self._files for t in file.topics.values()}.values())

    @property
    def topics(self) -> dict[str, tuple[str, int]]:
        """Type and number of messages of each topic."""
        types = {**self._file_metadata.topics, **{t.name: t.type_name for t in self.stored_topics}}
        counts: Counter[str] = Counter()
        for file in self._files:
            for number, topic in file.topics.items():
                counts[topic.name] += file.counts[number]
        return {name: (type_name, counts[name]) for name, type_name in types.items()}

    @property
    def namespaces(self) -> tuple[str, ...]:
        """Namespaces of the recorded fingers; ``''`` is the root namespace."""
        suffix = f'/{STRAIN_TOPIC.name}'
        names = {name for name in self.topics if name.endswith(suffix)}
        return tuple(sorted(name[: -len(suffix)].strip('/') for name in names))

    def _finger_of(self, topic: str, namespaces: tuple[str, ...]) -> str | None:
        """Return the innermost namespace of a finger that contains a topic, or None."""
        around = [name for name in namespaces if topic.startswith(join_topic(name, ''))]
        return max(around, key=len, default=None)

    def choose_topics(self, type_names: Collection[str], namespace: str | None) -> set[str]:
        """Return the names of the topics that have these types and belong to one finger.

        If ``type_names`` is empty, all types are used; if ``namespace`` is None, all fingers.
        """
        finger = None if namespace is None else namespace.strip('/')
        namespaces = self.namespaces
        return {
            topic.name
            for topic in self.stored_topics
            if (not type_names or topic.type_name in type_names)
            and (finger is None or self._finger_of(topic.name, namespaces) == finger)
        }

    def messages(self, *type_names: str, namespace: str | None = None) -> Iterator[BagMessage]:
        """Yield messages in the order of their arrival.

        Parameters
        ----------
        *type_names : str
            Types of the messages; all types if omitted.
        namespace : str, optional
            Yield only messages of the finger with this namespace, without fingers nested in it. If
            omitted, yield the messages of all topics.

        Raises
        ------
        BagDamageError
            When the file is damaged. The messages before the damage are yielded first.
        BagError
            When one of ``type_names`` was recorded with another definition, and the bag does not
            contain this definition. (If the definition of samples or events differs, the bag
            cannot even be opened.)
        """
        for type_name in type_names:
            if type_name in self._foreign:
                raise BagError(
                    f'{self.path}: {self._foreign[type_name]}; use the release that recorded it'
                )
        chosen = self.choose_topics(type_names, namespace)
        try:
            for received_at_ns, topic, data in self._merged.messages(chosen):
                if self._packing == 'message':
                    data = _unpack_message(data)
                store = self._stored.get(topic.name, self._store)
                yield BagMessage(topic.name, topic.type_name, received_at_ns, data, store)
        except (BagError, OSError) as error:
            raise BagDamageError(f'{self.path} is damaged: {error}') from error
        if self.damage is not None:
            raise BagDamageError(f'{self.path}: {self.damage}')

    @property
    def end_ns(self) -> int:
        """Arrival time of the last message [ns]; 0 if there is none."""
        return max((file.newest_ns for file in self._files), default=0)

    def sha256(self) -> str:
        """Return the SHA-256 digest of the data files of the bag, in hexadecimal digits."""
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
        raise BagError(f'it contains a message of more than {MAX_CHUNK_BYTES} bytes')
    return unpacked


def _is_blank(path: Path) -> bool:
    """Return True if a file is missing or contains only zeros and blanks.

    A power cut can leave zeros in a file.
    """
    if not path.is_file():
        return not path.exists()
    with path.open('rb') as file:
        return not file.read(65536).strip(b'\0 \t\r\n')


def _read_metadata(custom: dict[str, str]) -> dict[str, Any]:
    try:
        metadata = json.loads(custom.get(METADATA_KEY, '{}'))
    except (ValueError, RecursionError) as error:
        raise BagError(f'the custom data of its metadata.yaml are not JSON: {error}') from error
    if not isinstance(metadata, dict):
        raise BagError('the custom data of its metadata.yaml are not a JSON object')
    return metadata


class _MergedFiles:
    """Merges open data files in the order of arrival. Memory is bounded by `MAX_OPEN_BYTES`."""

    def __init__(self, files: Sequence[McapFile | SqliteFile]) -> None:
        self._files = files
        self._open_bytes = 0

    def messages(self, names: Collection[str]) -> Iterator[tuple[int, StoredTopic, bytes]]:
        """Yield arrival time [ns], topic and bytes of the messages on some topics."""
        sources = (self._sources(n, file, names) for n, file in enumerate(self._files))
        # heapq compares tuples. The position of a segment is unique, so the elements after it are
        # never compared.
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
        self, number: int, file: McapFile | SqliteFile, names: Collection[str]
    ) -> Iterator[tuple[int, _Place, Iterator[Message]]]:
        """Yield first arrival time, position and messages of each segment of a file, in order."""
        channels = {n for n, topic in file.topics.items() if topic.name in names}
        if isinstance(file, SqliteFile):
            yield 0, (number, 0), file.messages(channels)
            return
        due = [
            (segment.first_ns, i, segment)
            for i, segment in enumerate(file.segments)
            if not segment.channels.isdisjoint(channels)
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
                    'too many of its chunks overlap in time: more than '
                    f'{MAX_OPEN_BYTES} bytes would have to be in memory'
                )
            yield from file.messages_of(segment, channels)
        finally:
            self._open_bytes -= segment.size
