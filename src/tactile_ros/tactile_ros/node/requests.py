# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
