# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node graph of the system: nodes, namespaces and parameters.

The launch files and the one-process runner share this description; see
`tactile_bringup.launch_config.launch_plans`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import json
from pathlib import Path
from typing import Any

from tactile_ros.errors import TactileError
from tendon_sensor_driver.records import AXES, NORM

FEATURES_NODE = 'tactile_features'
"""Name of the node that computes features."""

CLASSIFIER_NODE = 'tactile_classifier'
"""Name of the node that answers with every model of a finger, where there are models."""

SENSING_NODES = ('tendon_sensor', FEATURES_NODE)
"""Names of the nodes of a finger that a hand moves, but for its classifier."""

SLIP_NODE = 'slip_detector'
"""Name of the node that finds a slip, where one is wanted."""

RIG_NODES = (*SENSING_NODES, 'linear_guide', 'tendon_actuator', 'trial_runner')
"""Names of the nodes of the whole rig, but for its classifier."""

PLAYER = 'bag_player'
"""Name of the node that plays a recording."""

NO_PORT = 'none'
"""Sensor port of a finger that has no serial sensor."""

PORTLESS_SENSORS = ('net_ft', 'topic')
"""Kinds of sensor that have no serial port."""

STRAIN_TIMEOUT_S = 0.15
"""Nine samples at 60 Hz; with it an approach at 50 mm/s, too, ends within 0.3 s."""


@dataclass(frozen=True)
class NodeDescription:
    """One node: what to start, under which name, with which parameters.

    Attributes
    ----------
    namespace : str
        That of the node's finger, without slashes around it; empty: the root.
    """

    package: str
    executable: str
    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    namespace: str = ''

    @property
    def path(self) -> str:
        """The name with its namespace, such as ``index/tendon_sensor``."""
        return join_namespaces(self.namespace, self.name)


@dataclass(frozen=True)
class Ports:
    """Serial ports of the three devices, or the topic that the force comes from.

    Attributes
    ----------
    sensor_topic : str
        ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``; ``sensor`` is then not used. Empty: none.
    """

    guide: str
    tendon: str
    sensor: str
    sensor_topic: str = ''


@dataclass(frozen=True)
class RigDescription:
    """A simulated rig to start before the nodes.

    Attributes
    ----------
    links : Path
        Folder for its ports: guide, tendon and sensor.
    mount : tuple of str
        Protocol, object and contact of what lies under the finger; empty: nothing.
    """

    links: Path
    seed: int
    mount: tuple[str, ...] = ()

    @property
    def ports(self) -> Ports:
        """The ports that it will serve."""
        return Ports(*(str(self.links / name) for name in ('guide', 'tendon', 'sensor')))


@dataclass(frozen=True)
class LaunchPlan:
    """Nodes and simulated rigs that a launch starts.

    Attributes
    ----------
    nodes : tuple of NodeDescription
    rigs : tuple of RigDescription
        Simulated rigs; their ports must exist before the nodes start.
    ends_with : str
        Path of the node whose end shuts the launch down; empty: no node does.
    """

    nodes: tuple[NodeDescription, ...]
    rigs: tuple[RigDescription, ...] = ()
    ends_with: str = ''


@dataclass(frozen=True)
class ModelChoice:
    """The models of a finger, which say what its features and its classifier node do.

    Attributes
    ----------
    path : Path
        Folder of model files, or one file.
    contact : str
        Models of another contact are passed over; empty: none is.
    recalibration_trials : int
        Known trials of a session that correct the models; 0: none.
    rate_hz : float
        Sample rate that they were trained at [Hz]; 0: they differ.
    """

    path: Path
    contact: str = ''
    recalibration_trials: int = 0
    rate_hz: float = 0.0

    @classmethod
    def read(
        cls, path: Path | None, task: str = '', contact: str = '', recalibrate: str | int = 0
    ) -> ModelChoice | None:
        """Return the models for a task and a contact (empty: for any); None without a path.

        Raises
        ------
        TactileError
            When no file there can be used for these, or ``recalibrate`` is no number.
        """
        try:
            trials = int(recalibrate)
        except ValueError:
            raise TactileError(
                f'recalibrate is "{recalibrate}"; it must be a number of trials'
            ) from None
        if path is None:
            return None
        from tactile_features import read_contracts  # slow to import
        from tactile_features.spec import shared_rate_hz

        contracts, _ = read_contracts(path, contact)
        found = sorted({each.task for each in contracts})
        if task and task not in found:
            only = f'{", ".join(found)} {contact}'.strip()
            raise TactileError(
                f'{path} has no model for {task} {contact}'.rstrip() + f', only for {only}'
            )
        rate_hz = shared_rate_hz(each.wanted.spec for each in contracts)
        return cls(path.resolve(), contact, trials, rate_hz)

    @property
    def parameters(self) -> dict[str, str]:
        """Parameters of the nodes that read the models."""
        contact = {'contact': self.contact} if self.contact else {}
        return {'models': str(self.path), **contact}


def sensing_graph(
    sensor_port: str,
    models: ModelChoice | None,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    simulated: bool = False,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes that sense with one finger: sensor, features and, with models, classifier.

    Parameters
    ----------
    sensor_port : str
        Serial port of the load cell; empty: that of the parameters; ``none``: there is no
        sensor node, unless the parameters name a sensor with an address or a topic.
    models : ModelChoice or None
    parameters : mapping
        Further parameters by node name; they win over those given here.
    simulated : bool
        The sensor is simulated: it marks its samples, and nobody else needs to know.
    """
    told = models.parameters if models else {}
    nodes = [NodeDescription('tactile_features', 'tactile_features_node', FEATURES_NODE, told)]
    has_port = sensor_port != NO_PORT
    if has_port or parameters.get('tendon_sensor', {}).get('sensor') in PORTLESS_SENSORS:
        of_sensor: dict[str, Any] = {'port': sensor_port} if sensor_port and has_port else {}
        if simulated:
            of_sensor['simulated'] = True
        sensor = ('tendon_sensor_driver', 'tendon_sensor_node', 'tendon_sensor', of_sensor)
        nodes.insert(0, NodeDescription(*sensor))
    if models:
        trials = models.recalibration_trials
        recalibration = {'recalibration_trials': trials} if trials else {}
        classifier = ('tactile_classifier', 'tactile_classifier_node', CLASSIFIER_NODE)
        nodes.append(NodeDescription(*classifier, {**told, **recalibration}))
    return [_placed(node, parameters, namespace) for node in nodes]


def sensor_on_topic(text: str, rate_hz: float = 0.0) -> dict[str, Any]:
    """Return the parameters of a sensor for ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``."""
    topic, _, part = text.partition(':')
    parameters: dict[str, Any] = {'sensor': 'topic', 'topic': topic, 'rate_hz': rate_hz}
    if part:
        parameters['axis' if part in (*AXES, NORM) else 'joint'] = part
    return parameters


def topic_sensor_parameters(
    topic: str, models: ModelChoice | None, stated: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the parameters of a sensor on a topic; empty without a topic.

    Its rate is that of the models, without models that of the feature node. Where neither says
    one, the sensor measures it.
    """
    if not topic:
        return {}
    of_features = stated.get(FEATURES_NODE, {}).get('rate_hz', 0.0)
    return sensor_on_topic(topic, models.rate_hz if models else float(of_features))


def slip_node(
    parameters: Mapping[str, Mapping[str, Any]], *, namespace: str = ''
) -> NodeDescription:
    """Return the node that finds the slip of a held object."""
    node = NodeDescription('tactile_features', 'slip_detector_node', SLIP_NODE)
    return _placed(node, parameters, namespace)


def rig_graph(
    ports: Ports,
    models: ModelChoice | None,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    simulated: bool,
    watched: bool = False,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes of the whole palpation rig: sensing, motion, trial runner.

    Parameters
    ----------
    watched : bool
        Motion ends when one of the other nodes falls silent: for nodes in processes of their
        own, which can die alone.
    """
    sensor_port = ports.sensor
    if ports.sensor_topic:
        sensor = topic_sensor_parameters(ports.sensor_topic, models, parameters)
        name = SENSING_NODES[0]
        parameters = {**parameters, name: {**sensor, **parameters.get(name, {})}}
        sensor_port = NO_PORT
    guide_needs: dict[str, Any] = {}
    tendon_needs: dict[str, Any] = {}
    if watched:
        guide_needs = {
            'strain_timeout_s': STRAIN_TIMEOUT_S,
            'heartbeat_topics': ('trial_runner/heartbeat', 'tendon_actuator/heartbeat'),
        }
        tendon_needs = {'heartbeat_topics': ('trial_runner/heartbeat', 'linear_guide/heartbeat')}
    motion = [
        NodeDescription(
            'linear_guide_driver',
            'linear_guide_node',
            'linear_guide',
            {'port': ports.guide, **guide_needs},
        ),
        NodeDescription(
            'linear_guide_driver',
            'tendon_actuator_node',
            'tendon_actuator',
            {'port': ports.tendon, **tendon_needs},
        ),
        NodeDescription('tactile_bringup', 'trial_runner_node', 'trial_runner', {}),
    ]
    return [
        *sensing_graph(sensor_port, models, parameters, simulated=simulated, namespace=namespace),
        *(_placed(node, parameters, namespace) for node in motion),
    ]


def recorder_node(
    bag: Path,
    *,
    namespaces: Sequence[str] = ('',),
    simulated: bool = False,
    rig: bool = True,
    classifier: bool = False,
) -> NodeDescription:
    """Return the recorder node for one or more fingers.

    It notes by itself that samples are ``simulated``; a recording from before samples said so
    needs to be told.

    It does not wait for the topics of a ``rig`` or of a ``classifier`` that is not there.
    """
    parameters = {
        'bag': str(bag),
        'namespaces': tuple(namespaces),
        'metadata': json.dumps({'simulated': simulated}),
        'rig': rig,
        'classifier': classifier,
    }
    return NodeDescription('tactile_bags', 'bag_recorder_node', 'bag_recorder', parameters)


def join_namespaces(*parts: str) -> str:
    """Return one namespace within the other, without slashes around it; empty: the root."""
    return '/'.join(stripped for part in parts if (stripped := part.strip('/')))


def _placed(
    node: NodeDescription, parameters: Mapping[str, Mapping[str, Any]], namespace: str
) -> NodeDescription:
    merged = {**node.parameters, **parameters.get(node.name, {})}
    return replace(node, parameters=merged, namespace=join_namespaces(namespace))
