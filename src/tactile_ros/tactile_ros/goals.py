# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Action servers whose goals run on separate threads."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from tactile_ros.clock_watch import ClockWatch, LOOK_S, Standstill
from tactile_ros.refusal import Refusal

EXPIRE_S = 1.0
"""Time after a standstill of the process during which new goals are refused [s].

Goals that were sent during the standstill arrive within this time."""


def wait_for(future: Future, timeout_s: float) -> Any:
    """Block this thread until the future is done; return its result, or None after a timeout [s].

    Must not be called on the executor's thread.
    """
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not future.done() and not done.wait(timeout_s):
        return None
    return future.result()


class GoalEnd(Exception):  # noqa: N818 - an outcome of a goal, not a fault of the program
    """Base class of exceptions that end a goal early.

    ``message`` and ``fields`` become fields of the goal's result.
    """

    def __init__(self, message: str, **fields: Any) -> None:
        super().__init__(message)
        self.fields = fields


class GoalAborted(GoalEnd):
    """Exception that ends a goal with the state ABORTED."""


class GoalCanceled(GoalEnd):
    """Exception that ends a goal with the state CANCELED, or ABORTED if no client cancelled it."""


class Goal:
    """A running goal, which is passed to the function that executes it.

    If a ``watch`` is passed, the goal ends early after a period in which the process was stopped.

    Attributes
    ----------
    request
        The goal message.
    end_reason : Refusal or None
        Why the goal must end early; None if a client or the node has requested its end.
    """

    def __init__(
        self, handle: ServerGoalHandle, feedback_type: type, watch: ClockWatch | None = None
    ) -> None:
        self.request = handle.request
        self.end_reason: Refusal | None = None
        self._handle = handle
        self._feedback_type = feedback_type
        self._watch = watch
        self._began_s = 0.0 if watch is None else watch.read_s()
        self._end = threading.Event()

    def feedback(self, **fields: Any) -> None:
        """Publish a feedback message with these fields."""
        if self._handle.is_active:
            self._handle.publish_feedback(self._feedback_type(**fields))

    def request_end(self) -> None:
        """Request the end of the goal: every `wait` returns immediately, and `check` raises."""
        self._end.set()

    @property
    def end_requested(self) -> bool:
        """True if the goal must end early, by request or because the process was stopped."""
        last = self._watch.look() if self._watch is not None else None
        if last is not None and last.end_s > self._began_s and self.end_reason is None:
            self.end_reason = _refuse_after(last)
            self.request_end()
        return self._end.is_set()

    def wait(self, seconds: float) -> bool:
        """Sleep for some time [s]; return True as soon as the goal must end early."""
        return self._end.wait(seconds) or self.end_requested

    def check(self) -> None:
        """Raise `GoalCanceled` if the goal must end early."""
        if self.end_requested:
            raise GoalCanceled(str(self.end_reason or 'cancelled'))


def _refuse_after(standstill: Standstill) -> Refusal:
    return Refusal(
        f'This process did not run for {standstill.duration_s:.1f} s, because it was stopped or '
        'its computer was suspended',
        'send the goal again',
    )


class GoalRunner:
    """An action server that runs one goal at a time on a separate thread.

    A goal that is refused, or that arrives while another goal runs, is accepted and then aborted,
    because only the result of a goal can contain the reason. If the process was stopped for some
    time (a standstill), the running goal ends early, and new goals are refused for a moment.

    Parameters
    ----------
    node : TactileNode
        The node.
    action_type
        Type of the action, whose result must have a field ``message``.
    name : str
        Name of the action.
    work : callable
        Executes a `Goal` and returns the result message. It may raise `GoalAborted` or
        `GoalCanceled`; any other exception aborts the goal with its text.
    find_refusal : callable
        Returns why no goal can be accepted now, or None.
    preempts : callable
        Returns True for a request that ends all running goals of the node. Such a request is
        never refused, and does not end after a standstill.
    watch : ClockWatch, optional
        Detects standstills.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        name: str,
        work: Callable[[Goal], Any],
        *,
        find_refusal: Callable[[], Refusal | None] = lambda: None,
        preempts: Callable[[Any], bool] = lambda _: False,
        watch: ClockWatch | None = None,
    ) -> None:
        self._node = node
        self._type = action_type
        self._work = work
        self._find_own_refusal = find_refusal
        self._preempts = preempts
        self._watch = watch or ClockWatch()
        self._looks = node.call_every(LOOK_S, self._look)
        self._lock = threading.Lock()
        self._goal: Goal | None = None
        self._ended = Future()  # completed at the end of the running goal
        self._thread: threading.Thread | None = None
        self._server = ActionServer(
            node,
            action_type,
            name,
            execute_callback=self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=self._cancel,
        )
        node.goal_runners.append(self)

    @property
    def is_busy(self) -> bool:
        """True from the start of a goal until its result is sent."""
        return self._goal is not None

    def end_goal(self) -> None:
        """Request the end of the running goal, if there is one."""
        goal = self._goal
        if goal is not None:
            goal.request_end()

    def close(self, timeout_s: float = 5.0) -> None:
        """End the running goal and destroy the server; idempotent.

        Wait for the goal for up to ``timeout_s`` [s]. If the goal runs for longer, its client
        gets no result.
        """
        self.end_goal()
        self._looks.cancel()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout_s)
        if self._server is not None:
            self._server.destroy()
            self._server = None
        if self in self._node.goal_runners:
            self._node.goal_runners.remove(self)

    def _cancel(self, _: ServerGoalHandle) -> CancelResponse:
        self.end_goal()
        return CancelResponse.ACCEPT

    def _look(self) -> None:
        """End the running goal after a standstill of the process; called periodically."""
        self._watch.look()
        goal = self._goal
        if goal is not None:
            goal.end_requested  # noqa: B018 - the property checks the watch

    def _find_refusal(self, preempts: bool) -> Refusal | None:
        """Return why a goal cannot be started now, or None."""
        if self._goal:
            return Refusal('Another goal is running', 'wait for it to end, or cancel it')
        if preempts:
            return None
        last = self._watch.look()
        if last is not None and self._watch.read_s() - last.end_s < EXPIRE_S:
            return _refuse_after(last)
        return self._find_own_refusal()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        preempts = self._preempts(handle.request)
        if preempts:
            for runner in self._node.goal_runners:
                while runner.is_busy:
                    runner.end_goal()
                    await runner._ended  # noqa: SLF001 - same class
        with self._lock:
            refusal = self._find_refusal(preempts)
            if refusal is None:
                watch = None if preempts else self._watch
                goal = self._goal = Goal(handle, self._type.Feedback, watch)
                self._ended = Future()
        if refusal is not None:
            handle.abort()
            return self._type.Result(message=str(refusal))
        if handle.is_cancel_requested:  # cancelled before it started
            goal.request_end()

        outcome: list[Any] = []
        done = Future()

        def run() -> None:
            try:
                outcome.append(self._work(goal))
            except Exception as error:
                outcome.append(error)
            finally:
                done.set_result(None)
                executor = self._node.executor
                if executor is not None:
                    executor.wake()

        self._thread = threading.Thread(target=run, name='goal', daemon=True)
        self._thread.start()
        await done
        self._node.on_goal_end()
        try:
            return self._finish(handle, outcome[0])
        finally:
            self._goal = None
            self._ended.set_result(None)

    def _finish(self, handle: ServerGoalHandle, outcome: Any) -> Any:
        """Set the goal's final state from the result or exception of its work."""
        if not isinstance(outcome, Exception):
            handle.succeed()
            return outcome
        # This runs on the executor's thread, which also handles cancel requests. If a client has
        # requested the cancellation, the state is CANCELED, even if the work has failed before.
        if isinstance(outcome, GoalEnd) and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if not isinstance(outcome, GoalEnd):
            self._node.get_logger().error(f'goal failed: {outcome}')
        # Add why the goal ended early, unless the exception of `Goal.check` already states it.
        message = str(outcome)
        reason = None if self._goal is None else self._goal.end_reason
        if reason is not None and str(reason) not in message:
            message = f'{reason} {message}'
        return self._type.Result(message=message, **getattr(outcome, 'fields', {}))
