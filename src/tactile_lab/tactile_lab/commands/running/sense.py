# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile sense` and `tactile hand`: the nodes of fingers that something else moves."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
import tempfile
from typing import Any

from tactile_bringup.launch_config.hand import find_fingers, hand_graph
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_lab.commands.running.rig import run_nodes
from tactile_ros.programs.signals import hold_signals
from tactile_sim.rig_process import SimulatedRig


def run_sensing(
    fingers: str | None,
    params: Path | None,
    *,
    simulated: bool,
    watch: bool,
    quiet: bool,
    namespace: str,
    **options: Any,
) -> None:
    """Run the nodes of fingers in this process until a signal comes.

    Parameters
    ----------
    fingers : str or None
        Names with commas between them; None: a single finger, without a name.
    params : Path or None
        ROS parameter file.
    simulated : bool
        Start a simulated sensor for each finger without a port.
    watch, quiet : bool
        See `run_nodes`.
    namespace, options
        See `hand_graph`.

    Raises
    ------
    TactileError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    if hold_signals().received:
        return
    file = ParameterFile(params)
    names = ('',) if fingers is None else find_fingers(fingers, file, namespace)
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='tactile_')))

        def simulate(number: int, finger: str) -> str:
            links = scratch / f'rig_{finger or "finger"}'
            return str(stack.enter_context(SimulatedRig(number + 1, links)).ports.sensor)

        nodes = hand_graph(
            names,
            file,
            simulate=simulate if simulated else None,
            namespace=namespace,
            **options,
        )
        run_nodes(nodes, '', 'sensor nodes', watch=watch, quiet=quiet, simulated=simulated)
