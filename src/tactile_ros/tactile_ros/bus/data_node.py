# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lifecycle node of those that take or give samples, features and answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.executors import Executor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tactile_ros.bus.local_bus import depth_of, Inbox, RecordPublisher, RecordSubscription
from tactile_ros.bus.receiver import Deliver, NotOnExecutor, receiver_of, take_waiting
from tactile_ros.bus.worker import Periodic, Worker
from tactile_ros.node.lifecycle import TactileNode


def takes_message_info(subscription):
    return subscription._callback_type is not Subscription.CallbackType.MessageOnly


class DataNode(TactileNode):
    """A `TactileNode` that hands data to its neighbours in the process without messages.

    Records of neighbours, messages and periodic calls come on the node's worker, services on its
    executor. Transitions exclude them: a subclass needs no lock. What a callback on the worker
    raises ends the executor, as if it had been its own.

    The worker runs from the moment that the node is given to an executor.
    """

    def __init__(self, name: str, config_class: type, **node_options: Any) -> None:
        self.worker = Worker(f'worker of {name}', self._fail)
        self._listening: dict[Any, tuple[Inbox, Deliver]] = {}
        super().__init__(name, config_class, **node_options)

    # -- for subclasses ----------------------------------------------------------

    def publish_records(
        self,
        message_type: type,
        topic: str,
        to_message: Callable[[Any], Any],
        profile: QoSProfile,
    ) -> RecordPublisher:
        """Make a publisher of records; see `RecordPublisher`."""
        return RecordPublisher(self, message_type, topic, to_message, profile)

    def subscribe_records(
        self, message_type: type, topic: str, callback: Callable[[Any], object], **options: Any
    ) -> RecordSubscription:
        """Subscribe to records; see `RecordSubscription`."""
        return RecordSubscription(self, message_type, topic, callback, **options)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """None for an executor: the receiver takes the messages.

        Callback groups do not suffice. The events executor does not ask them.
        """
        yield from ()

    def call_every(self, period_s: float, callback: Callable[[], object]) -> Periodic:
        """Call again and again, by the computer's time."""
        return self.worker.every(period_s, callback)

    def create_subscription(
        self,
        message_type: Any,
        topic: str,
        callback: Callable[..., Any],
        *args: Any,
        **options: Any,
    ) -> Any:
        """Subscribe; the callback runs on the worker."""
        options['callback_group'] = NotOnExecutor()
        subscription = super().create_subscription(message_type, topic, callback, *args, **options)
        takes_info = takes_message_info(subscription)

        def deliver(taken: tuple[Any, Any]) -> None:
            subscription.callback(*(taken if takes_info else taken[:1]))

        def call() -> None:
            # Not by name: a circle would keep what the callback holds until Python collects it.
            if listening := self._listening.get(subscription):
                deliver(listening[0].take())

        inbox = Inbox(depth_of(subscription.qos_profile), lambda: self.worker.submit(call))
        self._listening[subscription] = inbox, deliver
        receiver_of(self.context).add(subscription, inbox.put)
        return subscription

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription; its callback is not called any more."""
        self._listening.pop(subscription, None)
        receiver_of(self.context).remove(subscription)
        return bool(super().destroy_subscription(subscription))

    def finish_subscription(self, subscription: Any) -> None:
        """Destroy a subscription after its callback has had all that came; in a transition."""
        receiver_of(self.context).remove(subscription)
        inbox, deliver = self._listening.pop(subscription)
        while len(inbox):
            deliver(inbox.take())
        take_waiting(subscription, deliver, depth_of(subscription.qos_profile))
        super().destroy_subscription(subscription)

    # -- transitions ---------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        with self.worker.held():
            return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        with self.worker.held():
            return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        with self.worker.held():
            return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        with self.worker.held():
            return super().on_cleanup(state)

    def _stop_and_tear_down(self) -> None:
        with self.worker.held():
            super()._stop_and_tear_down()

    # -- use --------------------------------------------------------------------------

    @property
    def executor(self) -> Executor | None:
        """The executor that the node was given to."""
        executor: Executor | None = Node.executor.fget(self)
        return executor

    @executor.setter
    def executor(self, executor: Executor | None) -> None:
        Node.executor.fset(self, executor)
        if executor is not None:
            self.worker.start()

    def destroy_node(self) -> None:
        if not self.worker.stop():
            self.get_logger().error('a callback of the worker does not end')
        super().destroy_node()

    def take_down(self) -> None:
        """Stop, give everything back and destroy the node, from any state."""
        self.worker.stop()
        super().take_down()

    def _fail(self, error: Exception) -> None:
        """End the executor with what a callback of the worker has raised."""

        def fail() -> None:
            raise error

        executor = self.executor
        if executor is None:
            self.get_logger().fatal(f'a callback failed: {error}')
        else:
            executor.create_task(fail)
