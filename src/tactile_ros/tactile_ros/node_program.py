# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program that the executables of all nodes run.

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
    """Handle signals, and make settings that have an effect only before slow imports."""
    signals = hold_signals()  # as early as possible, because the next imports take a second
    os.environ.update(choose_transports(os.environ, 'SUBNET'))
    # OpenBLAS reads this when NumPy is imported. Each of its threads needs memory, and the
    # matrices of the nodes are too small to benefit from threads.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    return signals


def main() -> int:
    """Run the node that has the name of this executable; return the exit code."""
    signals = prepare_process()
    from tactile_ros.node_group import run_node

    node_class = find_node_class(Path(sys.argv[0]).name)
    if signals.received:
        ignore_signals()
        return 0
    return run_node(node_class)
