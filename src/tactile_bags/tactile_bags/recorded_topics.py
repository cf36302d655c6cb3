# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a recording holds: the topics of a finger, their types and quality of service."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from tactile_bags.message_definitions import message_definitions

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

STRAIN = 'tactile_msgs/msg/StrainBlock'
EVENT = 'tactile_msgs/msg/TrialEvent'
FEATURES = 'tactile_msgs/msg/TactileFeatures'
CLASSIFICATION = 'tactile_msgs/msg/Classification'
SLIP = 'tactile_msgs/msg/Slip'
AUDIT = 'tactile_msgs/msg/RecordingAudit'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
JOINT_STATE = 'sensor_msgs/msg/JointState'
TARE = 'tactile_msgs/msg/Tare'


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
    optional : bool
        A recording is not waiting for it: its node need not run.
    of_rig : bool
        Published by what moves a finger on the rig; optional where a hand moves it.
    """

    name: str
    type_name: str
    latched: bool = False
    optional: bool = False
    of_rig: bool = False


STRAIN_TOPIC = RecordedTopic('tendon_sensor/strain', STRAIN)
EVENT_TOPIC = RecordedTopic('trial_runner/events', EVENT, latched=True, of_rig=True)
FEATURES_TOPIC = RecordedTopic('tactile_features/features', FEATURES)
PARTIAL_FEATURES_TOPIC = RecordedTopic(
    'tactile_features/partial_features', FEATURES, optional=True
)

FINGER_TOPICS = (
    STRAIN_TOPIC,
    EVENT_TOPIC,
    FEATURES_TOPIC,
    PARTIAL_FEATURES_TOPIC,
    RecordedTopic('tactile_features/detected_events', EVENT, latched=True, optional=True),
    RecordedTopic('slip_detector/slip', SLIP, optional=True),
    RecordedTopic('tendon_sensor/wrench', WRENCH),
    RecordedTopic('tendon_sensor/tare_state', TARE, latched=True),
    RecordedTopic('linear_guide/joint_states', JOINT_STATE, of_rig=True),
    RecordedTopic('tendon_actuator/joint_states', JOINT_STATE, of_rig=True),
)
"""Every topic of one finger that a recording holds, but for those of its classifiers."""


def classification_topic(classifier: str) -> RecordedTopic:
    """Return the topic of the classifier node with this name."""
    return RecordedTopic(f'{classifier}/classification', CLASSIFICATION)


def partial_topic(classifier: str) -> RecordedTopic:
    """Return the topic of its answers while a window still fills."""
    return RecordedTopic(f'{classifier}/partial_classification', CLASSIFICATION, optional=True)


def recorded_topics(classifiers: tuple[str, ...]) -> tuple[RecordedTopic, ...]:
    """Return every topic of one finger that a recording holds."""
    of_classifiers = (
        f(name) for name in classifiers for f in (classification_topic, partial_topic)
    )
    return (*FINGER_TOPICS, *of_classifiers)


@lru_cache(maxsize=1)
def message_store() -> Typestore:
    """Return the message types of ROS 2 Jazzy and of ``tactile_msgs``.

    Raises
    ------
    BagError
        When the definitions of ``tactile_msgs`` are not installed.
    """
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores  # slow to import

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in message_definitions().items():
        store.register(get_types_from_msg(text, f'tactile_msgs/msg/{name}'))
    return store


def join_topic(namespace: str, name: str) -> str:
    """Return the absolute name of a topic below a namespace."""
    namespace = namespace.strip('/')
    return f'/{namespace}/{name}' if namespace else f'/{name}'


def qos_text(*, latched: bool) -> str:
    """Return the offered quality of service of a topic, as rosbag2 writes it."""
    return _QOS.format(
        depth=16 if latched else 1000, durability='transient_local' if latched else 'volatile'
    )


_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
