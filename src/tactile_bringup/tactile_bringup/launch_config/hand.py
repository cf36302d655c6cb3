# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fingers of a hand: their names, their nodes, and a check for shared ports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
import re

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    DEVICES,
    FEATURES_NODE,
    join_namespaces,
    ModelChoice,
    NodeDescription,
    PORTLESS_SENSORS,
    recorder_node,
    sensing_graph,
    SENSOR_NODE,
)
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_features.types import PHASES_STATED
from tactile_ros.errors import TactileError

_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


def find_fingers(text: str, file: ParameterFile, namespace: str = '') -> tuple[str, ...]:
    """Return the names of the fingers of a hand in a namespace.

    Parameters
    ----------
    text : str
        Comma-separated names. If it is empty, all fingers in the file are used.
    file : ParameterFile
        Parameter file. A block for a node in a namespace, such as ``index/tendon_sensor``,
        describes the finger that has the name of the namespace.
    namespace : str
        Namespace of the hand.

    Raises
    ------
    TactileError
        If there are no names, a name is invalid, or the names do not match the file.
    """
    described = file.fingers(namespace)
    names = parse_finger_names(text) or described
    if not names:
        raise TactileError(
            'there are no fingers; name the fingers, such as index,middle, or describe each '
            'finger in a parameter file, with a block such as index/tendon_sensor'
        )
    if described:
        if missing := [name for name in names if name not in described]:
            raise TactileError(
                f'{file.path} describes {", ".join(described)}, but not {", ".join(missing)}; add '
                f'a block for {missing[0]}/tendon_sensor, or leave the finger out'
            )
        if others := [name for name in described if name not in names]:
            raise TactileError(
                f'{file.path} describes {", ".join(others)}, but the fingers are '
                f'{", ".join(names)}; name all fingers, or remove the blocks'
            )
    return names


def parse_finger_names(text: str) -> tuple[str, ...]:
    """Return the names in a list such as ``index,middle``.

    Raises
    ------
    TactileError
        If a name is not valid as a namespace, or is repeated.
    """
    names = tuple(name.strip() for name in text.split(',') if name.strip())
    for name in names:
        if not _NAME.fullmatch(name):
            raise TactileError(
                f'"{name}" is not a valid name of a finger: use only letters, digits and _, and '
                'do not start with a digit'
            )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise TactileError(f'the finger {", ".join(twice)} is named twice; name it once')
    return names


def place_fingers(
    fingers: Sequence[str], file: ParameterFile, namespace: str, sensor_port: str
) -> list[str]:
    """Return the namespaces of the fingers.

    Raises
    ------
    TactileError
        If the file has parameters for other namespaces, or several fingers would share
        ``sensor_port``.
    """
    places = [join_namespaces(namespace, finger) for finger in fingers]
    file.refuse_others(places)
    if sensor_port and len(fingers) > 1:
        raise TactileError(
            'a sensor port belongs to one finger; give each finger its port in a parameter file, '
            f'in a block for {fingers[0]}/{SENSOR_NODE}'
        )
    return places


def hand_graph(
    fingers: Sequence[str],
    file: ParameterFile,
    *,
    sensor_port: str = '',
    sensor_topic: str = '',
    simulate: Callable[[str], str] | None = None,
    models: str = '',
    phases: str = '',
    contact: str = '',
    record: Path | None = None,
    namespace: str = '',
) -> list[NodeDescription]:
    """Return the nodes of a hand that the commands start in one process.

    Parameters
    ----------
    fingers : sequence of str
        Names of the fingers. An empty name means a single finger in the hand's ``namespace``.
    file : ParameterFile
        Parameters of the nodes.
    sensor_port, sensor_topic : str
        Sensor of a single finger; see `sensor_parameters`.
    simulate : callable, optional
        If given, the sensors are simulated. It is called with the name of each finger that has
        neither port nor topic, and returns the port of the simulated sensor.
    models, contact : str
        See `ModelChoice.of_finger`.
    phases : str
        Value of the parameter ``phases``; by default the value in the file.
    record : Path, optional
        Folder for the bags. Each finger is recorded into a bag of its own.
    namespace : str
        Namespace of the hand.

    Raises
    ------
    TactileError
        If the parameters are inconsistent.
    """
    places = place_fingers(fingers, file, namespace, sensor_port)
    nodes: list[NodeDescription] = []
    for finger, place in zip(fingers, places, strict=True):
        stated = {
            name: file.of(name, place) for name in (SENSOR_NODE, FEATURES_NODE, CLASSIFIER_NODE)
        }
        found = phases or stated[FEATURES_NODE].get('phases', PHASES_STATED)
        choice = ModelChoice.of_finger(
            models, stated, '' if found == PHASES_STATED else found, contact
        )
        port = sensor_port
        is_stated = {'port', 'sensor'} & stated[SENSOR_NODE].keys()
        if simulate is not None and not (port or sensor_topic or is_stated):
            port = simulate(finger)
        default_port = str(DEVICES / (finger or 'sensor'))
        stated[SENSOR_NODE] = {'port': default_port, **stated[SENSOR_NODE]}
        if found != PHASES_STATED:
            stated[FEATURES_NODE] |= {'phases': found}
            stated[FEATURES_NODE] |= {'detected_contact': contact} if contact else {}
        nodes += sensing_graph(
            port,
            choice,
            stated,
            sensor_topic=sensor_topic,
            simulated=simulate is not None,
            namespace=place,
        )
        if record is not None:
            has = {'rig': False, 'classifier': choice is not None}
            nodes.append(recorder_node(record / finger, place, **has))
    refuse_shared_ports(nodes)
    return nodes


def refuse_shared_ports(nodes: Iterable[NodeDescription]) -> None:
    """Raise `TactileError` if two nodes have the same serial port."""
    owners: dict[str, str] = {}
    for node in nodes:
        port = node.parameters.get('port')
        if not port or node.parameters.get('sensor') in PORTLESS_SENSORS:
            continue
        if port in owners:
            raise TactileError(
                f'{owners[port]} and {node.path} have the same port {port}; give each its own port'
            )
        owners[port] = node.path
