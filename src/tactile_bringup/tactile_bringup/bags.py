# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of tactile recordings: MCAP, as rosbag2 writes them, without rosbag2."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_bringup.errors import BagError

STRAIN = 'tactile_msgs/msg/StrainBlock'
EVENT = 'tactile_msgs/msg/TrialEvent'
FEATURES = 'tactile_msgs/msg/TactileFeatures'
CLASSIFICATION = 'tactile_msgs/msg/Classification'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
JOINT_STATE = 'sensor_msgs/msg/JointState'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
TARE = 'tactile_msgs/msg/Tare'

FACTS_KEY = 'tactile'
"""Key of the bag's custom data that holds the facts about the recording, as JSON."""


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of one finger, relative to its namespace.

    Attributes
    ----------
    name : str
        For example ``tendon_sensor/strain``.
    type_name : str
        For example ``tactile_msgs/msg/StrainBlock``.
    latched : bool
        Whether late subscribers receive earlier messages.
    """

    name: str
    type_name: str
    latched: bool = False


STRAIN_TOPIC = RecordedTopic('tendon_sensor/strain', STRAIN)
EVENT_TOPIC = RecordedTopic('trial_runner/events', EVENT, latched=True)
FEATURES_TOPIC = RecordedTopic('tactile_features/features', FEATURES)


def classification_topic(classifier: str) -> RecordedTopic:
    """Return the topic of the classifier node with this name."""
    return RecordedTopic(f'{classifier}/classification', CLASSIFICATION)


def recorded_topics(classifiers: tuple[str, ...]) -> tuple[RecordedTopic, ...]:
    """Return every topic of one finger that a recording holds."""
    return (
        STRAIN_TOPIC,
        EVENT_TOPIC,
        FEATURES_TOPIC,
        *(classification_topic(name) for name in classifiers),
        RecordedTopic('tendon_sensor/wrench', WRENCH),
        RecordedTopic('tendon_sensor/tare_state', TARE, latched=True),
        RecordedTopic('linear_guide/joint_states', JOINT_STATE),
        RecordedTopic('tendon_actuator/joint_states', JOINT_STATE),
    )


def message_store() -> Typestore:
    """Return the message types of ROS 2 Jazzy and of ``tactile_msgs``.

    Raises
    ------
    BagError
        When the workspace with ``tactile_msgs`` is not on the ament path.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        share = Path(get_package_share_directory('tactile_msgs'))
    except LookupError as error:
        raise BagError(
            'the package tactile_msgs is not installed here; build the workspace and source it'
        ) from error
    for path in sorted(share.glob('msg/*.msg')):
        store.register(get_types_from_msg(path.read_text(), f'tactile_msgs/msg/{path.stem}'))
    return store


def join_topic(namespace: str, name: str) -> str:
    """Return the absolute name of a topic below a namespace."""
    namespace = namespace.strip('/')
    return f'/{namespace}/{name}' if namespace else f'/{name}'


def _qos(latched: bool) -> Qos:
    forever = QosTime(sec=9223372036, nsec=854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=16 if latched else 1000,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


class BagWriter:
    """Writes serialised messages into a new bag. A context manager.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag; must not exist yet.
    facts : mapping
        What a reader must know about the recording; JSON-able. Holds at least
        ``simulated`` (bool).

    Raises
    ------
    BagError
        When the folder exists or cannot be made.
    """

    def __init__(self, path: Path, facts: Mapping[str, Any]) -> None:
        self.path = Path(path)
        self.store = message_store()
        self._facts = dict(facts)
        self._connections: dict[str, Connection] = {}
        self._writer: Writer | None = None
        try:
            writer = Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
            writer.set_custom_data(FACTS_KEY, json.dumps(self._facts, sort_keys=True))
            writer.open()
        except WriterError as error:
            raise BagError(f'cannot write a bag at {self.path}: {error}') from error
        except OSError as error:
            raise BagError(f'cannot write a bag at {self.path}: {error.strerror}') from error
        self._writer = writer

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def add_topic(self, topic: RecordedTopic, namespace: str = '') -> str:
        """Announce a topic; return its absolute name."""
        name = join_topic(namespace, topic.name)
        self._connections[name] = self._open_writer().add_connection(
            name,
            topic.type_name,
            typestore=self.store,
            offered_qos_profiles=[_qos(topic.latched)],
        )
        return name

    def add_facts(self, facts: Mapping[str, Any]) -> None:
        """Add facts that only the recording itself has brought out; call before `close`."""
        self._facts.update(facts)
        self._open_writer().set_custom_data(FACTS_KEY, json.dumps(self._facts, sort_keys=True))

    def write_raw(self, topic: str, received_at_ns: int, data: bytes) -> None:
        """Write one serialised message."""
        self._open_writer().write(self._connections[topic], received_at_ns, data)

    def write(self, topic: str, received_at_ns: int, message: Any) -> None:
        """Serialise a message of this writer's ``store`` and write it."""
        connection = self._connections[topic]
        data = self.store.serialize_cdr(message, connection.msgtype)
        self._open_writer().write(connection, received_at_ns, bytes(data))

    def close(self) -> None:
        """Finish the bag. Harmless when called twice."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    def _open_writer(self) -> Writer:
        if self._writer is None:
            raise BagError(f'the bag {self.path} is closed')
        return self._writer


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag: topic, arrival time, bytes, and how to read them."""

    topic: str
    type_name: str
    received_at_ns: int
    data: bytes
    store: Typestore

    def decode(self) -> Any:
        """Return the message with the fields of its definition."""
        return self.store.deserialize_cdr(self.data, self.type_name)


class TactileBag:
    """A bag of tactile recordings, for reading. A context manager.

    Raises
    ------
    BagError
        When there is no readable bag at ``path``, or none with strain blocks.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._store = message_store()
        try:
            self._reader = Reader(self.path)
            self._reader.open()
        except Exception as error:  # a damaged file makes the parser raise anything
            raise BagError(f'{self.path} is not a readable bag: {error}') from error
        try:
            self._check_types()
            custom = self._reader.storage.metadata.custom or {}
            self.facts: dict[str, Any] = json.loads(custom.get(FACTS_KEY, '{}'))
            if not isinstance(self.facts, dict):
                raise BagError('the facts in its metadata are not a JSON object')
        except (BagError, ValueError) as error:
            self.close()
            raise BagError(f'{self.path}: {error}') from error

    def _check_types(self) -> None:
        types = {c.msgtype for c in self._reader.connections}
        if STRAIN not in types:
            raise BagError('no topic of type tactile_msgs/msg/StrainBlock in it')
        for connection in self._reader.connections:
            known = self._store.fielddefs.get(connection.msgtype)
            if known is None or not connection.digest.startswith('RIHS01_'):
                continue
            if connection.digest != self._store.hash_rihs01(connection.msgtype):
                raise BagError(
                    f'{connection.topic} was recorded with another definition of '
                    f'{connection.msgtype} than the one installed here'
                )

    def __enter__(self) -> TactileBag:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. Harmless when called twice."""
        self._reader.close()

    @property
    def topics(self) -> dict[str, tuple[str, int]]:
        """Type and number of messages by topic."""
        return {
            name: (info.msgtype or '', info.msgcount) for name, info in self._reader.topics.items()
        }

    @property
    def namespaces(self) -> tuple[str, ...]:
        """Namespaces of the fingers that were recorded; the root is ``''``."""
        suffix = f'/{STRAIN_TOPIC.name}'
        names = {c.topic for c in self._reader.connections if c.topic.endswith(suffix)}
        return tuple(sorted(name[: -len(suffix)].strip('/') for name in names))

    def _finger_of(self, topic: str) -> str | None:
        """Return the innermost finger's namespace that a topic lies in."""
        around = [name for name in self.namespaces if topic.startswith(join_topic(name, ''))]
        return max(around, key=len, default=None)

    def messages(self, *type_names: str, namespace: str | None = None) -> Iterator[BagMessage]:
        """Yield messages in the order of their arrival.

        Parameters
        ----------
        *type_names : str
            Only messages of these types; all of them when left out.
        namespace : str, optional
            Only topics of the finger with this namespace; not of one within it.

        Raises
        ------
        BagError
            When the file is damaged; what came before has been given.
        """
        finger = None if namespace is None else namespace.strip('/')
        chosen = [
            c
            for c in self._reader.connections
            if (not type_names or c.msgtype in type_names)
            and (finger is None or self._finger_of(c.topic) == finger)
        ]
        if not chosen:
            return
        messages = self._reader.messages(chosen)
        while True:
            try:
                connection, received_at_ns, data = next(messages)
            except StopIteration:
                return
            except Exception as error:
                raise BagError(f'{self.path} is damaged: {error}') from error
            yield BagMessage(
                connection.topic, connection.msgtype, received_at_ns, bytes(data), self._store
            )

    def sha256(self) -> str:
        """Return the hash of the bag's data files, as hex digits."""
        digest = hashlib.sha256()
        for path in sorted(self.path.glob('*.mcap')):
            digest.update(path.read_bytes())
        return digest.hexdigest()
