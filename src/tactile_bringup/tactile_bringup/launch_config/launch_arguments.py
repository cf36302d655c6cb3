# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The arguments of the launch files, as data, and their values, checked.

``launch`` is not needed to read or to test them, nor for the tables in the documentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_bringup.launch_config.parameter_files import read_parameters
from tactile_classifier.records import CONTACTS
from tactile_features.config import FeatureConfig
from tactile_ros.errors import TactileError


@dataclass(frozen=True)
class LaunchArgument:
    """One argument of a launch file.

    Attributes
    ----------
    description : str
        What it is for, and what its empty value means.
    choices : tuple of str
        What it may be; empty: anything.
    """

    name: str
    description: str
    default: str = ''
    choices: tuple[str, ...] = ()


RIG = LaunchArgument(
    'rig',
    'what is behind the ports: devices, or the simulated rig, which is started here unless '
    'ports are given. It changes the ports, and marks all that comes from a simulated rig',
    'hardware',
    ('hardware', 'simulated'),
)
SENSOR_PORT = LaunchArgument(
    'sensor_port',
    'serial port of the load cell; none: no sensor node is started, another node publishes '
    'tendon_sensor/strain. If params_file names a sensor with an address (net_ft) or a topic, the '
    'sensor node is started. Empty: the port in params_file, or /dev/tactile/sensor',
)
SENSOR_TOPIC = LaunchArgument(
    'sensor_topic',
    'topic of a force that another node publishes, instead of a port: WrenchStamped, Wrench, '
    'Float64, Float32 or JointState. After a colon an axis (fx to tz, norm) or the name of a '
    'joint, as /ft/wrench:fx. Its rate is that of the model, or is measured. Empty: none',
)
GUIDE_PORT = LaunchArgument(
    'guide_port',
    'serial port of the linear guide (Grbl); empty: the port in params_file, or '
    '/dev/tactile/guide',
)
TENDON_PORT = LaunchArgument(
    'tendon_port',
    'serial port of the tendon actuator (Dynamixel); empty: the port in params_file, or '
    '/dev/tactile/tendon',
)
CONTACT = LaunchArgument(
    'contact',
    'how the finger touches: which models are loaded',
    'flexion',
    CONTACTS,
)
MODELS = LaunchArgument(
    'models',
    'folder of model files as "tactile train" writes it, or one file. They say which features are '
    'computed, and each answers the windows that fit it; empty: no classifier',
)
RECALIBRATE = LaunchArgument(
    'recalibrate',
    'known trials (trial events with session_id and object_label) at the start of each session '
    'that correct the models for it; 0: none, otherwise 5 or more',
    '0',
)
PHASES = LaunchArgument(
    'phases',
    'who says when a glide or a hold begins and ends: stated by trial events on '
    'trial_runner/events, or found in the tension, for the kind of contact that is named',
    'stated',
    FeatureConfig.__dataclass_fields__['phases'].metadata['choices'],
)
DETECTED_CONTACT = LaunchArgument(
    'contact',
    'how the finger touches: which models are loaded, and what phases that are found in the '
    'tension say; empty: not known, and all models are loaded',
    '',
    ('', *CONTACTS),
)
SLIP = LaunchArgument(
    'slip',
    'also run the slip detector, which says on slip_detector/slip when a held object slides',
    'false',
    ('false', 'true'),
)
RECORD = LaunchArgument(
    'record', 'folder of the bag to record into, which must not exist; empty: none'
)
PARAMS_FILE = LaunchArgument(
    'params_file',
    'YAML file with ROS parameters of the nodes; they win over those of the launch file. '
    'Empty: the defaults',
)
NAMESPACE = LaunchArgument('namespace', 'namespace of all nodes; empty: the root')
SIM_TIME = LaunchArgument(
    'use_sim_time', 'take the time from /clock instead of the computer', 'false', ('true', 'false')
)
RESPAWN = LaunchArgument(
    'respawn',
    'start a node again that has died. A tendon driver that starts on a taut tendon lets it out',
    'true',
    ('true', 'false'),
)
LOG_LEVEL = LaunchArgument(
    'log_level',
    'least severity that the nodes log',
    'info',
    ('debug', 'info', 'warn', 'error', 'fatal'),
)

_SHARED = (RECORD, PARAMS_FILE, NAMESPACE, SIM_TIME, RESPAWN, LOG_LEVEL)


def _protocol_arguments(beneath: str, example: str) -> tuple[LaunchArgument, ...]:
    simulated_object = LaunchArgument(
        'object', f'the {beneath} under the finger of the simulated rig', example
    )
    ports = (GUIDE_PORT, TENDON_PORT, SENSOR_PORT, SENSOR_TOPIC)
    return (RIG, *ports, CONTACT, MODELS, RECALIBRATE, simulated_object, *_SHARED)


LAUNCH_FILES: dict[str, tuple[LaunchArgument, ...]] = {
    'texture': _protocol_arguments('plate', 'R1'),
    'stiffness': _protocol_arguments('object', 'rubber_shell'),
    'sense': (
        RIG,
        SENSOR_PORT,
        SENSOR_TOPIC,
        MODELS,
        RECALIBRATE,
        PHASES,
        DETECTED_CONTACT,
        SLIP,
        *_SHARED,
    ),
    'hand': (
        RIG,
        LaunchArgument(
            'fingers',
            'namespaces of the fingers, with commas between them, such as index,middle; '
            'empty: all of hand_file',
        ),
        LaunchArgument(
            'hand_file',
            "YAML file that describes the fingers: each one's port or topic, models, phases, slip "
            'and parameters. Empty: each has the port /dev/tactile/<finger> and what the other '
            'arguments say',
        ),
        dataclasses.replace(
            SENSOR_TOPIC,
            description=f'{SENSOR_TOPIC.description}. A relative name is within the namespace of '
            'each finger. hand_file wins',
        ),
        dataclasses.replace(MODELS, description=f'{MODELS.description}. hand_file wins'),
        RECALIBRATE,
        dataclasses.replace(PHASES, description=f'{PHASES.description}. hand_file wins'),
        DETECTED_CONTACT,
        dataclasses.replace(SLIP, description=f'{SLIP.description}. hand_file wins'),
        *_SHARED,
    ),
    'replay': (
        LaunchArgument('bag', 'folder of the recording to play; must be given'),
        LaunchArgument('rate', 'how many times faster than it was recorded', '1.0'),
        dataclasses.replace(
            MODELS,
            description='folder of model files, or one file; empty: those that the recording was '
            'made with, if any',
        ),
        RECORD,
        PARAMS_FILE,
        dataclasses.replace(
            NAMESPACE, description='play the finger in this namespace only; empty: all of them'
        ),
        dataclasses.replace(
            SIM_TIME, description='take the time from the recording, by /clock', default='true'
        ),
        dataclasses.replace(RESPAWN, default='false'),
        LOG_LEVEL,
    ),
}
"""Arguments of each launch file, by its name without ``.launch.py``."""

RENAMED = {'model': 'models'}
"""Arguments of version 0.1 by their name of today."""

NodeParameters = Mapping[str, Mapping[str, Any]]
"""Parameters by the name of the node."""


class LaunchValues:
    """Values by argument; what is not given has its default.

    Parameters
    ----------
    name : str
        Name of the launch file, without ``.launch.py``.
    given : mapping of str to str

    Raises
    ------
    TactileError
        When an argument is not known or is not one of its choices.
    """

    def __init__(self, name: str, given: Mapping[str, str]) -> None:
        arguments = {argument.name: argument for argument in LAUNCH_FILES[name]}
        self._values = {argument.name: argument.default for argument in arguments.values()}
        for key, value in given.items():
            if key in RENAMED:
                raise TactileError(f'the argument {key} is now called {RENAMED[key]}')
            if key not in arguments:
                raise TactileError(f'{name} has no argument {key}, only {", ".join(arguments)}')
            choices = arguments[key].choices
            if choices and value not in choices:
                raise TactileError(f'{key} is "{value}"; it must be one of {", ".join(choices)}')
            self._values[key] = value

    def __getitem__(self, key: str) -> str:
        return self._values[key]

    def path(self, key: str) -> Path | None:
        """Return a value as a path; None when it is empty."""
        return Path(self._values[key]).expanduser() if self._values[key] else None

    def parameters(self, names: Iterable[str], namespace: str) -> NodeParameters:
        """Return what the file ``params_file`` has for some nodes in a namespace."""
        path = self.path('params_file')
        if path is None:
            return {}
        return read_parameters(path, names, namespace, others_allowed=True)


def merge_parameters(*layers: NodeParameters) -> dict[str, dict[str, Any]]:
    """Return the parameters of all layers; of the same parameter, the last layer's."""
    merged: dict[str, dict[str, Any]] = {}
    for layer in layers:
        for node, parameters in layer.items():
            merged.setdefault(node, {}).update(parameters)
    return merged
