# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests from a thread that does not spin, to services and actions of other nodes."""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
import threading
from typing import Any

from rclpy.node import Node
from rclpy.task import Future


def send(node: Node, request: Callable[[], Future]) -> concurrent.futures.Future[Any]:
    """Have the executor's thread send a request of ``node``; return its answer to be.

    It cannot be cancelled: an answer that comes after its time-out finds a place.

    An action client of rclpy notes a request only after it is sent: were it sent from
    another thread, the executor could take in the answer before that, and drop it.

    Parameters
    ----------
    node : rclpy.node.Node
        Must be spun by an executor on another thread.
    request : callable
        Sends, and returns rclpy's future, as ``lambda: client.send_goal_async(goal)``.

    Raises
    ------
    RuntimeError
        When no executor spins the node any more.
    """
    answer: concurrent.futures.Future[Any] = concurrent.futures.Future()
    answer.set_running_or_notify_cancel()

    def pass_on(future: Future) -> None:
        try:
            answer.set_result(future.result())
        except Exception as error:
            answer.set_exception(error)

    def start() -> None:
        try:
            request().add_done_callback(pass_on)
        except Exception as error:
            answer.set_exception(error)

    executor = node.executor
    if executor is None:
        raise RuntimeError('the process is ending')
    executor.create_task(start)
    return answer


def wait_for(future: Future, timeout_s: float) -> Any:
    """Block this thread, not the executor's, until the future is done; None on time-out."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not future.done() and not done.wait(timeout_s):
        return None
    return future.result()
