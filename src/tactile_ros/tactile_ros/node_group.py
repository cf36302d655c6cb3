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
"""Longest time for which the end of a process waits until running goals have ended [s]."""

PEERS_END_S = 0.4
"""Time between the destruction of a node and the destruction of its DDS participant [s]. See
`run_node` for the reason."""

PARTICIPANT_ENDS_S = 5.0
"""Time [s] after `PEERS_END_S` within which the process must end, or it exits with a traceback."""

SPIN_S = 2.0
"""Longest sleep of an executor [s], unless a callback or the end wakes it earlier."""

POLL_S = 0.2
"""Time between two checks whether the node has finished its work [s]."""


class NodeGroup:
    """Context manager that spins nodes on executors in separate threads.

    Nodes whose ``is_quiet`` is True share one executor per class; every other node has a separate
    executor. Each time an executor wakes up, it checks all entities of its nodes. The executor of
    quiet nodes is woken only by requests and trial events; see docs/decisions/0006-executor.md.

    While the nodes are spun, garbage collections are kept short; see
    `tactile_ros.process.short_collections`.

    `close` first ends running goals, while the executors still run, because drivers need their
    topics and services to bring devices to rest. Then it calls `TactileNode.take_down` of each
    `TactileNode`, and destroys the other nodes.

    If a callback raises an exception, the traceback is logged and the executor ends. The group
    must then be closed, because a node must not continue to move a device after an incomplete
    callback.

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
        """End running goals, stop the executors and destroy the nodes; idempotent.

        Ctrl-C does not interrupt this method.
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
                # An empty task ends the executor's wait. After a mere wake-up, it waits again.
                executor.create_task(lambda: None)
        deadline = time.monotonic() + REST_TIMEOUT_S
        for executor, thread in self._spinning:
            if thread.is_alive():
                thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():  # go on, so that other nodes bring their devices to rest
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
            except Exception:  # go on, so that other nodes bring their devices to rest
                _logger().error(f'{name} failed while it ended:\n{traceback.format_exc()}')
        for executor, _ in spinning:
            executor.shutdown()
        self._collections.close()


def _spin_once(executor: Executor) -> None:
    try:
        executor.spin_once(timeout_sec=SPIN_S)
    except RCLError as error:
        # rclpy raises this exception for an invalid request. The nodes must continue to run.
        _logger().error(f'a request failed: {error}')


def _logger() -> Any:
    return get_logger('tactile')


def run_node(factory: Callable[[], TactileNode]) -> int:
    """Run one node until it is finished or a signal arrives; return the process's exit code.

    If the parameter ``autostart`` is true (the default), the node configures and activates itself;
    otherwise it waits for a lifecycle manager. The exit code is 1 if this fails or a callback
    raises, and 0 after SIGINT, SIGTERM or SIGHUP, also if the signal arrives during configure.
    Ctrl-Z is ignored.

    Fast DDS can wait forever if a participant is destroyed while the participant of another
    process ends (eProsima/Fast-DDS issue 6513; observed with the wheels of PyPI). Nodes that were
    launched together also end together. Therefore, the participant is destroyed `PEERS_END_S`
    after its node. A process that hangs nevertheless is ended with exit code 1.

    Call this function last, because the process must end within `PARTICIPANT_ENDS_S` after it.
    """
    signals = hold_signals()
    try:
        try:
            keep_heap_small()
            # The signal handlers of rclpy would shut the context down immediately. A node could
            # then no longer stop the linear guide.
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
    """Keep the DDS participant of nodes until a moment after the ``with`` block.

    The code in the block must destroy the nodes.
    """
    with ExitStack() as handles:  # the participant exists while a node's handle is in use
        for node in nodes:
            handles.enter_context(node.handle)
        yield
        time.sleep(PEERS_END_S)
        faulthandler.dump_traceback_later(PARTICIPANT_ENDS_S, exit=True, file=STDERR)


def end_process() -> None:
    """Shut ROS down, and end the process after a timeout if it hangs; call this last."""
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
