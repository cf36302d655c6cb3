# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of bags. If the process is killed at any time, the bag remains readable."""

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
"""Key in the custom data of a bag; its value is the metadata of the recording, as JSON."""


class BagWriter:
    """Writer of serialised messages to a new bag. A context manager; thread-safe.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag; must not exist yet.
    metadata : mapping
        Description of the recording for readers, convertible to JSON. Must contain
        ``simulated`` (bool).

    Attributes
    ----------
    saved_count : int
        Number of messages in the file, after `close`.
    is_complete : bool
        True if `close` wrote all parts of the bag.

    Raises
    ------
    BagError
        When the folder exists or cannot be created. The methods raise it when writing fails.
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
        return f'{self.path.resolve().name}_0.mcap'  # as rosbag2 names its first file

    def add_topic(self, topic: RecordedTopic, namespace: str = '') -> str:
        """Add a topic; return its absolute name."""
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
        """Add a topic with the definition that another bag contains; return its absolute name."""
        with self._writing() as writer:
            if topic.name in self._topics:
                raise BagError(f'the topic {topic.name} is already in the bag {self.path}')
            self._topics[topic.name] = (writer.add_channel(topic), topic)
        return topic.name

    def add_metadata(self, metadata: Mapping[str, Any]) -> None:
        """Add metadata that were not known at the start of the recording; call before `close`."""
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
        """Write all messages that were added so far to the file.

        If the process is killed, messages that were added after the last call are lost. Has no
        effect after `close`.
        """
        with self._lock:
            writer = self._writer
            if writer is None:
                return
            try:
                writer.flush()
                text = self._metadata_text(writer)
                if not self._has_early_metadata:
                    # `ros2 bag reindex` needs the metadata in the data file.
                    writer.write_metadata(text)
                    self._has_early_metadata = True
                write_metadata(self.path, text)
            except OSError as error:
                raise self._failure(error) from error

    def sync(self) -> None:
        """Wait until the saved data are on the disk, so that they survive a power cut.

        Other threads may write in the meantime. Has no effect after `close`.
        """
        writer = self._writer
        if writer is None:
            return
        try:
            writer.sync()
        except (OSError, ValueError) as error:
            if self._writer is not None:  # if `close` was called meanwhile, there is no error
                raise self._failure(error) from error

    def close(self) -> None:
        """Finish the bag. May be called repeatedly."""
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
        """Lock the open writer for this thread; raise errors of writing as `BagError`."""
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
