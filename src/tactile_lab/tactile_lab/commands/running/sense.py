# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile sense` and `tactile hand`: the nodes of fingers that something else moves."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
import tempfile

from tactile_bringup.launch_config.launch_plans import plan_launch
from tactile_lab.commands.running.rig import run_nodes
from tactile_ros.programs.signals import hold_signals
from tactile_sim.rig_process import SimulatedRig


def run_sensing(name: str, values: Mapping[str, str], *, watch: bool, quiet: bool) -> None:
    """Run in this process what the launch file of this name starts, until a signal comes.

    Parameters
    ----------
    name : str
        ``sense`` or ``hand``.
    values : mapping of str to str
        Arguments of the launch file; empty ones count as left out.
    watch, quiet : bool
        See `run_nodes`.

    Raises
    ------
    TactileError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    if hold_signals().received:
        return
    given = {key: value for key, value in values.items() if value}
    with ExitStack() as stack:
        scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix='tactile_'))
        plan = plan_launch(name, given, Path(scratch))
        for rig in plan.rigs:
            stack.enter_context(SimulatedRig(rig.seed, rig.links))
        simulated = given['rig'] == 'simulated'
        run_nodes(plan.nodes, '', 'sensor nodes', watch=watch, quiet=quiet, simulated=simulated)
