# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch plans: the nodes and rigs of each launch file, from the values of its arguments.

This module does not use the launch system. `launching` turns a plan into launch actions. The
commands `tactile sense` and `tactile hand` run a plan in one process.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import dataclasses
from pathlib import Path
from typing import Any

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    FEATURES_NODE,
    join_namespaces,
    LaunchPlan,
    ModelChoice,
    NO_PORT,
    NodeDescription,
    PLAYER,
    PORTLESS_SENSORS,
    Ports,
    recorder_node,
    rig_graph,
    RIG_NODES,
    RigDescription,
    sensing_graph,
    SENSING_NODES,
    SLIP_NODE,
    slip_node,
    topic_sensor_parameters,
)
from tactile_bringup.launch_config.hand_file import Finger, parse_finger_names, read_hand
from tactile_bringup.launch_config.launch_arguments import (
    LaunchValues,
    merge_parameters,
    PHASES,
)
from tactile_bringup.records import PROTOCOLS
from tactile_features.records import PHASES_STATED
from tactile_ros.errors import TactileError

DEVICES = Path('/dev/tactile')
"""Where the udev rules of this package put the names of the devices."""


def plan_launch(name: str, given: Mapping[str, str], scratch: Path) -> LaunchPlan:
    """Return what a launch file starts.

    Parameters
    ----------
    name : str
        Name of the launch file, without ``.launch.py``.
    given : mapping of str to str
        Values of its arguments; what is left out has its default.
    scratch : Path
        Folder for the ports of simulated rigs, and for links to the models of a recording.

    Raises
    ------
    TactileError
        When an argument is not known or does not fit, or a file that one names is not there.
    """
    values = LaunchValues(name, given)
    if name in PROTOCOLS:
        plan = _plan_protocol(name, values, scratch)
    elif name == 'replay':
        plan = _plan_replay(values, scratch)
    else:
        plan = _plan_fingers(_described_fingers(name, values), values, scratch)
    if values['use_sim_time'] == 'true':
        timed = [
            dataclasses.replace(node, parameters={'use_sim_time': True, **node.parameters})
            if node.name != PLAYER  # it makes that time
            else node
            for node in plan.nodes
        ]
        plan = dataclasses.replace(plan, nodes=tuple(timed))
    return plan


def _plan_protocol(protocol: str, values: LaunchValues, scratch: Path) -> LaunchPlan:
    simulated = values['rig'] == 'simulated'
    given = {name: values[f'{name}_port'] for name in ('guide', 'tendon', 'sensor')}
    if values['sensor_topic']:
        if given['sensor']:
            raise TactileError('there are a sensor_port and a sensor_topic; give one')
        given['sensor'] = NO_PORT
    for name in ('guide', 'tendon'):
        if given[name] == NO_PORT:
            raise TactileError(
                f'{name}_port is none, but a trial moves the {name}; where another node moves the '
                'finger, use sense.launch.py'
            )
    rigs = []
    if simulated and not any(port for port in given.values() if port != NO_PORT):
        mount = (protocol, values['object'], values['contact'])
        rigs.append(RigDescription(scratch / 'rig', 1, mount))
        ports = rigs[0].ports
        if given['sensor']:
            ports = dataclasses.replace(ports, sensor=NO_PORT)
    elif simulated and not all(given.values()):
        missing = [f'{name}_port' for name, port in given.items() if not port]
        raise TactileError(
            f'name all ports of a simulated rig that runs already, also {", ".join(missing)}; '
            'or none, and one is started'
        )
    else:
        ports = Ports(**{name: port or str(DEVICES / name) for name, port in given.items()})
    ports = dataclasses.replace(ports, sensor_topic=values['sensor_topic'])
    models = ModelChoice.read(
        values.path('models'), protocol, values['contact'], values['recalibrate']
    )
    namespace = values['namespace']
    parameters = values.parameters((*RIG_NODES, CLASSIFIER_NODE), namespace)
    nodes = rig_graph(
        ports, models, parameters, simulated=simulated, watched=True, namespace=namespace
    )
    if values['record']:
        nodes.append(_recorder(Path(values['record']), models, namespace, rig=True))
    return LaunchPlan(tuple(nodes), tuple(rigs))


def _described_fingers(name: str, values: LaunchValues) -> tuple[Finger, ...]:
    if name == 'sense':
        topic = values['sensor_topic']
        return (Finger('', sensor_port=values['sensor_port'], sensor_topic=topic),)
    names = parse_finger_names(values['fingers'])
    path = values.path('hand_file')
    if path:
        return read_hand(path, names)
    if not names:
        raise TactileError('name the fingers, as fingers:=index,middle, or a hand_file')
    return tuple(Finger(name) for name in names)


def _plan_fingers(fingers: Sequence[Finger], values: LaunchValues, scratch: Path) -> LaunchPlan:
    simulated = values['rig'] == 'simulated'
    nodes: list[NodeDescription] = []
    rigs: list[RigDescription] = []
    for index, finger in enumerate(fingers):
        if not (finger.sensor_port or finger.sensor_topic):
            finger = dataclasses.replace(finger, sensor_topic=values['sensor_topic'])
        if finger.sensor_topic and finger.sensor_port:
            raise TactileError(
                f'{finger.name or "the finger"} has a sensor_port and a sensor_topic; give one'
            )
        port = NO_PORT if finger.sensor_topic else finger.sensor_port
        if simulated and not port:
            rigs.append(RigDescription(scratch / f'rig_{finger.name or "finger"}', index + 1))
            port = rigs[-1].ports.sensor
        nodes += _finger_nodes(
            finger, port or str(DEVICES / (finger.name or 'sensor')), values, simulated=simulated
        )
    _refuse_shared_ports(nodes)
    return LaunchPlan(tuple(nodes), tuple(rigs))


def _finger_nodes(
    finger: Finger, port: str, values: LaunchValues, *, simulated: bool
) -> list[NodeDescription]:
    namespace = join_namespaces(values['namespace'], finger.name)
    phases = finger.phases or values['phases']
    if phases not in PHASES.choices:
        raise TactileError(
            f'phases of the finger {finger.name} is "{phases}"; it must be one of '
            + ', '.join(PHASES.choices)
        )
    models = ModelChoice.read(
        finger.models or values.path('models'),
        '' if phases == PHASES_STATED else phases,
        values['contact'],
        values['recalibrate'],
    )
    slips = values['slip'] == 'true' if finger.slip is None else finger.slip
    names = (
        *SENSING_NODES,
        *([SLIP_NODE] if slips else []),
        *([CLASSIFIER_NODE] if models else []),
    )
    unknown = [node for node in finger.parameters if node not in names]
    if unknown:
        raise TactileError(
            f'the finger {finger.name} has parameters for {", ".join(unknown)}; its nodes are '
            f'{", ".join(names)}'
        )
    # What only this finger's description says wins over the file for all of them.
    stated = merge_parameters(values.parameters(names, namespace), finger.parameters)
    parameters = merge_parameters(
        {
            FEATURES_NODE: _found_phases(phases, values['contact']),
            SENSING_NODES[0]: topic_sensor_parameters(finger.sensor_topic, models, stated),
        },
        stated,
    )
    nodes = sensing_graph(port, models, parameters, simulated=simulated, namespace=namespace)
    if slips:
        nodes.append(slip_node(parameters, namespace=namespace))
    if values['record']:
        bag = Path(values['record'], finger.name)  # the sense launch file has one, without name
        nodes.append(_recorder(bag, models, namespace, rig=False))
    return nodes


def _found_phases(phases: str, contact: str) -> dict[str, Any]:
    if phases == PHASES_STATED:
        return {}
    return {'phases': phases, 'detected_contact': contact}


def _refuse_shared_ports(nodes: Iterable[NodeDescription]) -> None:
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


def _recorder(
    bag: Path, models: ModelChoice | None, namespace: str, *, rig: bool
) -> NodeDescription:
    finger = namespace.strip('/')
    node = recorder_node(bag, namespaces=(finger,), rig=rig, classifier=models is not None)
    return dataclasses.replace(node, namespace=finger)


def _plan_replay(values: LaunchValues, scratch: Path) -> LaunchPlan:
    """Return the nodes that classify a recording, and the player that ends them."""
    # libraries for files, which a process that senses need not load
    from tactile_bags.bag_reader import TactileBag
    from tactile_bags.recorded_setup import find_models, gather_models, recorded_features

    path = values.path('bag')
    if path is None:
        raise TactileError('name the recording to play, as bag:=FOLDER')
    try:
        rate = float(values['rate'])
    except ValueError:
        raise TactileError(f'rate is "{values["rate"]}"; it must be a number') from None
    wanted = values['namespace'].strip('/')
    named = values.path('models')
    nodes: list[NodeDescription] = []
    with TactileBag(path) as bag:
        found, simulated = bag.namespaces, bool(bag.metadata.get('simulated'))
        if wanted and wanted not in found:
            raise TactileError(
                f'{path} holds no finger {wanted}, only {", ".join(found) or "the root"}'
            )
        namespaces = (wanted,) if wanted else found
        for namespace in namespaces:
            place = named or gather_models(find_models(bag, namespace), scratch)
            models = ModelChoice.read(place)
            parameters = merge_parameters(
                {FEATURES_NODE: dataclasses.asdict(recorded_features(bag, namespace).config)},
                values.parameters((*SENSING_NODES, CLASSIFIER_NODE), namespace),
            )
            graph = sensing_graph('', models, parameters, namespace=namespace)
            nodes += [node for node in graph if node.name != SENSING_NODES[0]]
    if values['record']:
        nodes.append(
            recorder_node(
                Path(values['record']),
                namespaces=namespaces,
                simulated=simulated,
                rig=False,
                classifier=any(node.name == CLASSIFIER_NODE for node in nodes),
            )
        )
    chosen = {'namespace': wanted} if wanted else {}
    player = NodeDescription(
        'tactile_bags',
        'bag_player_node',
        PLAYER,
        {
            'bag': str(path),
            'rate': rate,
            # The processes start with it, and not all as fast.
            'subscriber_timeout_s': 60.0,
            'start_delay_s': 3.0,
            **chosen,
        },
    )
    return LaunchPlan((*nodes, player), ends_with=player.path)
