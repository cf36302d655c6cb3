# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program behind the executables of all nodes.

A package lists its node classes in the entry point group ``tactile.nodes``, and uses `main` of
this module as the console script of each node.
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
        If no installed package has this node.
    """
    for entry in entry_points(group=GROUP, name=executable):
        return entry.load()
    raise LookupError(f'no installed package has a node {executable}; build the workspace again')


def prepare_process() -> Signals:
    """Hold the signals of this process, and make the settings that must precede its imports."""
    signals = hold_signals()  # before the imports, which take a second
    os.environ.update(choose_transports(os.environ, 'SUBNET'))
    # Before NumPy is imported: each thread of OpenBLAS needs memory, and our matrices are small.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    return signals


def main() -> int:
    """Run the node that belongs to this program's name; return the exit code."""
    signals = prepare_process()
    from tactile_ros.node_group import run_node

    node_class = find_node_class(Path(sys.argv[0]).name)
    if signals.received:
        ignore_signals()
        return 0
    return run_node(node_class)
