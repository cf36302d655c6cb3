# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Takes messages of all nodes of a process on one thread that waits on data alone."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
import threading
import time
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.subscription import Subscription

InvalidHandle = rclpy_implementation.InvalidHandle
GuardCondition = rclpy_implementation.GuardCondition
WaitSet = rclpy_implementation.WaitSet

WAIT_NS = 2 * 10**9
"""Longest sleep. Data, a change of what is waited for, and the end wake it earlier."""

RETRY_S = 0.5
"""Pause after a wait that has failed."""

END_TIMEOUT_S = 3.0
"""How long the end of a subscription waits until it is let go."""

MOST_MESSAGES = 100
"""Messages taken from one subscription before the next one has its turn."""

Deliver = Callable[[tuple[Any, Any]], object]


class Receiver:
    """Waits for messages of subscriptions of one context, takes them and hands them on.

    An executor goes through all services, timers and parameters of its node each time that it
    wakes, which takes 0.6 ms for a lifecycle node. Here a message takes 0.1 ms.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._changed = threading.Condition()
        self._deliveries: dict[Subscription, Deliver] = {}
        self._changes = 0
        self._seen_changes = 0
        self._thread: threading.Thread | None = None
        self._guard: Any = None
        context.on_shutdown(self._wake)

    def add(self, subscription: Subscription, deliver: Deliver) -> None:
        """Hand the messages of a subscription on.

        Its callback group must be a `NotOnExecutor`, so that no executor takes them. Events of
        the middleware, such as profiles that do not fit, are told here, too.

        Parameters
        ----------
        subscription : rclpy.subscription.Subscription
        deliver : callable
            Given message and information of each, on the receiver's thread; returns at once.
        """
        with self._changed:
            self._deliveries[subscription] = deliver
            self._changes += 1
            if self._thread is None:
                with self._context.handle:
                    self._guard = GuardCondition(self._context.handle)
                self._thread = threading.Thread(target=self._run, name='receiver', daemon=True)
                self._thread.start()
        self._wake()

    def remove(self, subscription: Subscription) -> None:
        """Hand no more messages on, and let the subscription go. Harmless if it is not there."""
        with self._changed:
            if self._deliveries.pop(subscription, None) is None:
                return
            self._changes += 1
            change = self._changes
        self._wake()
        with self._changed:
            self._changed.wait_for(
                lambda: self._thread is None or self._seen_changes >= change, END_TIMEOUT_S
            )

    def _wake(self) -> None:
        # Without the lock: a context calls this at its end, with its own lock held.
        guard = self._guard
        if guard is not None:
            with suppress(InvalidHandle):  # the thread has just ended
                guard.trigger_guard_condition()

    def _run(self) -> None:
        while True:
            is_over = not self._context.ok()
            with self._changed:
                self._seen_changes = self._changes
                self._changed.notify_all()
                deliveries = dict(self._deliveries)
                if is_over or not deliveries:
                    self._thread = None
                    self._guard.destroy_when_not_in_use()
                    self._guard = None
                    return
            try:
                self._receive(deliveries)
            except Exception as error:  # the others' messages must go on
                if self._context.ok():
                    get_logger('tactile').error(f'waiting for messages failed: {error}')
                    time.sleep(RETRY_S)

    def _receive(self, deliveries: dict[Subscription, Deliver]) -> None:
        """Take messages until something changes."""
        seen_changes = self._seen_changes
        with ExitStack() as stack:
            stack.enter_context(self._context.handle)
            guard = self._guard
            stack.enter_context(guard)
            entries = []
            for subscription, deliver in deliveries.items():
                try:
                    stack.enter_context(subscription.handle)
                except InvalidHandle:  # its node has just been destroyed
                    continue
                handle = subscription.handle
                entries.append((handle, handle.pointer, subscription, deliver))
            # Fast DDS wakes for data who waits for events of a reader. An executor must not.
            events = [handler for entry in entries for handler in entry[2].event_handlers]
            for event in events:
                stack.enter_context(event)
            wait_set = WaitSet(len(entries), 1, 0, 0, 0, len(events), self._context.handle)
            stack.enter_context(wait_set)
            while self._changes == seen_changes and self._context.ok():
                wait_set.clear_entities()
                wait_set.add_guard_condition(guard)
                for handle, *_ in entries:
                    wait_set.add_subscription(handle)
                for event in events:
                    event.add_to_wait_set(wait_set)
                wait_set.wait(WAIT_NS)
                ready = wait_set.get_ready_entities('subscription')
                for handle, pointer, subscription, deliver in entries:
                    if pointer in ready:
                        _take(handle, subscription, deliver)
                for event in events:
                    if event.is_ready(wait_set) and (data := event.take_data()):
                        event.callback(data)


def take_waiting(subscription: Subscription, deliver: Deliver, most: int) -> None:
    """Take what has come, at most so many, of a subscription that no receiver has any more."""
    with subscription.handle:
        _take(subscription.handle, subscription, deliver, most)


def _take(
    handle: Any, subscription: Subscription, deliver: Deliver, most: int = MOST_MESSAGES
) -> None:
    for _ in range(most):
        try:
            taken = handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            deliver(taken)
        except Exception as error:  # noqa: PERF203
            # Such as bytes that are no message of this type. That must not stop the others.
            get_logger('tactile').error(f'a message of {subscription.topic_name} failed: {error}')
            return


class NotOnExecutor(MutuallyExclusiveCallbackGroup):  # type: ignore[misc]
    """Keeps the executor from waiting on a subscription."""

    def can_execute(self, entity: Any) -> bool:
        return False


_lock = threading.Lock()
_receivers: dict[Context, Receiver] = {}


def receiver_of(context: Context) -> Receiver:
    """Return the one receiver of a context."""
    with _lock:
        for known in [known for known in _receivers if not known.ok()]:
            del _receivers[known]
        if context not in _receivers:
            _receivers[context] = Receiver(context)
        return _receivers[context]
