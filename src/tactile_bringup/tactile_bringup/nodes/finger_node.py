# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs the nodes of fingers in one process, in which each node calls the next one directly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
import sys
import threading
import time
from typing import Any

from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    FEATURES_NODE,
    NodeDescription,
    SENSOR_NODE,
)
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_ros.errors import TactileError
from tactile_ros.node_program import prepare_process
from tactile_ros.rclpy_internals import run_on_executor
from tactile_ros.stages import StageNode
from tendon_sensor_driver.tendon_sensor_node import TendonSensorNode


def connect_fingers(nodes: Iterable[Any]) -> None:
    """Connect the stages of each finger, so that they call each other directly.

    Must be called before the nodes are configured. Nodes in one namespace belong to one finger.
    Nodes that do not process samples, features or classifications are ignored. If a finger has no
    sensor node, its samples come from the topic of a node in another process.
    """
    fingers: dict[str, dict[type, Any]] = {}
    for node in nodes:
        if isinstance(node, StageNode):
            fingers.setdefault(node.get_namespace(), {})[type(node)] = node
    for finger in fingers.values():
        _connect(
            finger.get(TendonSensorNode),
            finger.get(TactileFeaturesNode),
            finger.get(TactileClassifierNode),
        )


def sources_last(nodes: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return names and nodes in the order of start: sensors last, so that no sample is missed."""
    return sorted(nodes.items(), key=lambda item: isinstance(item[1], TendonSensorNode))


def _connect(
    sensor: TendonSensorNode | None,
    features: TactileFeaturesNode | None,
    classifier: TactileClassifierNode | None,
) -> None:
    lock = threading.RLock()
    for node in (features, classifier):
        if node is not None:
            node.lock = lock
    if features is not None and classifier is not None:
        classifier.is_fed_by_calls = True
        features.emit = classifier.add_window
    if sensor is not None and features is not None:
        features.is_fed_by_calls = True
        sensor.emit = features.add_block


NODES = (SENSOR_NODE, FEATURES_NODE, CLASSIFIER_NODE, 'bag_recorder')
"""Names of the nodes that can share a process."""

POLL_S = 1.0
"""Period of the check for finished nodes, such as a recorder that has failed [s]."""

RETRY_S = 5.0
"""Time between two attempts to start a node [s]."""


def main() -> int:
    """Run the nodes until all finish, one fails, or a signal arrives; return the exit code."""
    signals = prepare_process()
    from rclpy.logging import get_logger
    from rclpy.utilities import remove_ros_args

    from tactile_bringup.nodes.graph_runner import ros_context, running_graph
    from tactile_ros.node_group import end_process, outliving

    logger, ended = get_logger('finger_node'), threading.Event()

    def end() -> None:
        ended.set()
        signals.wake()

    try:
        nodes = [describe(path) for path in remove_ros_args(sys.argv)[1:]]
        if not nodes:
            raise TactileError(
                f'no nodes are named; give names such as /tendon_sensor, out of {", ".join(NODES)}'
            )
        with (
            ros_context(args=sys.argv) as context,
            ExitStack() as after,
            running_graph(nodes, context, on_end=end, signals=signals, needs_all=False) as running,
        ):
            after.enter_context(outliving(*running.values()))
            pending = None if signals.received else PendingNodes(running, logger)
            while pending is not None and not (
                signals.wait(POLL_S)
                or ended.is_set()
                or all(node.is_finished for node in running.values())
            ):
                pending.retry()
    except TactileError as error:
        logger.fatal(str(error))
        return 1
    finally:
        end_process()
    return 0


class PendingNodes:
    """Nodes that could not be started yet, such as a sensor that is not plugged in.

    Each attempt and success is logged. A node that was active once is not started again, because
    a user may have stopped it.

    Parameters
    ----------
    nodes : mapping of str to node
        Nodes, each spun by an executor; the keys are the names of the nodes.
    logger
        Logger of the process.
    """

    def __init__(self, nodes: Mapping[str, Any], logger: Any) -> None:
        self._logger, self._running = logger, ', '.join(nodes)
        self._late = {
            name: node
            for name, node in nodes.items()
            if node.get_parameter('autostart').value and not node.is_active
        }
        self._due_s = time.monotonic() + RETRY_S
        self._log()

    def retry(self) -> None:
        """Try to start the pending nodes on their executors, every `RETRY_S`."""
        if not self._late:
            return
        active = [name for name, node in self._late.items() if node.is_active]
        for name in active:
            del self._late[name]
        if active:
            self._log()
        elif time.monotonic() > self._due_s:
            self._due_s = time.monotonic() + RETRY_S
            for node in self._late.values():
                with suppress(RuntimeError):  # the process is ending
                    run_on_executor(node, node.bring_up)

    def _log(self) -> None:
        if self._late:
            self._logger.warning(
                f'not running yet: {", ".join(self._late)}; see the messages above. Retrying '
                f'every {RETRY_S:g} s'
            )
        else:
            self._logger.info(f'running: {self._running}')


def describe(path: str) -> NodeDescription:
    """Return the description of a node such as ``/index/tendon_sensor``."""
    namespace, _, name = path.strip('/').rpartition('/')
    if name not in NODES:
        raise TactileError(f'a finger has no node {name}; its nodes are {", ".join(NODES)}')
    return NodeDescription(name, namespace=namespace)
