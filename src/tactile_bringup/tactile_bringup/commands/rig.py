# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile rig`: all nodes of the rig in one process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_bringup.commands.output import Output
from tactile_bringup.errors import BringupError
from tactile_bringup.graph import RIG_NODES, Ports, recorder_node, rig_graph
from tactile_bringup.graph_runner import ros_context, running_graph
from tactile_bringup.model_folder import find_models
from tactile_bringup.parameter_files import read_parameters
from tactile_ros.node_group import ignore_signals
from tactile_sim.rig_process import SimulatedRig


@dataclass(frozen=True)
class RigRequest:
    """The arguments of `tactile rig`; see its ``--help``."""

    models: Path | None
    guide: str
    tendon: str
    sensor: str
    simulated: bool
    params: Path | None
    namespace: str
    record: Path | None
    seed: int


def run_rig(request: RigRequest) -> None:
    """Run the rig's nodes until SIGINT or SIGTERM.

    Raises
    ------
    BringupError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    try:
        _run_until_signal(request)
    finally:
        ignore_signals()


def _run_until_signal(request: RigRequest) -> None:
    output = Output(as_json=False)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    models = find_models(request.models) if request.models else {}
    parameters: dict[str, dict[str, Any]] = {}
    if request.params:
        names = (*RIG_NODES, *models)
        parameters = read_parameters(request.params, names, request.namespace)
    with ExitStack() as stack:
        ports = _ports(request, stack)
        nodes = rig_graph(ports, models, parameters, simulated=request.simulated)
        if request.record:
            nodes.append(
                recorder_node(
                    request.record,
                    request.models,
                    tuple(models),
                    parameters.get('tactile_features', {}),
                    namespace=request.namespace,
                    simulated=request.simulated,
                )
            )
        context = stack.enter_context(ros_context())
        stack.enter_context(
            running_graph(nodes, context, namespace=request.namespace, on_end=stop.set)
        )
        simulated = 'SIMULATED rig' if request.simulated else 'rig'
        output.say(f'{simulated} running: {", ".join(n.name for n in nodes)}. Ctrl-C ends it.')
        stop.wait()


def _ports(request: RigRequest, stack: ExitStack) -> Ports:
    given = {name: getattr(request, name) for name in ('guide', 'tendon', 'sensor')}
    if request.simulated:
        if any(given.values()):
            raise BringupError('--simulated brings its own ports; leave the others out')
        return stack.enter_context(simulated_ports(request.seed))
    missing = [f'--{name}' for name, port in given.items() if not port]
    if missing:
        raise BringupError(f'name the ports: {", ".join(missing)}; or use --simulated')
    return Ports(**given)


@contextmanager
def simulated_ports(seed: int) -> Iterator[Ports]:
    """Run simulated devices and give their ports."""
    with SimulatedRig(seed=seed) as rig:
        yield Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
