# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fingers of a hand: their names, their nodes, and ports that no two of them share."""

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
from tactile_features.records import PHASES_STATED
from tactile_ros.errors import TactileError

_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


def find_fingers(text: str, file: ParameterFile, namespace: str = '') -> tuple[str, ...]:
    """Return the names of the fingers of a hand in a namespace.

    ``text`` has commas between them; empty: all that the file describes. It describes a finger by
    blocks for nodes in a namespace of its name, or describes none. Raises `TactileError` when
    there are no names, one cannot be used, or the names and the file do not fit.
    """
    described = file.fingers(namespace)
    names = parse_finger_names(text) or described
    if not names:
        raise TactileError(
            'name the fingers, such as index,middle, or describe them in a parameter file, each '
            'by a block for nodes in a namespace of its name'
        )
    if described:
        if missing := [name for name in names if name not in described]:
            raise TactileError(
                f'{file.path} describes {", ".join(described)}, but not {", ".join(missing)}; add '
                f'a block for {missing[0]}/tendon_sensor, or leave the finger out'
            )
        if others := [name for name in described if name not in names]:
            raise TactileError(
                f'{file.path} describes {", ".join(others)}, which the fingers '
                f'{", ".join(names)} leave out; name all of them, or remove the blocks'
            )
    return names


def parse_finger_names(text: str) -> tuple[str, ...]:
    """Return the names in a list such as ``index,middle``.

    Raises `TactileError` when one is no name for a namespace, or is there twice.
    """
    names = tuple(name.strip() for name in text.split(',') if name.strip())
    for name in names:
        if not _NAME.fullmatch(name):
            raise TactileError(
                f'"{name}" is no name for a finger: letters, digits and _ only, and no digit first'
            )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise TactileError(f'the finger {", ".join(twice)} is named twice')
    return names


def place_fingers(
    fingers: Sequence[str], file: ParameterFile, namespace: str, sensor_port: str
) -> list[str]:
    """Return the namespaces of fingers that the file and a sensor port (empty: none) fit.

    Raises `TactileError` when the file has parameters for others, or fingers would share the port.
    """
    places = [join_namespaces(namespace, finger) for finger in fingers]
    file.refuse_others(places)
    if sensor_port and len(fingers) > 1:
        raise TactileError(
            'a sensor port is for one finger; give each its port in a parameter file, in a block '
            f'for {fingers[0]}/{SENSOR_NODE}'
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
    """Return the nodes of a hand as the commands start them, in one process.

    A finger with an empty name is the only one, in the hand's own ``namespace``. See
    `sensor_parameters` for ``sensor_port`` (of a single finger) and ``sensor_topic``, and
    `ModelChoice.of_finger` for ``models`` and ``contact``.

    Parameters
    ----------
    simulate : callable, optional
        The sensors are simulated. Called with the name of each finger that is given no port and
        no topic; returns the port of its simulated sensor.
    phases : str
        Empty: as the file says.
    record : Path, optional
        Folder of the bags, one a finger.

    Raises
    ------
    TactileError
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
    """Raise `TactileError` where two nodes have the same serial port."""
    owners: dict[str, str] = {}
    for node in nodes:
        port = node.parameters.get('port')
        if not port or node.parameters.get('sensor') in PORTLESS_SENSORS:
            continue
        if port in owners:
            raise TactileError(
                f'{owners[port]} and {node.path} have the same port {port}: a port has one user'
            )
        owners[port] = node.path
