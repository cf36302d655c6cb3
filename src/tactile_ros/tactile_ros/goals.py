# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Goals of actions on threads of their own, and requests with a deadline."""

from __future__ import annotations

from collections.abc import Callable
import concurrent.futures
import threading
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from tactile_ros.clock_watch import ClockWatch, LOOK_S, Standstill
from tactile_ros.refusal import Refusal

EXPIRE_S = 1.0
"""Time after a standstill of the process in which no goal is begun [s].

Goals that were sent during the standstill are taken within a moment after it."""


def send(node: Node, request: Callable[[], Future]) -> concurrent.futures.Future[Any]:
    """Have the executor's thread send a request of ``node``; return its answer to be.

    It cannot be cancelled: an answer that comes after its time-out finds a place.

    An action client of rclpy notes a request only after it is sent: were it sent from
    another thread, the executor could take in the answer before that, and drop it.

    ``request`` sends and returns rclpy's future, as ``lambda: client.send_goal_async(goal)``. An
    executor on another thread must spin the node; RuntimeError when none does any more.
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


class GoalEnd(Exception):  # noqa: N818 - an outcome of a goal, not a fault of the program
    """Ends a goal early, with a sentence and perhaps other fields of its result."""

    def __init__(self, message: str, **fields: Any) -> None:
        super().__init__(message)
        self.fields = fields


class GoalAborted(GoalEnd):
    """Ends a goal as aborted."""


class GoalCanceled(GoalEnd):
    """Ends a goal as cancelled; as aborted, when no client asked for that."""


class Goal:
    """One goal, as its worker sees it; ``request`` is the goal message.

    With a ``watch`` the goal ends early when the process has stood still.
    """

    def __init__(
        self, handle: ServerGoalHandle, feedback_type: type, watch: ClockWatch | None = None
    ) -> None:
        self.request = handle.request
        self.end_reason: Refusal | None = None
        """Why the goal is to end early, if it is not by request."""
        self._handle = handle
        self._feedback_type = feedback_type
        self._watch = watch
        self._began_s = 0.0 if watch is None else watch.read_s()
        self._end = threading.Event()

    def feedback(self, **fields: Any) -> None:
        """Publish feedback with these fields."""
        if self._handle.is_active:
            self._handle.publish_feedback(self._feedback_type(**fields))

    def request_end(self) -> None:
        """Make every `wait` return at once and `check` raise."""
        self._end.set()

    @property
    def end_requested(self) -> bool:
        """True when the goal is to end early."""
        last = self._watch.look() if self._watch is not None else None
        if last is not None and last.end_s > self._began_s and self.end_reason is None:
            self.end_reason = _refuse_after(last)
            self.request_end()
        return self._end.is_set()

    def wait(self, seconds: float) -> bool:
        """Sleep; return True as soon as the goal is to end early."""
        return self._end.wait(seconds) or self.end_requested

    def check(self) -> None:
        """Raise `GoalCanceled` when the goal is to end early."""
        if self.end_requested:
            raise GoalCanceled(str(self.end_reason or 'cancelled'))


def _refuse_after(standstill: Standstill) -> Refusal:
    return Refusal(
        f'This process stood still for {standstill.duration_s:.1f} s: it was stopped, or its '
        'computer was suspended',
        'send the goal again',
    )


class GoalRunner:
    """An action server that runs ``work(goal)`` for one goal at a time, on a separate thread.

    ``work`` returns the result message, or raises `GoalAborted` or `GoalCanceled`; any other
    exception aborts the goal with its text. Result messages must have a field ``message``.
    ``find_refusal()`` returns why no goal can be taken now, or None. A goal that arrives then, or
    while another runs, is aborted with that reason in its result: a rejection would reach the
    client without one. A request for which ``preempts(request)`` is true ends every running goal
    of the node instead, and ``find_refusal`` is not asked.

    A goal ends early when the process stood still meanwhile, and a goal that may have waited for
    that long is not begun. Both do not apply to requests that preempt. ``watch`` detects
    standstills.
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
        self._ended = Future()  # done when the running goal is over
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
        """True while a goal runs, or has ended and its client does not know yet."""
        return self._goal is not None

    def end_goal(self) -> None:
        """Ask the running goal, if any, to end early."""
        goal = self._goal
        if goal is not None:
            goal.request_end()

    def close(self, timeout_s: float = 5.0) -> None:
        """End the running goal and take the server down. Harmless when called twice.

        The client of a goal that still runs gets no result: the server is gone.
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
        """End the running goal if the process stood still; periodic."""
        self._watch.look()
        goal = self._goal
        if goal is not None:
            goal.end_requested  # noqa: B018 - looks

    def _find_refusal(self, preempts: bool) -> Refusal | None:
        """Return why a goal cannot be begun now, or None."""
        if self._goal:
            return Refusal('Another goal is running', 'wait for its end, or cancel it')
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
                    await runner._ended  # noqa: SLF001 - of its own class
        with self._lock:
            refusal = self._find_refusal(preempts)
            if refusal is None:
                watch = None if preempts else self._watch
                goal = self._goal = Goal(handle, self._type.Feedback, watch)
                self._ended = Future()
        if refusal is not None:
            handle.abort()
            return self._type.Result(message=str(refusal))
        if handle.is_cancel_requested:  # while it waited for its turn
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
        """Set the goal's final state from what its work returned or raised."""
        if not isinstance(outcome, Exception):
            handle.succeed()
            return outcome
        # Asked here, on the executor's thread, where cancel requests are taken in too.
        # Whoever asked for the end hears of it, even if what was stopped noticed something first.
        if isinstance(outcome, GoalEnd) and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if not isinstance(outcome, GoalEnd):
            self._node.get_logger().error(f'goal failed: {outcome}')
        # Work that does not use `Goal.check` knows only that it had to end.
        message = str(outcome)
        reason = None if self._goal is None else self._goal.end_reason
        if reason is not None and str(reason) not in message:
            message = f'{reason} {message}'
        return self._type.Result(message=message, **getattr(outcome, 'fields', {}))
