# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Private parts of rclpy that the packages use.

Look here first when a new version of rclpy breaks something.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.task import Future

RCLError = rclpy_implementation.RCLError
"""Error of the C layer. `rclpy.exceptions` has no name for it."""


class NotOnExecutor(MutuallyExclusiveCallbackGroup):  # type: ignore[misc]
    """Keeps the executor from waiting on a subscription that is asked for its messages.

    rclpy offers no subscription without an executor.
    """

    def can_execute(self, entity: Any) -> bool:
        return False


class SubscriptionStatus:
    """A status of a subscription, such as its liveliness, that is asked for on any thread.

    rclpy hands a status to executors only. Destroy it before its subscription.
    """

    def __init__(self, subscription: Subscription, kind: Any) -> None:
        with subscription.handle:
            self._event = rclpy_implementation.EventHandle(subscription.handle, kind)

    def take(self) -> Any:
        """Return the present status; None when the middleware has none."""
        with self._event:
            return self._event.take_event()

    def destroy(self) -> None:
        """Give it back; `take` then raises."""
        self._event.destroy_when_not_in_use()


class GoalIdClient(ActionClient):  # type: ignore[misc]
    """An action client that knows goals by their id, whether or not their acceptance was heard.

    ``on_status`` is called on the executor's thread with each list of statuses that the server
    publishes. rclpy keeps only the statuses of goals whose acceptance has arrived.
    """

    def __init__(
        self, node: Node, action_type: Any, name: str, on_status: Callable[[Any], object]
    ) -> None:
        self._on_status = on_status
        super().__init__(node, action_type, name)

    def result_async(self, goal_id: Any) -> Future:
        """Request a goal's result; it has the status UNKNOWN when the server has no such goal."""
        return ClientGoalHandle(self, goal_id, None).get_result_async()

    def cancel_async(self, goal_id: Any) -> Future:
        """Request the end of a goal."""
        return ClientGoalHandle(self, goal_id, None).cancel_goal_async()

    async def execute(self, taken_data: dict[str, Any]) -> None:
        """Take what has come; called by the executor."""
        if 'status' in taken_data:
            self._on_status(taken_data['status'].status_list)
        await super().execute(taken_data)


def take_message(subscription: Subscription) -> tuple[Any, Any] | None:
    """Return the oldest message that waits and its information; None when there is none.

    rclpy offers this to executors only.
    """
    with subscription.handle:
        taken: tuple[Any, Any] | None = subscription.handle.take_message(
            subscription.msg_type, subscription.raw
        )
    return taken


def parameter_overrides(node: Node) -> dict[str, Parameter]:
    """Return the parameters that a node was started with, to be changed before they are declared.

    rclpy offers no other way: an integer for a float is refused as soon as it is declared.
    """
    overrides: dict[str, Parameter] = node._parameter_overrides
    return overrides


def change_state_service(node: LifecycleNode) -> Any:
    """Return the service that carries out transitions, to answer what it cannot with "no"."""
    return node._service_change_state


def destroy_state_machine(node: LifecycleNode) -> None:
    """Destroy the state machine of a destroyed node, which would keep it in the ROS graph.

    rclpy leaves it to the garbage collector, until which the node's name is seen, and found.
    """
    node._state_machine.destroy_when_not_in_use()
