# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a described graph in this process, where ``launch`` is not needed."""

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
    """Return the described node, unconfigured; a quiet one logs warnings and errors only.

    Raises `TactileError` when a parameter is not known, out of range or of the wrong type.
    """
    node_class = find_node_class(description.executable)
    overrides = [
        Parameter(key, value=list(value) if isinstance(value, tuple) else value)
        for key, value in description.parameters.items()
        if value != ()  # ROS cannot tell the type of an empty list, which is the default
    ]
    try:
        node = node_class(
            node_name=description.name,
            namespace=description.namespace,
            context=context,
            parameter_overrides=overrides,
        )
    except ParameterException as error:
        raise TactileError(f'the node {description.name} cannot be made: {error}') from error
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
    """Give a ROS context of its own, which no signal takes down behind our back.

    ``args`` are those of a command line; None: those of this process.
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
    """Run nodes until the block ends; give them by name, with their namespace.

    The stages of each finger call each other, see `connect_fingers`. Ctrl-Z is ignored meanwhile.

    Parameters
    ----------
    descriptions, context, quiet
        Those of `create_node`.
    others : sequence of rclpy.node.Node
        Nodes that are spun beside them, and destroyed at the end.
    on_end : callable
        Called, on a thread of the graph, when the nodes have stopped running.
    signals : Signals, optional
        A signal ends the start of the nodes early; those that are not active then stay so.
    needs_all : bool
        A node that cannot be configured or activated is an error; otherwise the others run.

    Raises
    ------
    TactileError
        When a node cannot be configured or activated, a callback of one failed, or one has
        failed by itself, as a recorder does whose disk is full; the others ran on then.
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
                raise TactileError(f'the node {name} could not be started; its log says why')

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
        raise TactileError(f'a node failed and all were ended: {group.error}') from group.error
    failed = [name for name, node in nodes.items() if node.has_failed]
    if failed:
        raise TactileError(f'failed on the way: {", ".join(failed)}; the log says why')
