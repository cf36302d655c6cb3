# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program behind every node's executable.

A package names its nodes in the entry point group ``tactile.nodes``, and this module's `main`
as the executable of each.
"""

from __future__ import annotations

from importlib.metadata import entry_points
import os
from pathlib import Path
import sys
from typing import Any

from tactile_ros.process import (
    choose_transports,
    hold_signals,
    ignore_signals,
    share_one_heap,
    Signals,
)

GROUP = 'tactile.nodes'


def find_node_class(executable: str) -> Any:
    """Return the class of the node that an executable runs.

    Raises
    ------
    LookupError
        When no installed package has such a node.
    """
    for entry in entry_points(group=GROUP, name=executable):
        return entry.load()
    raise LookupError(f'no installed package has a node {executable}; build the workspace anew')


def prepare_process() -> Signals:
    """Hold the signals of this process and set what must be set before its imports."""
    signals = hold_signals()  # before the imports, which take a second
    os.environ.update(choose_transports(os.environ, 'SUBNET'))
    # Matrices are small, and a thread of OpenBLAS has memory of its own. Before NumPy is loaded.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    return signals


def main() -> int:
    """Run the node that this program's name stands for; return the exit code."""
    signals = prepare_process()
    from tactile_ros.node_group import run_node

    node_class = find_node_class(Path(sys.argv[0]).name)
    if signals.received:
        ignore_signals()
        return 0
    return run_node(node_class)
