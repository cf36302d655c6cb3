# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics of a finger in a recording: types, definitions, quality of service."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_bags.errors import BagError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_PACKAGE = 'tactile_msgs'

STRAIN = 'tactile_msgs/msg/StrainBlock'
EVENT = 'tactile_msgs/msg/TrialEvent'
FEATURES = 'tactile_msgs/msg/TactileFeatures'
CLASSIFICATION = 'tactile_msgs/msg/Classification'
SPECIFICATIONS = 'tactile_msgs/msg/FeatureSpecifications'
MODELS = 'tactile_msgs/msg/ModelInfos'
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
    of_classifier : bool
        Published by the classifier; optional where none runs.
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
PARTIAL_FEATURES_TOPIC = RecordedTopic(
    'tactile_features/partial_features', FEATURES, optional=True
)
SPECIFICATIONS_TOPIC = RecordedTopic(
    'tactile_features/specifications', SPECIFICATIONS, latched=True
)
CLASSIFICATION_TOPIC = RecordedTopic(
    'tactile_classifier/classification', CLASSIFICATION, of_classifier=True
)
PARTIAL_CLASSIFICATION_TOPIC = RecordedTopic(
    'tactile_classifier/partial_classification', CLASSIFICATION, optional=True
)
MODELS_TOPIC = RecordedTopic('tactile_classifier/models', MODELS, latched=True, of_classifier=True)

FINGER_TOPICS = (
    STRAIN_TOPIC,
    EVENT_TOPIC,
    FEATURES_TOPIC,
    PARTIAL_FEATURES_TOPIC,
    SPECIFICATIONS_TOPIC,
    RecordedTopic('tactile_features/detected_events', EVENT, latched=True, optional=True),
    RecordedTopic('slip_detector/slip', SLIP, optional=True),
    RecordedTopic('tendon_sensor/wrench', WRENCH),
    RecordedTopic('tendon_sensor/tare_state', TARE, latched=True),
    RecordedTopic('linear_guide/joint_states', JOINT_STATE, of_rig=True),
    RecordedTopic('tendon_actuator/joint_states', JOINT_STATE, of_rig=True),
    CLASSIFICATION_TOPIC,
    PARTIAL_CLASSIFICATION_TOPIC,
    MODELS_TOPIC,
)
"""Every topic of one finger that a recording holds."""


@lru_cache(maxsize=1)
def _message_definitions() -> dict[str, str]:
    """Return the text of each ``.msg`` file by the name of its type, such as ``Slip``.

    A sourced workspace comes first: its messages are those that its nodes publish. A
    distribution from pip has the same files in the folder ``tactile_msgs`` of this package.
    """
    for folder in (_workspace_folder(), resources.files(__package__) / _PACKAGE):
        if folder is not None and folder.is_dir():
            files = sorted(folder.iterdir(), key=lambda file: file.name)
            texts = {f.name[:-4]: f.read_text('utf-8') for f in files if f.name.endswith('.msg')}
            if texts:
                return texts
    raise BagError(
        f'the package {_PACKAGE} is not installed here; build the workspace and source it'
    )


def _workspace_folder() -> Path | None:
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(_PACKAGE)) / 'msg'
    except LookupError:  # ament knows no such package
        return None
    except ImportError:  # no ROS 2 here
        return None


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
    for name, text in _message_definitions().items():
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
