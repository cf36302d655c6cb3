# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of a finger and of a rig that the commands start in one process.

The launch files list the same nodes explicitly, so that users can copy from them. A test compares
both.
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
from tendon_sensor_driver.config import AXES, NORM

if TYPE_CHECKING:
    from tactile_bags.bag_reader import TactileBag

SENSOR_NODE = 'tendon_sensor'
FEATURES_NODE = 'tactile_features'
CLASSIFIER_NODE = 'tactile_classifier'  # started only if there are models
PLAYER = 'bag_player'

RIG_NODES = (SENSOR_NODE, FEATURES_NODE, 'linear_guide', 'tendon_actuator', 'trial_runner')
"""Names of the nodes of a rig, without the classifier."""
SIMULATED_SATURATION_N = 19.0
"""``saturation_n`` [N] of nodes on a simulated rig, whose load cell measures up to 19.6 N."""

NO_PORT = 'none'
"""Value of the sensor port for a finger without a serial sensor."""

PORTLESS_SENSORS = ('net_ft', 'topic')
"""Kinds of sensor without a serial port."""

NEEDED_BY = {'tactile_bags': ('mcap', 'rosbags'), 'tactile_sim': ()}
"""Optional packages of this project, each with the dependencies that only pip can install."""

DEVICES = Path('/dev/tactile')
"""Folder of the device names that the udev rules of this package create."""


@dataclass(frozen=True)
class NodeDescription:
    """Description of a node of these packages."""

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    namespace: str = ''  # namespace of the finger, without outer slashes; '' is the root

    @property
    def executable(self) -> str:
        """Name of the executable of the node."""
        return f'{self.name}_node'

    @property
    def path(self) -> str:
        """The name with its namespace, such as ``index/tendon_sensor``."""
        return join_namespaces(self.namespace, self.name)


@dataclass(frozen=True)
class Ports:
    """Serial ports of the guide, the tendon actuator and the sensor of a rig."""

    guide: str
    tendon: str
    sensor: str
    sensor_topic: str = ''  # TOPIC, TOPIC:AXIS or TOPIC:JOINT; replaces ``sensor`` if given

    @classmethod
    def in_folder(cls, links: Path) -> Ports:
        """Return the ports of a simulated rig, which has links to its ports in a folder."""
        return cls(*(str(links / name) for name in ('guide', 'tendon', 'sensor')))


@dataclass(frozen=True)
class ModelChoice:
    """The models of a finger, which determine its features and its classifier.

    All class methods raise `TactileError` if a model cannot be used.
    """

    path: Path  # folder of model files, or one file
    contact: str = ''  # only models of this contact are used; '' uses all models

    @classmethod
    def read(cls, path: Path | None, task: str = '', contact: str = '') -> ModelChoice | None:
        """Check the models in a folder or file, and return the choice; None if ``path`` is None.

        If ``task`` is given, at least one model must be for this task. An empty ``contact``
        selects all models.
        """
        if path is None:
            return None
        from tactile_features import read_contracts  # slow to import

        contracts, _ = read_contracts(path, contact)
        found = sorted({each.task for each in contracts})
        if task and task not in found:
            only = f'{", ".join(found)} {contact}'.strip()
            raise TactileError(
                f'{path} has no model for {task} {contact}'.rstrip()
                + f', only for {only}; train one, or give another folder of models'
            )
        return cls(path.resolve(), contact)

    @classmethod
    def of_finger(
        cls, given: str, stated: NodeParameters, task: str = '', contact: str = ''
    ) -> ModelChoice | None:
        """Return the models at a path or, if the path is empty, the models of a parameter file.

        ``given`` is the path, and ``stated`` the contents of the parameter file. Models that the
        file states for the feature node or for the classifier node are used for both nodes. See
        `read` for the other arguments.
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
        """Return the models at ``named``, or the models that were used during a recording.

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
        """Parameters of the nodes that load the models."""
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
    """Return the nodes of one finger: sensor, features and, if there are models, classifier.

    ``parameters`` contains further parameters of the nodes; the other arguments override them. See
    `sensor_parameters` for the arguments of the sensor.
    """
    of_sensor = sensor_parameters(
        parameters, port=sensor_port, topic=sensor_topic, simulated=simulated
    )
    of_models = models.parameters if models else {}
    nodes = [] if of_sensor is None else [NodeDescription(SENSOR_NODE, of_sensor)]
    nodes.append(NodeDescription(FEATURES_NODE, of_models))
    if models:
        nodes.append(NodeDescription(CLASSIFIER_NODE, of_models))
    return [_placed(node, parameters, namespace) for node in nodes]


def sensor_parameters(
    stated: NodeParameters,
    *,
    port: str = '',
    topic: str = '',
    simulated: bool = False,
) -> dict[str, Any] | None:
    """Return the parameters of a sensor node that follow from these arguments.

    Return None if the finger has no sensor node. If the sensor is a topic, its rate is the
    ``rate_hz`` of the sensor node in ``stated`` or, if there is none, of the feature node. If
    neither is stated, the sensor node measures the rate.

    Parameters
    ----------
    stated : NodeParameters
        Other parameters of the finger's nodes; the keys are the names of the nodes.
    port : str
        Serial port of the load cell; by default the port in ``stated``. If the port is ``none``,
        the finger has no sensor node, because another node publishes the strain. However, a sensor
        that does not need a port (`PORTLESS_SENSORS`) is started in any case.
    topic : str
        ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``; by default the topic in ``stated``.
    simulated : bool
        True if the sensor is simulated and must mark its samples.

    Raises
    ------
    TactileError
        If both a port and a topic are given.
    """
    if topic and port:
        raise TactileError('both sensor_port and sensor_topic are given; give only one')
    given: dict[str, Any] = {'simulated': True} if simulated else {}
    if topic:
        name, _, part = topic.partition(':')
        given |= {'sensor': 'topic', 'topic': name}
        if part:
            given['axis' if part in (*AXES, NORM) else 'joint'] = part
    elif port and port != NO_PORT:
        given['port'] = port
    of_file = stated.get(SENSOR_NODE, {})
    if simulated and given.get('port'):
        given['saturation_n'] = of_file.get('saturation_n', SIMULATED_SATURATION_N)
    if not (port or topic) and of_file.get('port') == NO_PORT:
        port = NO_PORT
    kind = {**of_file, **given}.get('sensor', '')
    if port == NO_PORT and kind not in PORTLESS_SENSORS:
        return None
    if kind == 'topic' and 'rate_hz' not in of_file:
        given['rate_hz'] = float(stated.get(FEATURES_NODE, {}).get('rate_hz', 0.0))
    return given


def simulated_tendon_parameters(stated: NodeParameters) -> dict[str, Any]:
    """Return the parameters that the tendon driver needs on a simulated rig.

    If ``stated`` contains ``saturation_n``, this value is used.
    """
    of_file = stated.get('tendon_actuator', {})
    return {'saturation_n': of_file.get('saturation_n', SIMULATED_SATURATION_N)}


def rig_graph(
    ports: Ports,
    models: ModelChoice | None,
    parameters: NodeParameters,
    *,
    simulated: bool,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes of a rig: sensing, motion and trial runner."""
    of_tendon = simulated_tendon_parameters(parameters) if simulated else {}
    motion = [
        NodeDescription('linear_guide', {'port': ports.guide}),
        NodeDescription('tendon_actuator', {'port': ports.tendon, **of_tendon}),
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

    Parameters
    ----------
    bag : Path or str
        Folder of the bag.
    namespaces : sequence of str
        Namespaces of the fingers.
    simulated : bool
        True if the data are simulated. Needed only for old recordings, in which samples are not
        marked.
    rig, classifier : bool
        True if the recorder must wait for the topics of the rig, or of the classifier.

    Raises
    ------
    TactileError
        If the recorder is not installed.
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
    """Return the recorder of the finger in a namespace; see `recorder_parameters`."""
    namespace = join_namespaces(namespace)
    of_recorder = recorder_parameters(bag, namespaces=(namespace,), **parameters)
    return NodeDescription('bag_recorder', of_recorder, namespace)


def require_package(name: str, purpose: str) -> None:
    """Raise `TactileError` if a package in `NEEDED_BY`, or one of its libraries, is missing."""
    libraries = NEEDED_BY[name]
    missing = [module for module in (name, *libraries) if find_spec(module) is None]
    if missing:
        pip = f', and run: pip install {" ".join(libraries)}' if libraries else ''
        raise TactileError(
            f'{purpose} needs {" and ".join(missing)}, which '
            f'{"is" if len(missing) == 1 else "are"} not installed: build {name} in this '
            f'workspace{pip}'
        )


def choose_fingers(bag: TactileBag, wanted: str) -> tuple[str, ...]:
    """Return the namespaces of the fingers in a recording, or only ``wanted`` if given."""
    found, wanted = bag.namespaces, wanted.strip('/')
    if wanted and wanted not in found:
        raise TactileError(
            f'{bag.path} has no finger {wanted}, only {", ".join(found) or "the root"}'
        )
    return (wanted,) if wanted else found


def player_parameters(bag: Path, rate: float, namespace: str = '') -> dict[str, Any]:
    """Return the parameters of the bag player; ``rate`` is the speed relative to the recording."""
    chosen = {'namespace': namespace.strip('/')} if namespace else {}
    # The player must wait for the other processes, which start at the same time.
    waits = {'subscriber_timeout_s': 60.0, 'start_delay_s': 3.0}
    return {'bag': str(bag), 'rate': rate, **waits, **chosen}


def join_namespaces(*parts: str) -> str:
    """Join namespaces; return the result without outer slashes, '' for the root."""
    return '/'.join(stripped for part in parts if (stripped := part.strip('/')))


def _placed(node: NodeDescription, parameters: NodeParameters, namespace: str) -> NodeDescription:
    merged = {**parameters.get(node.name, {}), **node.parameters}
    return replace(node, parameters=merged, namespace=join_namespaces(namespace))
