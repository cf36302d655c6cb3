# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs nodes from their descriptions in this process, without ``launch``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from tactile_bringup.launch_config.graph import NodeDescription
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.node_program import find_node_class
from tactile_ros.process import ignoring_terminal_stops, keep_heap_small, Signals


def create_node(description: NodeDescription, context: Context, *, quiet: bool = False) -> Any:
    """Create a node from its description, without configuring it.

    If ``quiet`` is True, the node logs only warnings and errors.

    Raises
    ------
    TactileError
        If a parameter is unknown, out of range or of the wrong type.
    """
    node_class = find_node_class(description.executable)
    overrides = [
        Parameter(key, value=list(value) if isinstance(value, tuple) else value)
        for key, value in description.parameters.items()
        if value != ()  # the default; ROS cannot determine the type of an empty list
    ]
    try:
        node = node_class(
            node_name=description.name,
            namespace=description.namespace,
            context=context,
            parameter_overrides=overrides,
        )
    except ParameterException as error:
        raise TactileError(f'the node {description.name} cannot be created: {error}') from error
    unknown = [name for name in description.parameters if not node.has_parameter(name)]
    if unknown:
        node.take_down()
        raise TactileError(f'the node {description.name} has no parameter {", ".join(unknown)}')
    if quiet:
        node.get_logger().set_level(LoggingSeverity.WARN)
    return node


@contextmanager
def ros_context(
    domain_id: int | None = None, args: Sequence[str] | None = None
) -> Iterator[Context]:
    """Yield a separate ROS context, which is not shut down by signals.

    ``args`` is a command line; by default the command line of this process.
    """
    keep_heap_small()
    context = Context()
    rclpy.init(
        args=None if args is None else list(args),
        context=context,
        domain_id=domain_id,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)


@contextmanager
def running_graph(
    descriptions: Sequence[NodeDescription],
    context: Context,
    *,
    others: Sequence[Any] = (),
    quiet: bool = False,
    on_end: Callable[[], None] = lambda: None,
    signals: Signals | None = None,
    needs_all: bool = True,
) -> Iterator[dict[str, Any]]:
    """Run nodes until the block ends; yield a mapping from full names to nodes.

    The stages of each finger call each other, see `connect_fingers`. Ctrl-Z is ignored meanwhile.

    Parameters
    ----------
    descriptions : sequence of NodeDescription
        The nodes.
    context : Context
        ROS context of the nodes.
    others : sequence of rclpy.node.Node
        Further nodes that are spun, and destroyed at the end.
    quiet : bool
        See `create_node`.
    on_end : callable
        Called on a thread of the nodes when they have stopped running.
    signals : Signals, optional
        A signal ends the start of the nodes early; nodes that are not active then remain so.
    needs_all : bool
        Raise an error if a node cannot be configured or activated; if False, run the others.

    Raises
    ------
    TactileError
        If a node cannot be configured or activated, a callback has failed, or a node has failed
        while the others were running, such as a recorder whose disk is full.
    """
    nodes: dict[str, Any] = {}

    def is_ending() -> bool:
        return signals is not None and bool(signals.received)

    def bring_up() -> None:
        for description in descriptions:
            if is_ending():
                return
            nodes[description.path] = create_node(description, context, quiet=quiet)
        from tactile_bringup.nodes.finger_node import (  # slow to import
            connect_fingers,
            sources_last,
        )

        connect_fingers(nodes.values())
        for name, node in sources_last(nodes):
            if node.get_parameter('autostart').value and not node.bring_up():
                if is_ending():
                    return
                if not needs_all:
                    continue
                raise TactileError(
                    f'the node {name} could not be started; see its log for the reason'
                )

    def interrupt() -> None:
        for node in list(nodes.values()):
            node.ending.set()

    with ignoring_terminal_stops():
        try:
            if signals is None:
                bring_up()
            else:
                signals.run(bring_up, interrupt)
        except BaseException:
            NodeGroup([*others, *nodes.values()], context=context).close()
            raise
        with NodeGroup([*others, *nodes.values()], context=context, on_end=on_end) as group:
            yield nodes
    if group.error is not None:
        raise TactileError(
            f'a node failed, so all nodes were ended: {group.error}'
        ) from group.error
    failed = [name for name, node in nodes.items() if node.has_failed]
    if failed:
        raise TactileError(
            f'failed while running: {", ".join(failed)}; see the log for the reason'
        )
