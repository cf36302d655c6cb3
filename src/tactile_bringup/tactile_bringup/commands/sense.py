# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile sense` and `tactile hand`: the nodes of fingers that something else moves."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from tactile_bringup.commands.rig import run_nodes, signalled
from tactile_bringup.launch_plans import plan_launch
from tactile_sim.rig_process import SimulatedRig


def run_sensing(name: str, values: Mapping[str, str]) -> None:
    """Run in this process what the launch file of this name starts, until a signal comes.

    Parameters
    ----------
    name : str
        ``sense`` or ``hand``.
    values : mapping of str to str
        Arguments of the launch file; empty ones count as left out.

    Raises
    ------
    BringupError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    given = {key: value for key, value in values.items() if value}
    with ExitStack() as stack:
        stop = stack.enter_context(signalled())
        scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix='tactile_'))
        plan = plan_launch(name, given, Path(scratch))
        for rig in plan.rigs:
            stack.enter_context(SimulatedRig(rig.seed, rig.links))
        title = 'SIMULATED sensing' if given.get('rig') == 'simulated' else 'sensing'
        run_nodes(plan.nodes, stop, '', title)
