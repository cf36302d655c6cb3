# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names and types of the topics of a finger, and which of them a recording must contain.

This module does not import ROS.
"""

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
    """A topic of one finger that is recorded.

    Attributes
    ----------
    name : str
        Name relative to the namespace of the finger, for example ``tendon_sensor/strain``.
    type_name : str
        Type of the messages, for example ``tactile_msgs/msg/StrainBlock``.
    latched : bool
        True if a subscriber that joins later receives earlier messages.
    optional : bool
        True if the recorder does not wait for a publisher of this topic.
    of_rig : bool
        True if a node of the palpation rig publishes the topic. It is optional if a robotic hand
        moves the finger instead.
    of_classifier : bool
        True if the classifier publishes the topic. It is optional if no classifier is running.
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
