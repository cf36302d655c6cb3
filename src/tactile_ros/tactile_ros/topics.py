# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics of a finger: names, types, and requirements of recordings. Independent of ROS."""

from __future__ import annotations

from dataclasses import dataclass

STRAIN = 'tactile_msgs/msg/StrainBlock'
EVENT = 'tactile_msgs/msg/TrialEvent'
FEATURES = 'tactile_msgs/msg/TactileFeatures'
CLASSIFICATION = 'tactile_msgs/msg/Classification'
SPECIFICATIONS = 'tactile_msgs/msg/FeatureSpecifications'
MODELS = 'tactile_msgs/msg/ModelInfos'
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
        Late subscribers receive earlier messages.
    optional : bool
        The recorder does not wait for a publisher of this topic.
    of_rig : bool
        Published by a node of the rig; optional if a hand moves the finger.
    of_classifier : bool
        Published by the classifier; optional if none is running.
    """

    name: str
    type_name: str
    latched: bool = False
    optional: bool = False
    of_rig: bool = False
    of_classifier: bool = False


STRAIN_TOPIC = RecordedTopic('tendon_sensor/strain', STRAIN)
EVENT_TOPIC = RecordedTopic('trial_runner/events', EVENT, latched=True, of_rig=True)
FEATURES_TOPIC = RecordedTopic('tactile_features/features', FEATURES)
SPECIFICATIONS_TOPIC = RecordedTopic(
    'tactile_features/specifications', SPECIFICATIONS, latched=True
)
CLASSIFICATION_TOPIC = RecordedTopic(
    'tactile_classifier/classification', CLASSIFICATION, of_classifier=True
)
MODELS_TOPIC = RecordedTopic('tactile_classifier/models', MODELS, latched=True, of_classifier=True)

FINGER_TOPICS = (
    STRAIN_TOPIC,
    EVENT_TOPIC,
    FEATURES_TOPIC,
    SPECIFICATIONS_TOPIC,
    RecordedTopic('tactile_features/detected_events', EVENT, latched=True, optional=True),
    RecordedTopic('tendon_sensor/wrench', WRENCH),
    RecordedTopic('tendon_sensor/tare_state', TARE, latched=True),
    RecordedTopic('linear_guide/joint_states', JOINT_STATE, of_rig=True),
    RecordedTopic('tendon_actuator/joint_states', JOINT_STATE, of_rig=True),
    CLASSIFICATION_TOPIC,
    MODELS_TOPIC,
)
"""All topics of one finger that are recorded."""


def join_topic(namespace: str, name: str) -> str:
    """Return the absolute name of a topic below a namespace."""
    namespace = namespace.strip('/')
    return f'/{namespace}/{name}' if namespace else f'/{name}'
