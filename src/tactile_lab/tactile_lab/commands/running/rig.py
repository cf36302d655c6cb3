# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile rig`: all nodes of the rig in one process."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
import threading
from typing import Any

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    ModelChoice,
    NodeDescription,
    Ports,
    recorder_node,
    rig_graph,
    RIG_NODES,
)
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_bringup.records import PROTOCOLS
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.commands.output import Output
from tactile_lab.commands.rig_requests import PortArguments, RigRequest
from tactile_lab.commands.running.watch import answer_line, say_address
from tactile_lab.watch.options import WatchOptions
from tactile_ros.errors import TactileError
from tactile_ros.programs.signals import hold_signals
from tactile_sim.descriptions.catalogue import list_objects
from tactile_sim.rig_process import SimulatedRig


def run_rig(request: RigRequest) -> None:
    """Run the rig's nodes until SIGINT or SIGTERM.

    Raises
    ------
    TactileError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    if hold_signals().received:
        return
    parameters = read_rig_parameters(request.params, request.namespace)
    models = ModelChoice.of_finger(
        str(request.models or ''), parameters, recalibrate=request.recalibrate
    )
    simulated = request.ports.simulated
    with ExitStack() as stack:
        ports, simulated_rig = open_ports(request.ports, request.seed, stack)
        nodes = rig_graph(ports, models, parameters, simulated=simulated)
        if request.record:
            finger = request.namespace.strip('/')
            nodes.append(
                recorder_node(request.record, namespaces=(finger,), classifier=models is not None)
            )
        run_nodes(
            nodes,
            request.namespace,
            'rig',
            watch=request.watch,
            quiet=request.quiet,
            simulated_rig=simulated_rig,
        )


def run_nodes(
    nodes: Sequence[NodeDescription],
    namespace: str,
    title: str,
    *,
    watch: bool,
    quiet: bool,
    simulated_rig: SimulatedRig | None = None,
    simulated: bool = False,
) -> None:
    """Run nodes in this process until SIGINT or SIGTERM, or until one of them fails.

    Parameters
    ----------
    nodes : sequence of NodeDescription
    namespace, title : str
    watch : bool
        Serve a live page.
    quiet : bool
        Print no line for each answer.
    simulated_rig : SimulatedRig, optional
        It gets what a trial of the live page names under its finger.
    simulated : bool
        Some sensor is simulated.

    Raises
    ------
    TactileError
        When a node cannot be started, or one fails later.
    """
    from tactile_bringup.nodes.graph_runner import ros_context, running_graph  # rclpy
    from tactile_lab.watch.watching import watching

    signals, ended, output = hold_signals(), threading.Event(), Output(as_json=False)
    simulated = simulated or simulated_rig is not None
    title = f'SIMULATED {title}' if simulated else title

    def end() -> None:
        ended.set()
        signals.wake()

    with ExitStack() as stack:
        context = stack.enter_context(ros_context())
        if watch or not quiet:
            watched = stack.enter_context(
                watching(
                    context,
                    WatchOptions() if watch else None,
                    simulated=simulated,
                    objects=simulated_objects() if simulated_rig else {},
                    before_trial=lambda request: mount(simulated_rig, request),
                    answers_only=not watch,
                )
            )
            if not quiet:
                watched.state.on_answer = lambda line: output.say(answer_line(line))
            say_address(watched, output)
        stack.enter_context(
            running_graph(nodes, context, namespace=namespace, on_end=end, signals=signals)
        )
        if not signals.received:
            names = ', '.join(node.path for node in nodes)
            output.say(f'{title} running: {names}. Ctrl-C ends it.')
        while not (signals.wait() or ended.is_set()):
            pass


def mount(simulated_rig: SimulatedRig | None, request: TrialRequest) -> None:
    """Put what a trial names under the finger of a simulated rig."""
    if simulated_rig is not None and request.object_label:
        simulated_rig.mount(request.protocol, request.object_label, request.contact)


def simulated_objects() -> dict[str, list[str]]:
    """Return what can lie under the simulated finger, by protocol."""
    return {protocol: list(list_objects(protocol)) for protocol in PROTOCOLS}


def read_rig_parameters(path: Path | None, namespace: str) -> dict[str, dict[str, Any]]:
    """Return the parameters of the rig's nodes from a ROS parameter file, if one is given."""
    file = ParameterFile(path)
    file.refuse_others([namespace])
    return {name: file.of(name, namespace) for name in (*RIG_NODES, CLASSIFIER_NODE)}


def open_ports(
    arguments: PortArguments, seed: int, stack: ExitStack
) -> tuple[Ports, SimulatedRig | None]:
    """Return the ports, and the simulated rig behind them if it is one.

    Parameters
    ----------
    arguments : PortArguments
    seed : int
        Of a simulated rig.
    stack : contextlib.ExitStack
        Ends the simulated rig.

    Raises
    ------
    TactileError
        When ports are missing, or given beside ``--simulated``.
    """
    given = {name: getattr(arguments, name) for name in ('guide', 'tendon', 'sensor')}
    topic = arguments.sensor_topic
    if arguments.simulated:
        if any(given.values()):
            raise TactileError('--simulated brings its own ports; leave the others out')
        rig = stack.enter_context(SimulatedRig(seed=seed))
        return Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor, topic), rig
    missing = [f'--{name}' for name, port in given.items() if not port]
    if topic:
        missing.remove('--sensor')
    if missing:
        raise TactileError(f'name the ports: {", ".join(missing)}; or use --simulated')
    return Ports(**given, sensor_topic=topic), None
