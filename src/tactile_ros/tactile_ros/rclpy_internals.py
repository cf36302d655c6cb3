# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""All uses of private parts of rclpy.

If the packages fail with a new version of rclpy, check this module first.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import threading
import time
from typing import Any

import rclpy.action
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.task import Future

RCLError = rclpy_implementation.RCLError
"""Exception of the C layer, which `rclpy.exceptions` does not export."""


RETRIES, RETRY_S = 1000, 0.001
"""Number of retries of an `Executor` that finds a destroyed entity, and pause before each one [s].
rclpy destroys the handle of an entity before it removes the entity from the node."""


class Executor(SingleThreadedExecutor):  # type: ignore[misc]
    """An executor that continues if other threads destroy publishers or subscriptions.

    An executor of rclpy ends with an exception if an entity with events is destroyed while the
    executor collects the entities of its nodes.
    """

    def wait_for_ready_callbacks(self, *arguments: Any, **options: Any) -> Any:
        for _ in range(RETRIES):
            with suppress(InvalidHandle):
                return super().wait_for_ready_callbacks(*arguments, **options)
            time.sleep(RETRY_S)
        return super().wait_for_ready_callbacks(*arguments, **options)


class NotOnExecutor(MutuallyExclusiveCallbackGroup):  # type: ignore[misc]
    """Callback group of a polled subscription, for which the executor does not wait.

    rclpy has no other way to create a subscription without an executor.
    """

    def can_execute(self, entity: Any) -> bool:
        return False


class SubscriptionStatus:
    """A status of a subscription, such as its liveliness, that can be read on any thread.

    rclpy itself provides a status only to executors. Call `destroy` before the subscription is
    destroyed.
    """

    def __init__(self, subscription: Subscription, kind: Any) -> None:
        with subscription.handle:
            self._event = rclpy_implementation.EventHandle(subscription.handle, kind)

    def take(self) -> Any:
        """Return the present status, or None if the middleware has none."""
        with self._event:
            return self._event.take_event()

    def destroy(self) -> None:
        """Release the status; after that, `take` raises."""
        self._event.destroy_when_not_in_use()


class ActionClient(rclpy.action.ActionClient):  # type: ignore[misc]
    """An action client that can be created while an executor on another thread spins the node.

    In Kilted, rclpy adds the client to the node before it creates the client's lock. An executor
    that uses the client between these two steps ends with an exception.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._lock = threading.Lock()
        super().__init__(*arguments, **options)


class GoalIdClient(ActionClient):
    """An action client that identifies goals by their id, even if their acceptance was lost.

    rclpy stores the status of a goal only after the client has received its acceptance.

    Parameters
    ----------
    node : Node
        The node.
    action_type
        Type of the action.
    name : str
        Name of the action.
    on_status : callable
        Called on the executor's thread with each list of statuses that the server publishes.
    """

    def __init__(
        self, node: Node, action_type: Any, name: str, on_status: Callable[[Any], object]
    ) -> None:
        self._on_status = on_status
        super().__init__(node, action_type, name)

    def result_async(self, goal_id: Any) -> Future:
        """Request a goal's result; its status is UNKNOWN if the server does not know the goal."""
        return ClientGoalHandle(self, goal_id, None).get_result_async()

    def cancel_async(self, goal_id: Any) -> Future:
        """Request the cancellation of a goal."""
        return ClientGoalHandle(self, goal_id, None).cancel_goal_async()

    async def execute(self, taken_data: dict[str, Any]) -> None:
        """Handle received data; called by the executor."""
        if 'status' in taken_data:
            self._on_status(taken_data['status'].status_list)
        await super().execute(taken_data)


def take_message(subscription: Subscription) -> tuple[Any, Any] | None:
    """Return the oldest waiting message and its ``info``, or None if there is none.

    rclpy itself passes messages only to executors.
    """
    with subscription.handle:
        taken: tuple[Any, Any] | None = subscription.handle.take_message(
            subscription.msg_type, subscription.raw
        )
    return taken


def run_on_executor(node: Node, call: Callable[[], object]) -> None:
    """Call a function on the thread of a node's executor.

    Raises
    ------
    RuntimeError
        If no executor spins the node, or its executor has been shut down.
    """
    executor = node.executor
    if executor is None:
        raise RuntimeError('no executor spins the node')
    if not executor._is_shutdown:
        with suppress(AttributeError):  # raised by Jazzy if the executor is being shut down
            executor.create_task(call)
            return
    raise RuntimeError('the executor has been shut down')


def parameter_overrides(node: Node) -> dict[str, Parameter]:
    """Return the parameter overrides of a node, which may be modified before declarations.

    rclpy refuses to declare a float parameter if its override is an integer, so integers must be
    converted in advance.
    """
    overrides: dict[str, Parameter] = node._parameter_overrides
    return overrides


def change_state_service(node: LifecycleNode) -> Any:
    """Return the service ``change_state`` of a node, to replace its callback."""
    return node._service_change_state


def destroy_state_machine(node: LifecycleNode) -> None:
    """Destroy the state machine of a destroyed node, which would keep it in the ROS graph.

    In rclpy, the garbage collector destroys it, so that the node would be visible until then.
    """
    node._state_machine.destroy_when_not_in_use()
