# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which nodes make up the system, and with which parameters.

The graph is described here once; the launch files and the one-process runner
are both made from it, see `tactile_bringup.launch_config.launch_plans`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
import json
import os
from pathlib import Path
from typing import Any

from tactile_bringup.launch_config.model_folder import wanted_features
from tactile_classifier.names import parse_classifier_name
from tactile_classifier.records import ClassifierConfig
from tactile_features.config import FeatureConfig
from tactile_features.slip import SlipConfig
from tactile_ros.errors import TactileError
from tendon_sensor_driver.records import AXES, NORM

FEATURES_NODE = 'tactile_features'
"""Name of the node that computes features."""

SENSING_NODES = ('tendon_sensor', FEATURES_NODE)
"""Names of the nodes of a finger that a hand moves, but for its classifiers."""

SLIP_NODE = 'slip_detector'
"""Name of the node that finds a slip, where one is wanted."""

RIG_NODES = (*SENSING_NODES, 'linear_guide', 'tendon_actuator', 'trial_runner')
"""Names of the nodes of the whole rig, but for its classifiers."""

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
    """What is to be started.

    Attributes
    ----------
    nodes : tuple of NodeDescription
    rigs : tuple of RigDescription
        Simulated rigs; their ports must be there before the nodes start.
    ends_with : str
        Path of the node whose end ends all; empty: none does.
    """

    nodes: tuple[NodeDescription, ...]
    rigs: tuple[RigDescription, ...] = ()
    ends_with: str = ''


def sensing_graph(
    sensor_port: str,
    models: Mapping[str, str],
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    simulated: bool = False,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes that sense with one finger: sensor, features, one classifier a model.

    The feature node is told what the models need, unless the parameters say it.

    Parameters
    ----------
    sensor_port : str
        Serial port of the load cell; empty: that of the parameters; ``none``: there is no
        sensor node, unless the parameters name a sensor with an address or a topic.
    models : mapping of str to str
        Model file by classifier name, see `classifier_name`.
    parameters : mapping
        Further parameters by node name; they win over those given here.
    simulated : bool
        The sensor is simulated: it marks its samples, and nobody else needs to know.

    Raises
    ------
    TactileError
        When a classifier's name does not say its task and contact, or two models need
        different features.
    ModelFileError
        When a file is no model.
    """
    stated = parameters.get(FEATURES_NODE, {})
    wanted = wanted_features(models, stated)
    of_features = {}
    nodes = [NodeDescription('tactile_features', 'tactile_features_node', FEATURES_NODE, wanted)]
    has_port = sensor_port != NO_PORT
    if has_port or parameters.get('tendon_sensor', {}).get('sensor') in PORTLESS_SENSORS:
        told: dict[str, Any] = {'port': sensor_port} if sensor_port and has_port else {}
        if simulated:
            told['simulated'] = True
        sensor = ('tendon_sensor_driver', 'tendon_sensor_node', 'tendon_sensor', told)
        nodes.insert(0, NodeDescription(*sensor))
    for name, model in models.items():
        task, contact = parse_classifier_name(name)
        nodes.append(
            NodeDescription(
                'tactile_classifier',
                'tactile_classifier_node',
                name,
                # What the feature node is told about windows, its classifiers must know.
                {'model': model, 'task': task, 'contact': contact, **of_features},
            )
        )
    return [_placed(node, parameters, namespace) for node in nodes]


def recalibration_parameters(
    trials: str | int, models: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Return the parameters of classifiers that so many known trials of a session correct.

    Raises
    ------
    TactileError
        When ``trials`` is no number.
    """
    try:
        count = int(trials)
    except ValueError:
        raise TactileError(f'recalibrate is "{trials}"; it must be a number of trials') from None
    return {name: {'recalibration_trials': count} for name in models} if count else {}


def sensor_on_topic(text: str, rate_hz: float = 0.0) -> dict[str, Any]:
    """Return the parameters of a sensor for ``TOPIC``, ``TOPIC:AXIS`` or ``TOPIC:JOINT``."""
    topic, _, part = text.partition(':')
    parameters: dict[str, Any] = {'sensor': 'topic', 'topic': topic, 'rate_hz': rate_hz}
    if part:
        parameters['axis' if part in (*AXES, NORM) else 'joint'] = part
    return parameters


def topic_sensor_parameters(
    topic: str, models: Mapping[str, str], stated: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the parameters of a sensor on a topic, at the models' rate; empty without a topic."""
    if not topic:
        return {}
    of_features = stated.get(FEATURES_NODE, {})
    wanted = {**wanted_features(models, of_features), **of_features}
    return sensor_on_topic(topic, float(wanted.get('rate_hz', 0.0)))


def slip_node(
    parameters: Mapping[str, Mapping[str, Any]], *, namespace: str = ''
) -> NodeDescription:
    """Return the node that finds the slip of a held object; of the same sensor as the features."""
    shared = _shared(SlipConfig, parameters.get(FEATURES_NODE, {}))
    node = NodeDescription('tactile_features', 'slip_detector_node', SLIP_NODE, shared)
    return _placed(node, parameters, namespace)


def rig_graph(
    ports: Ports,
    models: Mapping[str, str],
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
    models: Path | None,
    classifiers: tuple[str, ...],
    feature_parameters: Mapping[str, Any],
    *,
    namespaces: Sequence[str] = ('',),
    simulated: bool = False,
    rig: bool = True,
) -> NodeDescription:
    """Return the recorder node for one or more fingers; it notes what a replay needs to know.

    It notes by itself that samples are ``simulated``; a recording from before samples said so
    needs to be told.

    Without a ``rig`` that moves them it waits for the topics of sensing alone.
    ``feature_parameters`` are those that the feature node gets, see `feature_parameters_of`.
    """
    known = {f.name for f in fields(FeatureConfig)}  # every node has further ones
    features = FeatureConfig(**{k: v for k, v in feature_parameters.items() if k in known})
    metadata = {
        'simulated': simulated,
        'feature_config': asdict(features),
        'models': os.path.relpath(models.resolve(), bag.resolve()) if models else '',
    }
    return NodeDescription(
        'tactile_bags',
        'bag_recorder_node',
        'bag_recorder',
        {
            'bag': str(bag),
            'namespaces': tuple(namespaces),
            'metadata': json.dumps(metadata),
            'rig': rig,
            # ROS cannot tell the type of an empty list.
            **({'classifiers': classifiers} if classifiers else {}),
        },
    )


def feature_parameters_of(nodes: Iterable[NodeDescription]) -> Mapping[str, Any]:
    """Return the parameters of the first feature node in a graph."""
    return next(node.parameters for node in nodes if node.name == FEATURES_NODE)


def join_namespaces(*parts: str) -> str:
    """Return one namespace within the other, without slashes around it; empty: the root."""
    return '/'.join(stripped for part in parts if (stripped := part.strip('/')))


def _shared(config: type, of_features: Mapping[str, Any]) -> dict[str, Any]:
    """Return those parameters of the feature node that another node's config has, too."""
    names = {f.name for f in fields(config)} & {f.name for f in fields(FeatureConfig)}
    return {name: value for name, value in of_features.items() if name in names}


def _placed(
    node: NodeDescription, parameters: Mapping[str, Mapping[str, Any]], namespace: str
) -> NodeDescription:
    merged = {**node.parameters, **parameters.get(node.name, {})}
    return replace(node, parameters=merged, namespace=join_namespaces(namespace))
