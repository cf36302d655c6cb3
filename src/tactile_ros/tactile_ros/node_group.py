# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Execution of the nodes of one process, from the start to an orderly end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
import faulthandler
import threading
import time
import traceback
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from tactile_ros.lifecycle import TactileNode
from tactile_ros.process import (
    hold_signals,
    ignore_signals,
    ignoring_terminal_stops,
    keep_heap_small,
    short_collections,
    Signals,
    STDERR,
    uninterrupted,
)
from tactile_ros.rclpy_internals import Executor, RCLError

REST_TIMEOUT_S = 3.0
"""Longest wait at the end of a process for running goals to end [s]."""

PEERS_END_S = 0.4
"""Time for which the DDS participant is kept after its node was destroyed [s]; see `run_node`."""

PARTICIPANT_ENDS_S = 5.0
"""Time [s] after `PEERS_END_S` within which the process must end, or it exits with a traceback."""

SPIN_S = 2.0
"""Longest sleep of an executor [s], unless a callback or the end wakes it earlier."""

POLL_S = 0.2
"""Period of the check for a finished node [s]."""


class NodeGroup:
    """Spins nodes; a context manager.

    Quiet nodes of a class share one executor, every other node has a separate one. Each time an
    executor wakes up, it checks all entities of its nodes. The executor of quiet nodes is woken
    only by requests and trial events; see docs/decisions/0006-executor.md.

    Garbage collections are short meanwhile; see `tactile_ros.process.short_collections`.

    On close, running goals are ended first, while the executors still run, so that devices come
    to rest with a working graph. Then each `TactileNode` is taken down and any other node
    destroyed.

    An exception of a callback ends its executor, and the group must then be closed, because a
    node with an incomplete callback must not continue to move a device. The traceback is logged.

    Parameters
    ----------
    nodes : sequence of Node
        The nodes.
    context : Context, optional
        Context of the executors.
    on_end : callable
        Called once on the thread of the first executor that has stopped, for any reason.

    Attributes
    ----------
    ended : threading.Event
        Set when the first executor has stopped.
    error : Exception or None
        First exception of a callback that ended an executor.
    """

    def __init__(
        self,
        nodes: Sequence[Any],
        context: Context | None = None,
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._nodes = list(nodes)
        self._on_end = on_end
        self._ending = threading.Event()
        self._end_lock = threading.Lock()
        self._collections = ExitStack()
        self.ended = threading.Event()
        self.error: Exception | None = None
        self._spinning: list[tuple[Executor, threading.Thread]] = []
        together: dict[Any, list[Any]] = {}
        for node in self._nodes:
            key = type(node) if getattr(node, 'is_quiet', False) else node
            together.setdefault(key, []).append(node)
        for nodes in together.values():
            executor = Executor(context=context)
            for node in nodes:
                executor.add_node(node)
            name = f'executor of {nodes[0].get_name()}'
            thread = threading.Thread(target=self._spin, args=(executor,), name=name, daemon=True)
            self._spinning.append((executor, thread))

    def __enter__(self) -> NodeGroup:
        self._collections.enter_context(short_collections())
        for _, thread in self._spinning:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _spin(self, executor: Executor) -> None:
        try:
            while not self._ending.is_set():
                _spin_once(executor)
        except ExternalShutdownException:
            pass
        except Exception as error:
            self.error = self.error or error
            _logger().fatal(
                f'a callback failed, so all nodes of this process end:\n{traceback.format_exc()}'
            )
        finally:
            with self._end_lock:
                is_first = not self.ended.is_set()
                self.ended.set()
            if is_first:
                self._on_end()

    def close(self) -> None:
        """End goals, stop spinning, and take the nodes down; idempotent.

        Ctrl-C does not interrupt this.
        """
        with uninterrupted():
            self._close()

    def _close(self) -> None:
        for node in self._nodes:
            if isinstance(node, TactileNode):
                node.ending.set()
        runners = [r for node in self._nodes for r in getattr(node, 'goal_runners', ())]
        for runner in runners:
            runner.end_goal()
        deadline = time.monotonic() + REST_TIMEOUT_S
        threads = [thread for _, thread in self._spinning]
        while any(r.is_busy for r in runners) and any(t.is_alive() for t in threads):
            if time.monotonic() > deadline:
                break
            time.sleep(0.01)
        self._ending.set()
        for executor, thread in self._spinning:
            if thread.is_alive():
                # After a wake-up without a task, the executor would wait again.
                executor.create_task(lambda: None)
        deadline = time.monotonic() + REST_TIMEOUT_S
        for executor, thread in self._spinning:
            if thread.is_alive():
                thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():  # continue, because other nodes must bring devices to rest
                names = ', '.join(node.get_name() for node in executor.get_nodes())
                _logger().error(f'a callback of {names} does not return')
        nodes, self._nodes = self._nodes, []
        spinning, self._spinning = self._spinning, []
        for node in reversed(nodes):
            name = node.get_name()
            if node.executor is not None:
                node.executor.remove_node(node)
            try:
                if isinstance(node, TactileNode):
                    node.take_down()
                else:
                    node.destroy_node()
            except Exception:  # continue, because other nodes must bring devices to rest
                _logger().error(f'{name} failed while it ended:\n{traceback.format_exc()}')
        for executor, _ in spinning:
            executor.shutdown()
        self._collections.close()


def _spin_once(executor: Executor) -> None:
    try:
        executor.spin_once(timeout_sec=SPIN_S)
    except RCLError as error:
        # rclpy raises here for an invalid request, which must not stop the rig.
        _logger().error(f'a request failed: {error}')


def _logger() -> Any:
    return get_logger('tactile')


def run_node(factory: Callable[[], TactileNode]) -> int:
    """Run one node until it is finished or a signal arrives; return the process's exit code.

    If the parameter ``autostart`` is true (the default), the node configures and activates itself;
    otherwise it waits for a lifecycle manager. The exit code is 1 if this fails or a callback
    raises, and 0 after SIGINT, SIGTERM or SIGHUP, also if the signal arrives during configure.
    Ctrl-Z is ignored.

    Fast DDS can wait forever if a participant is destroyed while another one ends
    (eProsima/Fast-DDS issue 6513; observed with the wheels of PyPI). Nodes that were launched
    together also end together, so the participant is kept for a moment after its node. A process
    that hangs nevertheless is ended with exit code 1. Call this last, because the process must
    end within 5 s after it.
    """
    signals = hold_signals()
    try:
        try:
            keep_heap_small()
            # Without the handlers of rclpy, which shut the context down immediately, so that a
            # node could no longer stop the guide.
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            node = factory()
        except Exception as error:
            _logger().fatal(f'cannot start: {error}')
            return 1
        with outliving(node), ignoring_terminal_stops():
            return _serve(node, signals)
    finally:
        end_process()


@contextmanager
def outliving(*nodes: Any) -> Iterator[None]:
    """Keep the DDS participant of nodes for a moment after the block, which destroys the nodes."""
    with ExitStack() as handles:  # the participant exists as long as a handle is in use
        for node in nodes:
            handles.enter_context(node.handle)
        yield
        time.sleep(PEERS_END_S)
        faulthandler.dump_traceback_later(PARTICIPANT_ENDS_S, exit=True, file=STDERR)


def end_process() -> None:
    """Shut ROS down and make sure that the process ends; call this last, see `run_node`."""
    faulthandler.dump_traceback_later(PARTICIPANT_ENDS_S, exit=True, file=STDERR)
    rclpy.try_shutdown()
    ignore_signals()


def _serve(node: TactileNode, signals: Signals) -> int:
    """Run a node until it is finished or a signal arrives; return the process's exit code."""
    if node.get_parameter('autostart').value:
        if not signals.run(node.bring_up, node.ending.set):
            node.take_down()
            return 0 if signals.received else 1
        node.get_logger().info('active')
    with NodeGroup([node], on_end=signals.wake) as group:
        while not (signals.wait(POLL_S) or group.ended.is_set() or node.is_finished):
            pass
    return 1 if group.error or node.has_failed else 0
