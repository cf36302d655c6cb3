# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``finger_node``: the nodes of one finger, or of a whole hand, in one process.

``finger_node /index/tendon_sensor /index/tactile_features /index/tactile_classifier --ros-args
--params-file hand.yaml`` runs these nodes with the parameters that the file has for each. Each
argument is a node's name, with its namespace before it. The stages of a finger call each other,
see `finger`. A node that cannot be started, as without its device, is tried again and again, and
the others run. The process ends with 1 when a node's parameters cannot be, or when one fails, so
that ``launch`` starts the whole of it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
import sys
import threading
import time
from typing import Any

from tactile_bringup.launch_config.graph import NodeDescription
from tactile_ros.errors import TactileError
from tactile_ros.programs.node_program import prepare_process

PACKAGES = {
    'tendon_sensor': 'tendon_sensor_driver',
    'tactile_features': 'tactile_features',
    'slip_detector': 'tactile_features',
    'tactile_classifier': 'tactile_classifier',
    'bag_recorder': 'tactile_bags',
}
"""Nodes that can share the process, and their packages."""


POLL_S = 1.0
"""Period of the check for nodes that are finished, as a recorder is that has failed [s]."""

RETRY_S = 5.0
"""Between two attempts to start a node [s]."""


def main() -> int:
    """Run the nodes until all are finished, one fails, SIGINT or SIGTERM; return the exit code."""
    signals = prepare_process()
    from rclpy.logging import get_logger
    from rclpy.utilities import remove_ros_args

    from tactile_bringup.nodes.graph_runner import ros_context, running_graph
    from tactile_ros.programs.node_group import end_process, outliving

    logger, ended = get_logger('finger_node'), threading.Event()

    def end() -> None:
        ended.set()
        signals.wake()

    try:
        nodes = [describe(path) for path in remove_ros_args(sys.argv)[1:]]
        if not nodes:
            raise TactileError(f'name nodes, as /tendon_sensor; there are {", ".join(PACKAGES)}')
        with (
            ros_context(args=sys.argv) as context,
            ExitStack() as after,
            running_graph(nodes, context, on_end=end, signals=signals, needs_all=False) as running,
        ):
            after.enter_context(outliving(*running.values()))
            starting = None if signals.received else Starting(running, logger)
            while starting is not None and not (
                signals.wait(POLL_S)
                or ended.is_set()
                or all(node.is_finished for node in running.values())
            ):
                starting.go_on()
    except TactileError as error:
        logger.fatal(str(error))
        return 1
    finally:
        end_process()
    return 0


class Starting:
    """The nodes that could not be started yet, and what the log says of it.

    A node that was active once is left to whoever stops it.

    Parameters
    ----------
    nodes : mapping of str to TactileNode
        By name; each is spun by its executor.
    logger
    """

    def __init__(self, nodes: Mapping[str, Any], logger: Any) -> None:
        self._logger, self._running = logger, ', '.join(nodes)
        self._late = {
            name: node
            for name, node in nodes.items()
            if node.get_parameter('autostart').value and not node.is_active
        }
        self._due_s = time.monotonic() + RETRY_S
        self._tell()

    def go_on(self) -> None:
        """Try those again that are not active, when it is time; on their executors."""
        if not self._late:
            return
        active = [name for name, node in self._late.items() if node.is_active]
        for name in active:
            del self._late[name]
        if active:
            self._tell()
        elif time.monotonic() > self._due_s:
            self._due_s = time.monotonic() + RETRY_S
            for node in self._late.values():
                node.executor.create_task(node.bring_up)

    def _tell(self) -> None:
        if self._late:
            self._logger.warning(
                f'not running yet: {", ".join(self._late)}; see above. Tried again every '
                f'{RETRY_S:g} s'
            )
        else:
            self._logger.info(f'running: {self._running}')


def describe(path: str) -> NodeDescription:
    """Return the node of a name such as ``/index/tendon_sensor``.

    Raises
    ------
    TactileError
        When it is none of `PACKAGES`.
    """
    namespace, _, name = path.strip('/').rpartition('/')
    if name not in PACKAGES:
        raise TactileError(f'there is no node {name} for a finger, only {", ".join(PACKAGES)}')
    return NodeDescription(PACKAGES[name], f'{name}_node', name, namespace=namespace)
