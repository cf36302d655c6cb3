# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of a finger and of a rig as the commands start them, in one process.

The launch files name the same nodes for themselves, so that a reader can copy from them; a test
compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from tactile_bringup.launch_config.parameter_files import NodeParameters
from tactile_ros.errors import TactileError
from tendon_sensor_driver.records import AXES, NORM

if TYPE_CHECKING:
    from tactile_bags.bag_reader import TactileBag

SENSOR_NODE = 'tendon_sensor'
FEATURES_NODE = 'tactile_features'
CLASSIFIER_NODE = 'tactile_classifier'  # where there are models
PLAYER = 'bag_player'

RIG_NODES = (SENSOR_NODE, FEATURES_NODE, 'linear_guide', 'tendon_actuator', 'trial_runner')
"""Names of the nodes of the whole rig, but for its classifier."""

NO_PORT = 'none'
"""Sensor port of a finger that has no serial sensor."""

PORTLESS_SENSORS = ('net_ft', 'topic')
"""Kinds of sensor that have no serial port."""

NEEDED_BY = {'tactile_bags': ('mcap', 'rosbags'), 'tactile_sim': ()}
"""Packages that only some launches need, with the libraries that pip installs for them."""

DEVICES = Path('/dev/tactile')
"""Where the udev rules of this package put the names of the devices."""


@dataclass(frozen=True)
class NodeDescription:
    """A node of ours: its name, its parameters, and the namespace of its finger.

    The namespace has no slashes around it; empty: the root.
    """

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    namespace: str = ''

    @property
    def executable(self) -> str:
        """Name of the program that runs it."""
        return f'{self.name}_node'

    @property
    def path(self) -> str:
        """The name with its namespace, such as ``index/tendon_sensor``."""
        return join_namespaces(self.namespace, self.name)


@dataclass(frozen=True)
class Ports:
    """Serial ports of the three devices, or the topic that the force comes from.

    ``sensor_topic`` is ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``; ``sensor`` is then not used.
    """

    guide: str
    tendon: str
    sensor: str
    sensor_topic: str = ''

    @classmethod
    def in_folder(cls, links: Path) -> Ports:
        """Return the ports of a simulated rig whose links are in this folder."""
        return cls(*(str(links / name) for name in ('guide', 'tendon', 'sensor')))


@dataclass(frozen=True)
class ModelChoice:
    """The models of a finger, which say what its features and its classifier node do.

    Each way to make one raises `TactileError` when a model cannot be used.
    """

    path: Path  # folder of model files, or one file
    contact: str = ''  # models of another contact are passed over; empty: none is

    @classmethod
    def read(cls, path: Path | None, task: str = '', contact: str = '') -> ModelChoice | None:
        """Return the models for a task and a contact (empty: for any); None without a path."""
        if path is None:
            return None
        from tactile_features import read_contracts  # slow to import

        contracts, _ = read_contracts(path, contact)
        found = sorted({each.task for each in contracts})
        if task and task not in found:
            only = f'{", ".join(found)} {contact}'.strip()
            raise TactileError(
                f'{path} has no model for {task} {contact}'.rstrip() + f', only for {only}'
            )
        return cls(path.resolve(), contact)

    @classmethod
    def of_finger(
        cls, given: str, stated: NodeParameters, task: str = '', contact: str = ''
    ) -> ModelChoice | None:
        """Return the models of a finger: those at a path, or those that a parameter file states.

        In the file, models of the feature node or of the classifier are those of both. The other
        arguments are those of `read`.
        """
        of_classifier, of_features = stated.get(CLASSIFIER_NODE, {}), stated.get(FEATURES_NODE, {})
        place = given or of_classifier.get('models', '') or of_features.get('models', '')
        return cls.read(
            Path(place).expanduser() if place else None,
            task,
            contact or of_classifier.get('contact', '') or of_features.get('contact', ''),
        )

    @classmethod
    def of_recording(
        cls, bag: TactileBag, namespace: str, named: Path | None, scratch: Path
    ) -> ModelChoice | None:
        """Return the models that are named, or those that a finger was recorded with, as then.

        ``scratch`` is a folder for links to the models.
        """
        from tactile_bags.recorded_setup import find_models, gather_models, recorded_models

        if named is not None:
            return cls.read(named)
        infos = recorded_models(bag, namespace)
        return cls.read(
            gather_models(find_models(bag, namespace), scratch),
            contact=infos[0].contact_filter if infos else '',
        )

    @property
    def parameters(self) -> dict[str, str]:
        """Parameters of the nodes that read the models."""
        contact = {'contact': self.contact} if self.contact else {}
        return {'models': str(self.path), **contact}


def sensing_graph(
    sensor_port: str,
    models: ModelChoice | None,
    parameters: NodeParameters,
    *,
    sensor_topic: str = '',
    simulated: bool = False,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes that sense with one finger: sensor, features and, with models, classifier.

    The first arguments win over further ``parameters`` by node name; see `sensor_parameters`.
    """
    of_sensor = sensor_parameters(
        parameters, port=sensor_port, topic=sensor_topic, simulated=simulated
    )
    told = models.parameters if models else {}
    nodes = [] if of_sensor is None else [NodeDescription(SENSOR_NODE, of_sensor)]
    nodes.append(NodeDescription(FEATURES_NODE, told))
    if models:
        nodes.append(NodeDescription(CLASSIFIER_NODE, told))
    return [_placed(node, parameters, namespace) for node in nodes]


def sensor_parameters(
    stated: NodeParameters,
    *,
    port: str = '',
    topic: str = '',
    simulated: bool = False,
) -> dict[str, Any] | None:
    """Return what arguments set of a sensor node; None: there is no such node.

    ``stated`` has the other parameters of the finger's nodes, by name. The rate of a
    sensor on a topic is the one that is stated for it or for the feature node; without any, the
    sensor measures its rate. A simulated sensor marks its samples. Raises `TactileError` when
    there are a port and a topic.

    Parameters
    ----------
    port : str
        Serial port of the load cell; empty: that of the parameters; ``none``, also there: another
        node publishes the strain, unless the parameters name a sensor with an address or a topic.
    topic : str
        ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``; empty: that of the parameters.
    """
    if topic and port:
        raise TactileError('there are a sensor_port and a sensor_topic; give one')
    given: dict[str, Any] = {'simulated': True} if simulated else {}
    if topic:
        name, _, part = topic.partition(':')
        given |= {'sensor': 'topic', 'topic': name}
        if part:
            given['axis' if part in (*AXES, NORM) else 'joint'] = part
    elif port and port != NO_PORT:
        given['port'] = port
    of_file = stated.get(SENSOR_NODE, {})
    if not (port or topic) and of_file.get('port') == NO_PORT:
        port = NO_PORT
    kind = {**of_file, **given}.get('sensor', '')
    if port == NO_PORT and kind not in PORTLESS_SENSORS:
        return None
    if kind == 'topic' and 'rate_hz' not in of_file:
        given['rate_hz'] = float(stated.get(FEATURES_NODE, {}).get('rate_hz', 0.0))
    return given


def rig_graph(
    ports: Ports,
    models: ModelChoice | None,
    parameters: NodeParameters,
    *,
    simulated: bool,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes of the whole palpation rig: sensing, motion, trial runner."""
    motion = [
        NodeDescription('linear_guide', {'port': ports.guide}),
        NodeDescription('tendon_actuator', {'port': ports.tendon}),
        NodeDescription('trial_runner'),
    ]
    sensing = sensing_graph(
        '' if ports.sensor_topic else ports.sensor,
        models,
        parameters,
        sensor_topic=ports.sensor_topic,
        simulated=simulated,
        namespace=namespace,
    )
    return [*sensing, *(_placed(node, parameters, namespace) for node in motion)]


def recorder_parameters(
    bag: Path | str,
    *,
    namespaces: Sequence[str] = ('',),
    simulated: bool = False,
    rig: bool = True,
    classifier: bool = False,
) -> dict[str, Any]:
    """Return the parameters of a recorder of one or more fingers.

    It notes by itself that samples are ``simulated``; a recording from before samples said so
    needs to be told. It does not wait for the topics of a ``rig`` or ``classifier`` that is not
    there. Raises `TactileError` where no recorder is installed.
    """
    require_package('tactile_bags', 'a recording')
    return {
        'bag': str(bag),
        'namespaces': tuple(namespaces),
        'metadata': json.dumps({'simulated': simulated}),
        'rig': rig,
        'classifier': classifier,
    }


def recorder_node(bag: Path, namespace: str = '', **parameters: Any) -> NodeDescription:
    """Return the recorder of the finger in a namespace, with `recorder_parameters`."""
    place = join_namespaces(namespace)
    told = recorder_parameters(bag, namespaces=(place,), **parameters)
    return NodeDescription('bag_recorder', told, place)


def require_package(name: str, purpose: str) -> None:
    """Raise `TactileError` when one of `NEEDED_BY`, or a library of it, is not installed."""
    libraries = NEEDED_BY[name]
    missing = ', '.join(module for module in (name, *libraries) if find_spec(module) is None)
    if missing:
        pip = f', and run: pip install {" ".join(libraries)}' if libraries else ''
        raise TactileError(
            f'{purpose} needs {missing}, not installed here: build {name} in this workspace{pip}'
        )


def choose_fingers(bag: TactileBag, wanted: str) -> tuple[str, ...]:
    """Return the namespaces of a recording's fingers, or the wanted one alone if it is there."""
    found, wanted = bag.namespaces, wanted.strip('/')
    if wanted and wanted not in found:
        raise TactileError(
            f'{bag.path} holds no finger {wanted}, only {", ".join(found) or "the root"}'
        )
    return (wanted,) if wanted else found


def player_parameters(bag: Path, rate: float, namespace: str = '') -> dict[str, Any]:
    """Return the parameters of the player of a recording; ``rate`` is how much faster it is."""
    chosen = {'namespace': namespace.strip('/')} if namespace else {}
    # The processes start with it, and not all as fast.
    waits = {'subscriber_timeout_s': 60.0, 'start_delay_s': 3.0}
    return {'bag': str(bag), 'rate': rate, **waits, **chosen}


def join_namespaces(*parts: str) -> str:
    """Return one namespace within the other, without slashes around it; empty: the root."""
    return '/'.join(stripped for part in parts if (stripped := part.strip('/')))


def _placed(node: NodeDescription, parameters: NodeParameters, namespace: str) -> NodeDescription:
    merged = {**parameters.get(node.name, {}), **node.parameters}
    return replace(node, parameters=merged, namespace=join_namespaces(namespace))
