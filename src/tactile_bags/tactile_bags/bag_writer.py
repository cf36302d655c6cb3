# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes a bag that opens again whenever its writer is killed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
import json
from pathlib import Path
import shutil
import threading
from typing import Any

from tactile_bags.bag_metadata import format_metadata, write_metadata
from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import StoredTopic
from tactile_bags.mcap_writer import McapWriter
from tactile_bags.message_types import message_store, qos_text
from tactile_ros.topics import join_topic, RecordedTopic

METADATA_KEY = 'tactile'
"""Key of the bag's custom data that holds the metadata of the recording, as JSON."""


class BagWriter:
    """Writes serialised messages into a new bag. A context manager; thread-safe.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag; must not exist yet.
    metadata : mapping
        What a reader must know about the recording; JSON-able. Holds at least
        ``simulated`` (bool).

    Attributes
    ----------
    saved_count : int
        Messages that are in the file; told by `close`.
    is_complete : bool
        Whether `close` could write all that belongs to a bag.

    Raises
    ------
    BagError
        When the folder exists or cannot be made, and later when it cannot be written to.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any]) -> None:
        self.path = Path(path)
        self.store = message_store()
        self.saved_count = 0
        self.is_complete = False
        self._lock = threading.Lock()
        self._topics: dict[str, tuple[int, StoredTopic]] = {}
        self._metadata = dict(metadata)
        self._custom = {METADATA_KEY: json.dumps(self._metadata, sort_keys=True)}
        self._has_early_metadata = False
        self._writer: McapWriter | None = None
        try:
            self.path.mkdir(parents=True)
        except FileExistsError:
            raise BagError(
                f'cannot write a bag at {self.path}: it exists already; choose another name'
            ) from None
        except OSError as error:
            raise self._failure(error) from error
        try:
            self._writer = McapWriter(self.path / self._file_name)
            write_metadata(self.path, self._metadata_text(self._writer))
        except OSError as error:
            shutil.rmtree(self.path, ignore_errors=True)
            raise self._failure(error) from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _file_name(self) -> str:
        return f'{self.path.resolve().name}_0.mcap'  # as rosbag2 counts them, who looks for that

    def add_topic(self, topic: RecordedTopic, namespace: str = '') -> str:
        """Announce a topic; return its absolute name."""
        definition, _ = self.store.generate_msgdef(topic.type_name, ros_version=2)
        return self.add_stored_topic(
            StoredTopic(
                join_topic(namespace, topic.name),
                topic.type_name,
                self.store.hash_rihs01(topic.type_name),
                definition,
                qos=qos_text(latched=topic.latched),
            )
        )

    def add_stored_topic(self, topic: StoredTopic) -> str:
        """Announce a topic as another bag has it; return its absolute name."""
        with self._writing() as writer:
            if topic.name in self._topics:
                raise BagError(f'the topic {topic.name} is in the bag {self.path} already')
            self._topics[topic.name] = (writer.add_channel(topic), topic)
        return topic.name

    def add_metadata(self, metadata: Mapping[str, Any]) -> None:
        """Add metadata that are known only during the recording; call before `close`."""
        with self._writing():
            self._metadata.update(metadata)
            self._custom[METADATA_KEY] = json.dumps(self._metadata, sort_keys=True)
            self._has_early_metadata = False

    def write_raw(self, topic: str, received_at_ns: int, data: bytes) -> None:
        """Write one serialised message."""
        with self._writing() as writer:
            writer.write(self._topics[topic][0], received_at_ns, data)

    def write(self, topic: str, received_at_ns: int, message: Any) -> None:
        """Serialise a message of this writer's ``store`` and write it."""
        data = self.store.serialize_cdr(message, self._topics[topic][1].type_name)
        self.write_raw(topic, received_at_ns, bytes(data))

    def save(self) -> None:
        """Bring all that was written so far into the files.

        What comes after is lost when the process is killed before the next call. Harmless
        after `close`.
        """
        with self._lock:
            writer = self._writer
            if writer is None:
                return
            try:
                writer.flush()
                text = self._metadata_text(writer)
                if not self._has_early_metadata:
                    # For `ros2 bag reindex`, which goes by the data file alone.
                    writer.write_metadata(text)
                    self._has_early_metadata = True
                write_metadata(self.path, text)
            except OSError as error:
                raise self._failure(error) from error

    def sync(self) -> None:
        """Wait until what was saved is on the disk, for when the power fails.

        Other threads may go on writing meanwhile. Harmless after `close`.
        """
        writer = self._writer
        if writer is None:
            return
        try:
            writer.sync()
        except (OSError, ValueError) as error:
            if self._writer is not None:  # otherwise `close` was faster
                raise self._failure(error) from error

    def close(self) -> None:
        """Finish the bag. Harmless when called twice."""
        with self._lock:
            writer, self._writer = self._writer, None
            if writer is None:
                return
            try:
                with closing(writer):
                    writer.flush()
                    text = self._metadata_text(writer)
                    writer.write_metadata(text)
                write_metadata(self.path, text)
                self.is_complete = True
            except OSError as error:
                raise self._failure(error) from error
            finally:
                self.saved_count = sum(writer.counts.values())

    def _metadata_text(self, writer: McapWriter) -> str:
        topics = [(topic, writer.counts[channel]) for channel, topic in self._topics.values()]
        span_ns = (writer.first_ns, writer.last_ns)
        return format_metadata(self._file_name, topics, span_ns, self._custom)

    @contextmanager
    def _writing(self) -> Iterator[McapWriter]:
        """Give the open writer to this thread alone; what the disk refuses is a `BagError`."""
        with self._lock:
            if self._writer is None:
                raise BagError(f'the bag {self.path} is closed')
            try:
                yield self._writer
            except OSError as error:
                raise self._failure(error) from error

    def _failure(self, error: OSError | ValueError) -> BagError:
        reason = getattr(error, 'strerror', None) or error
        return BagError(f'cannot write a bag at {self.path}: {reason}')
