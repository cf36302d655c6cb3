# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of data nodes come over one thread, to the worker of each node."""

from dataclasses import dataclass
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Int32

from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.receiver import NotOnExecutor, receiver_of
from tactile_ros.programs.node_group import NodeGroup
from tactile_ros.qos import EVENTS, STREAM
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


@dataclass(frozen=True)
class Nothing:
    pass


class Listener(DataNode):
    """Notes the messages of topics, and the threads that they come on."""

    def __init__(self, name, **options):
        super().__init__(name, Nothing, **options)
        self.values = []
        self.threads = set()

    def take(self, message):
        self.threads.add(threading.current_thread().name)
        self.values.append(message.data)


def receiver_threads():
    return [thread for thread in threading.enumerate() if thread.name == 'receiver']


@pytest.fixture
def spun(context):
    """Return a function that spins nodes until the end of the test."""
    groups = []

    def start(*nodes):
        groups.append(NodeGroup(nodes, context=context).__enter__())
        return groups[-1]

    yield start
    for group in reversed(groups):
        group.close()
    wait_until(lambda: not receiver_threads())


def test_messages_come_in_order_on_the_worker_and_one_thread_serves_all(context, spun):
    peer = Node('peer', context=context)
    listeners = [Listener(f'listener_{i}', context=context) for i in range(3)]
    for listener in listeners:
        listener.create_subscription(Int32, 'numbers', listener.take, STREAM)
    spun(peer, *listeners)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(lambda: publisher.get_subscription_count() == 3)
    for i in range(500):
        publisher.publish(Int32(data=i))
    wait_until(lambda: all(len(listener.values) == 500 for listener in listeners))
    for listener in listeners:
        assert listener.values == list(range(500))
        assert listener.threads == {f'worker of {listener.get_name()}'}
    assert len(receiver_threads()) == 1


def test_an_events_executor_takes_no_messages_either(context):
    """It asks no callback group. Taken on two threads, messages would change their order."""
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    listener.create_subscription(Int32, 'numbers', listener.take, STREAM)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    executor = EventsExecutor(context=context)
    executor.add_node(listener)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    for i in range(500):
        publisher.publish(Int32(data=i))
        executor.spin_once(timeout_sec=0.0)
    wait_until(lambda: len(listener.values) == 500)
    assert listener.values == list(range(500))
    assert listener.threads == {'worker of listener'}
    executor.shutdown()
    for node in (peer, listener):
        node.destroy_node()


def test_latched_messages_and_their_information_come(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', EVENTS)
    for i in range(3):
        publisher.publish(Int32(data=i))
    heard = []

    def take(message, info):
        heard.append((message.data, info['received_timestamp'] > 0))

    listener.create_subscription(Int32, 'numbers', take, EVENTS)
    spun(peer, listener)
    wait_until(lambda: heard == [(0, True), (1, True), (2, True)])


def test_nothing_comes_after_a_subscription_is_destroyed_and_others_go_on(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    spun(peer, listener)
    for turn in range(20):
        heard = []
        gone = listener.create_subscription(
            Int32, 'numbers', lambda message, heard=heard: heard.append(message.data), STREAM
        )
        wait_until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(Int32(data=turn))
        wait_until(lambda heard=heard, turn=turn: heard == [turn])
        listener.destroy_subscription(gone)
        assert gone not in receiver_of(context)._deliveries
        wait_until(lambda: publisher.get_subscription_count() == 0)
        publisher.publish(Int32(data=-1))
        assert heard == [turn]


def test_a_slow_callback_loses_the_oldest_as_a_queue_of_dds_does(context, spun):
    peer, slow = Node('peer', context=context), Listener('slow', context=context)
    other = Listener('other', context=context)
    begun, go = threading.Event(), threading.Event()

    def take(message):
        begun.set()
        assert go.wait(DEADLINE_S)
        slow.take(message)

    slow.create_subscription(Int32, 'numbers', take, 5)
    other.create_subscription(Int32, 'numbers', other.take, STREAM)
    spun(peer, slow, other)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(Int32(data=0))
    assert begun.wait(DEADLINE_S)
    for i in range(1, 101):
        publisher.publish(Int32(data=i))
        wait_until(lambda i=i: len(other.values) == i + 1)  # a slow one holds nobody up
    go.set()
    wait_until(lambda: slow.values[-1:] == [100])
    assert slow.values == [0, 96, 97, 98, 99, 100]


def test_a_profile_that_does_not_fit_is_told(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    told = threading.Event()
    listener.create_subscription(
        Int32,
        'numbers',
        listener.take,
        STREAM,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda event: told.set()),
    )
    spun(peer, listener)
    peer.create_publisher(Int32, 'numbers', qos_profile_sensor_data)
    assert told.wait(DEADLINE_S)


def test_a_fault_of_one_delivery_is_told_and_the_others_go_on(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    failed = peer.create_subscription(
        Int32, 'numbers', lambda _: None, STREAM, callback_group=NotOnExecutor()
    )
    deliveries = []

    def fail(taken):
        deliveries.append(taken[0].data)
        raise ValueError('no place')

    receiver_of(context).add(failed, fail)
    listener.create_subscription(Int32, 'numbers', listener.take, STREAM)
    spun(peer, listener)
    wait_until(lambda: publisher.get_subscription_count() == 2)
    for i in range(10):
        publisher.publish(Int32(data=i))
        wait_until(lambda i=i: listener.values[-1:] == deliveries[-1:] == [i])
    receiver_of(context).remove(failed)


def test_the_thread_ends_with_its_context():
    context = Context()
    rclpy.init(context=context)
    listener = Listener('listener', context=context)
    listener.create_subscription(Int32, 'numbers', listener.take, STREAM)
    wait_until(lambda: len(receiver_threads()) == 1)
    rclpy.try_shutdown(context=context)
    wait_until(lambda: not receiver_threads())
    listener.destroy_node()
