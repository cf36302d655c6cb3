# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""`tactile rig`: all nodes of the rig in one process."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
import threading
from typing import Any

from tactile_bringup.wiring.graph import (
    feature_parameters_of,
    NodeDescription,
    Ports,
    recalibration_parameters,
    recorder_node,
    rig_graph,
    RIG_NODES,
)
from tactile_bringup.wiring.model_folder import find_models
from tactile_bringup.wiring.parameter_files import read_parameters
from tactile_lab.commands.output import Output
from tactile_ros.errors import TactileError
from tactile_ros.programs.signals import hold_signals
from tactile_sim.rig_process import SimulatedRig


@dataclass(frozen=True)
class PortArguments:
    """Where the three devices are: three ports, or simulated ones with a seed."""

    guide: str
    tendon: str
    sensor: str
    simulated: bool
    seed: int


@dataclass(frozen=True)
class RigRequest:
    """The arguments of `tactile rig`; see its ``--help``."""

    models: Path | None
    ports: PortArguments
    params: Path | None
    namespace: str
    record: Path | None
    recalibrate: int = 0


def run_rig(request: RigRequest) -> None:
    """Run the rig's nodes until SIGINT or SIGTERM.

    Raises
    ------
    TactileError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    if hold_signals().received:
        return
    models = find_models(request.models) if request.models else {}
    parameters = read_rig_parameters(request.params, request.models, request.namespace)
    for name, known in recalibration_parameters(request.recalibrate, models).items():
        parameters[name] = {**known, **parameters.get(name, {})}
    simulated = request.ports.simulated
    with ExitStack() as stack:
        ports, _ = open_ports(request.ports, stack)
        nodes = rig_graph(ports, models, parameters, simulated=simulated)
        if request.record:
            nodes.append(
                recorder_node(
                    request.record,
                    request.models,
                    tuple(models),
                    feature_parameters_of(nodes),
                    namespaces=(request.namespace.strip('/'),),
                    simulated=simulated,
                )
            )
        run_nodes(nodes, request.namespace, 'SIMULATED rig' if simulated else 'rig')


def run_nodes(nodes: Sequence[NodeDescription], namespace: str, title: str) -> None:
    """Run nodes in this process until SIGINT or SIGTERM, or until one of them fails.

    Raises
    ------
    TactileError
        When a node cannot be started, or one fails later.
    """
    from tactile_bringup.nodes.graph_runner import ros_context, running_graph  # rclpy

    signals, ended = hold_signals(), threading.Event()

    def end() -> None:
        ended.set()
        signals.wake()

    with (
        ros_context() as context,
        running_graph(nodes, context, namespace=namespace, on_end=end, signals=signals),
    ):
        if not signals.received:
            names = ', '.join(node.path for node in nodes)
            Output(as_json=False).say(f'{title} running: {names}. Ctrl-C ends it.')
        while not (signals.wait() or ended.is_set()):
            pass


def read_rig_parameters(
    path: Path | None, models: Path | None, namespace: str
) -> dict[str, dict[str, Any]]:
    """Return the parameters of the rig's nodes from a ROS parameter file, if one is given."""
    if path is None:
        return {}
    classifiers = find_models(models) if models else {}
    return read_parameters(path, (*RIG_NODES, *classifiers), namespace)


def open_ports(arguments: PortArguments, stack: ExitStack) -> tuple[Ports, SimulatedRig | None]:
    """Return the ports, and the simulated rig behind them if it is one.

    Parameters
    ----------
    arguments : PortArguments
    stack : contextlib.ExitStack
        Ends the simulated rig.

    Raises
    ------
    TactileError
        When ports are missing, or given beside ``--simulated``.
    """
    given = {name: getattr(arguments, name) for name in ('guide', 'tendon', 'sensor')}
    if arguments.simulated:
        if any(given.values()):
            raise TactileError('--simulated brings its own ports; leave the others out')
        rig = stack.enter_context(SimulatedRig(seed=arguments.seed))
        return Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor), rig
    missing = [f'--{name}' for name, port in given.items() if not port]
    if missing:
        raise TactileError(f'name the ports: {", ".join(missing)}; or use --simulated')
    return Ports(**given), None
