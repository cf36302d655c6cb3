# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig of a command: ports, parameters, and nodes in this process."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
import threading
import time
from typing import Any, TYPE_CHECKING

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    NodeDescription,
    Ports,
    RIG_NODES,
)
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_bringup.trial_protocols import PROTOCOLS, TrialRequest
from tactile_lab.output import Output
from tactile_lab.watch.access import WatchOptions
from tactile_ros.errors import TactileError
from tactile_ros.process import hold_signals
from tactile_sim.descriptions.catalogue import list_objects
from tactile_sim.rig_process import SimulatedRig

if TYPE_CHECKING:
    from tactile_lab.options import RigOptions
    from tactile_lab.watch.watching import Watch


def open_ports(
    given: RigOptions, seed: int, stack: ExitStack
) -> tuple[Ports, SimulatedRig | None]:
    """Return the ports of the rig, and the simulated rig or None.

    If ``--simulated`` is given, the simulated rig is started.

    Parameters
    ----------
    given : RigOptions
        Options of the command.
    seed : int
        Seed of the simulated rig.
    stack : ExitStack
        The simulated rig ends when this stack is closed.

    Raises
    ------
    TactileError
        When ports are missing, two sensors are given, or ports are given with ``--simulated``.
    """
    refuse_two_sensors(given)
    named = {'--guide': given.guide, '--tendon': given.tendon, '--sensor': given.sensor}
    if given.simulated:
        if any(named.values()):
            raise TactileError('--simulated uses its own ports; omit the other ports')
        rig = stack.enter_context(SimulatedRig(seed=seed))
        return Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor, given.sensor_topic), rig
    if given.sensor_topic:
        del named['--sensor']
    if missing := [option for option, port in named.items() if not port]:
        raise TactileError(f'give the ports: {", ".join(missing)}; or use --simulated')
    return Ports(given.guide, given.tendon, given.sensor, given.sensor_topic), None


def refuse_two_sensors(given: RigOptions) -> None:
    """Raise `TactileError` if both the port and the topic of a sensor are given."""
    if given.sensor and given.sensor_topic:
        raise TactileError('--sensor and --sensor-topic are both given; omit one of them')


def read_rig_parameters(path: Path | None, namespace: str) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node of the rig from a ROS parameter file.

    If ``path`` is None, there are no parameters.
    """
    file = ParameterFile(path)
    file.refuse_others([namespace])
    return {name: file.of(name, namespace) for name in (*RIG_NODES, CLASSIFIER_NODE)}


def run_nodes(
    nodes: Sequence[NodeDescription],
    title: str,
    *,
    watch: bool,
    quiet: bool,
    simulated_rig: SimulatedRig | None = None,
    simulated: bool = False,
) -> None:
    """Run nodes in this process until a signal arrives, or until one of them fails.

    Parameters
    ----------
    watch : bool
        Serve a live page.
    quiet : bool
        Do not print a line for each prediction.
    simulated_rig : SimulatedRig or None
        The simulated rig, which mounts the object of each trial that is started on the live page.
    simulated : bool
        True if only the sensors are simulated.
    """
    from tactile_bringup.nodes.graph_runner import ros_context, running_graph  # imports rclpy
    from tactile_lab.watch.watching import watching

    signals, ended, output = hold_signals(), threading.Event(), Output(as_json=False)
    simulated = simulated or simulated_rig is not None
    title = f'SIMULATED {title}' if simulated else title

    def end() -> None:
        ended.set()
        signals.wake()

    def mount(request: TrialRequest) -> None:
        if simulated_rig is not None and request.object_label:
            simulated_rig.mount(request.protocol, request.object_label, request.contact)

    with ExitStack() as stack:
        context = stack.enter_context(ros_context())
        if watch or not quiet:
            objects = {name: list(list_objects(name)) for name in PROTOCOLS}
            watched = stack.enter_context(
                watching(
                    context,
                    WatchOptions() if watch else None,
                    simulated=simulated,
                    objects=objects if simulated_rig else {},
                    before_trial=mount,
                    answers_only=not watch,
                )
            )
            if not quiet:
                watched.state.on_answer = lambda line: output.say(
                    f'{time.strftime("%H:%M:%S")}  {line}'
                )
            say_address(watched, output)
        stack.enter_context(running_graph(nodes, context, on_end=end, signals=signals))
        if not signals.received:
            names = ', '.join(node.path for node in nodes)
            output.say(f'{title} running: {names}. Ctrl-C ends it.')
        while not (signals.wait() or ended.is_set()):
            pass


def say_address(watch: Watch, output: Output) -> None:
    """Print the address of the live page, if one is served."""
    if watch.address:
        output.say(f'Live page: {watch.address}')
