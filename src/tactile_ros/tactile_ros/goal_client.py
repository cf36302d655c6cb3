# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Action goals and service calls that still work if an answer of the server is lost.

A client may discover a server before the server has discovered the client. Fast DDS then waits
0.1 s for the client and drops the answer to a request that has already been executed (rclpy warns:
"client will not receive response"; https://github.com/ros2/rmw_fastrtps/issues/842). Before Fast
DDS 3.6.2, a server can also miss a client permanently if two clients are discovered at the same
moment (https://github.com/eProsima/Fast-DDS/pull/6371). Therefore:

- The client chooses the id of a goal. The status topic of the action shows that a goal was
  accepted, even if the answer was lost.
- The result of a goal is requested every `ASK_S`, and more often once the status topic shows that
  the goal has ended. The server keeps results for 15 minutes. If it does not answer two requests
  after the end of the goal, a new client is created, because the server may never have discovered
  the previous client.
- A goal is never sent twice, and a service call is repeated only if executing it twice is
  harmless.

Every wait ends if the server has disappeared, was replaced by another server, or does not accept
the goal. A hanging server must be detected by the caller, because a goal may take any time.
"""

from __future__ import annotations

import concurrent.futures
from contextlib import suppress
import math
import threading
import time
from typing import Any
import uuid

from action_msgs.msg import GoalInfo, GoalStatus
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from tactile_ros.errors import TactileError
from tactile_ros.periodic import SLOW_CALLS
from tactile_ros.rclpy_internals import GoalIdClient, run_on_executor

LOOK_S = 0.5
"""Period of the check for lost answers [s]."""

ASK_S = 5.0
"""Period with which the result of a running goal is requested again [s].

A server that has been restarted answers that it does not know the goal.
"""

GONE_S = 2.0
"""A goal is given up as lost if there has been no action server for this time [s]."""

TAKE_S = 30.0
"""A goal is given up as lost if no server has accepted it within this time [s]."""

REPEAT_S = 1.0
"""Period with which a service that has not answered is called again [s]."""

POLL_S = 0.02
"""Time between two checks for an action server while the caller waits for it [s]."""

ENDED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


class GoalLostError(TactileError):
    """The outcome of a goal cannot be determined; the message gives the reason."""


class SentGoal:
    """A goal that was sent by `GoalClient.send`.

    Attributes
    ----------
    taken : concurrent.futures.Future of bool
        Done when it is known whether the server has accepted the goal. False if the goal is lost
        before that.
    end : concurrent.futures.Future
        rclpy's answer with ``status`` and ``result`` when the goal has ended. Raises
        `GoalLostError` if the goal was rejected, or if the action server has disappeared or does
        not know the goal.
    """

    def __init__(self, client: GoalClient) -> None:
        self.taken: concurrent.futures.Future[bool] = concurrent.futures.Future()
        self.end: concurrent.futures.Future[Any] = concurrent.futures.Future()
        self.goal_id = GoalInfo().goal_id
        self.goal_id.uuid = list(uuid.uuid4().bytes)
        self._client = client
        self._status = GoalStatus.STATUS_UNKNOWN
        self._is_cancelled = False
        self._lost_count = 0  # number of requests for the result that were not answered
        self._asked_s = self._there_s = self._sent_s = time.monotonic()

    def cancel(self) -> None:
        """Request the cancellation repeatedly until the goal has ended. Thread-safe."""
        self._is_cancelled = True
        self._client.look_soon()

    # -- on the executor's thread ----------------------------------------------------------

    def on_answer(self, future: Future) -> None:
        """Handle the server's answer that it has accepted or rejected the goal."""
        if self.taken.done():
            return
        if (error := future.exception()) is not None:
            self.lose(f'the goal could not be sent: {error}')
        elif not future.result().accepted:
            self.lose('the goal was rejected')
        else:
            self.on_status(GoalStatus.STATUS_ACCEPTED)

    def on_status(self, status: int) -> None:
        """Handle a published status of the goal. A goal with a status has been accepted."""
        self._status = max(self._status, status)
        if not self.taken.done():
            self.taken.set_result(True)
            self._ask()
            self._request_end()

    def look(self) -> None:
        """Repeat requests whose answers may have been lost, or give up."""
        if self.end.done():
            return
        now_s = time.monotonic()
        if self._client.server_is_ready():
            self._there_s = now_s
        elif now_s - self._there_s > GONE_S:
            self.lose('the action server has disappeared; check that its node is running')
            return
        if not self.taken.done():
            if now_s - self._sent_s > TAKE_S:
                self.lose(
                    f'the goal was not accepted within {TAKE_S:g} s; check the log of its node'
                )
            return
        self._request_end()
        has_ended = self._status in ENDED
        if now_s - self._asked_s >= (LOOK_S if has_ended else ASK_S):
            self._lost_count += has_ended
            if has_ended and self._lost_count % 2 == 0:
                self._client.reconnect()
            self._ask()

    def lose(self, reason: str) -> None:
        """Mark the goal as lost: its result raises `GoalLostError` with this reason."""
        if not self.end.done():
            self.end.set_exception(GoalLostError(reason))
        if not self.taken.done():
            self.taken.set_result(False)

    def _ask(self) -> None:
        self._asked_s = time.monotonic()
        self._client.ros.result_async(self.goal_id).add_done_callback(self._on_result)

    def _on_result(self, future: Future) -> None:
        if self.end.done() or future.exception() is not None:
            return
        reply = future.result()
        if reply.status == GoalStatus.STATUS_UNKNOWN:
            self._client.ros.cancel_async(self.goal_id)  # another server may run the goal
            self.lose(
                'the action server does not know the goal; check whether its node was restarted'
            )
        else:
            self.end.set_result(reply)

    def _request_end(self) -> None:
        if self._is_cancelled and self._status < GoalStatus.STATUS_CANCELING:
            self._client.ros.cancel_async(self.goal_id)


class GoalClient:
    """A client of one action that still works if an answer of the server is lost.

    An executor on another thread than the caller's must spin the node.
    """

    def __init__(self, node: Node, action_type: Any, name: str) -> None:
        self._node, self._type, self._name = node, action_type, name
        self._goals: list[SentGoal] = []  # goals that have not ended
        self._lock = threading.Lock()  # an rclpy client must not be destroyed while it is used
        self._connected_s = -math.inf
        self._is_closed = False
        self.ros = self._connect()
        """The rclpy client that is used at present, only on the executor's thread."""
        self._looks = SLOW_CALLS.every(LOOK_S, self.look_soon)

    def close(self) -> None:
        """Give up all goals and destroy the client; idempotent.

        Must be called on the executor's thread, or when no executor spins the node.
        """
        self._looks.cancel()
        while self._goals:
            self._goals.pop().lose('its client was closed')
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                self.ros.destroy()

    def server_is_ready(self) -> bool:
        """Return True if an action server is available."""
        with self._lock:
            # A new client needs some time to discover the server.
            is_new = time.monotonic() - self._connected_s < GONE_S
            return is_new or bool(self.ros.server_is_ready())

    def wait_for_server(self, timeout_s: float) -> bool:
        """Wait until an action server is available; return False after a timeout [s]."""
        deadline_s = time.monotonic() + timeout_s
        while not self.server_is_ready():
            if time.monotonic() > deadline_s or not self._node.context.ok():
                return False
            time.sleep(POLL_S)
        return True

    def send(self, message: Any) -> SentGoal:
        """Send a goal; raise RuntimeError if no executor spins the node."""
        goal = SentGoal(self)

        def start() -> None:
            self._goals.append(goal)
            try:
                answer = self.ros.send_goal_async(message, goal_uuid=goal.goal_id)
            except Exception as error:
                goal.lose(f'the goal could not be sent: {error}')
            else:
                answer.add_done_callback(goal.on_answer)

        run_on_executor(self._node, start)
        return goal

    def send_unwatched(self, message: Any) -> None:
        """Send a goal whose status and result are ignored; call it on the executor's thread."""
        self.ros.send_goal_async(message)

    # -- for the goals -----------------------------------------------------------------------

    def look_soon(self) -> None:
        """Schedule a check of all goals on the executor's thread."""
        if self._goals:
            with suppress(RuntimeError):  # the process is ending
                run_on_executor(self._node, self._look)

    def reconnect(self) -> None:
        """Replace the client of rclpy by a new one."""
        with self._lock:
            self.ros.destroy()
            self.ros = self._connect()
            self._connected_s = time.monotonic()

    def _connect(self) -> GoalIdClient:
        return GoalIdClient(self._node, self._type, self._name, self._on_status)

    def _look(self) -> None:
        for goal in tuple(self._goals):
            goal.look()
        self._goals = [goal for goal in self._goals if not goal.end.done()]

    def _on_status(self, statuses: list[Any]) -> None:
        known = {bytes(one.goal_info.goal_id.uuid): one.status for one in statuses}
        for goal in tuple(self._goals):
            status = known.get(bytes(goal.goal_id.uuid), GoalStatus.STATUS_UNKNOWN)
            if status != GoalStatus.STATUS_UNKNOWN:
                goal.on_status(status)


def call_until_answered(
    node: Node, client: Client, request: Any, timeout_s: float
) -> concurrent.futures.Future[Any]:
    """Call a service every `REPEAT_S` until it answers; return a future of the answer.

    Only for requests that may be executed twice, such as a stop.

    Parameters
    ----------
    node : Node
        Node that an executor on another thread spins.
    client : Client
        Client of the service.
    request
        The request.
    timeout_s : float
        Time after which the future raises TimeoutError [s].

    Raises
    ------
    RuntimeError
        If no executor spins the node.
    """
    answer: concurrent.futures.Future[Any] = concurrent.futures.Future()
    deadline_s = time.monotonic() + timeout_s

    def take(future: Future) -> None:
        with suppress(concurrent.futures.InvalidStateError):  # already answered or timed out
            if (error := future.exception()) is not None:
                answer.set_exception(error)
            else:
                answer.set_result(future.result())

    def ask() -> None:
        if not answer.done():
            client.call_async(request).add_done_callback(take)

    def repeat() -> None:
        if time.monotonic() > deadline_s:
            with suppress(concurrent.futures.InvalidStateError):
                answer.set_exception(TimeoutError(f'{client.srv_name} does not answer'))
        if answer.done():
            repetition.cancel()
        else:
            with suppress(RuntimeError):
                run_on_executor(node, ask)

    run_on_executor(node, ask)
    repetition = SLOW_CALLS.every(REPEAT_S, repeat)
    return answer
