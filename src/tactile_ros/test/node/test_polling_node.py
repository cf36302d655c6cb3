# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Polled subscriptions, and records that are published only for subscribers."""

from dataclasses import make_dataclass
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Int32

from tactile_ros.errors import MessageError
from tactile_ros.polling import PollingNode
from tactile_ros.qos import EVENTS, STREAM
from tactile_ros.stages import RecordPublisher, Stage, StageNode
from tactile_testing.waiting import read_stderr, wait_until

DEADLINE_S = 10.0
Nothing = make_dataclass('Nothing', [], frozen=True)


class Listener(PollingNode):
    """Stores the numbers in received messages, and the threads on which they are handled."""

    def __init__(self, name, **options):
        super().__init__(name, Nothing, **options)
        self.values = []
        self.threads = set()

    def take(self, message, _):
        if message.data < 0:
            raise MessageError(f'{message.data} is negative')
        if message.data == 99_999:
            raise ZeroDivisionError('a bug')
        self.threads.add(threading.current_thread().name)
        self.values.append(message.data)


@pytest.fixture
def pair(context, spun):
    """Return a function that starts a publisher of numbers and a node that polls them.

    The function returns when publisher and subscription have discovered each other.
    """

    def make(take=None, profile=STREAM, poll_s=0.005, **options):
        peer, listener = Node('peer', context=context), Listener('listener', context=context)
        listener.poll_s = poll_s
        take = take or listener.take
        subscription = listener.poll(Int32, 'numbers', take, profile, **options)
        group = spun(peer, listener)
        publisher = peer.create_publisher(Int32, 'numbers', profile)
        wait_until(lambda: publisher.get_subscription_count() == 1)
        wait_until(lambda: subscription.get_publisher_count() == 1)
        return publisher, listener, group

    return make


def publish(publisher, numbers):
    for number in numbers:
        publisher.publish(Int32(data=number))
    assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE_S))


def test_messages_come_in_order_on_the_thread_of_the_node_until_a_fault_of_the_program(pair):
    publisher, listener, group = pair()
    publish(publisher, range(500))
    wait_until(lambda: len(listener.values) == 500)
    assert listener.values == list(range(500))
    assert listener.threads == {'topics of listener'}
    publish(publisher, (1, -1, 2))
    wait_until(lambda: listener.values[500:] == [1, 2])
    assert listener.message_guard.refused.count == 1
    assert not group.ended.is_set()
    publish(publisher, [99_999])
    assert group.ended.wait(DEADLINE_S)
    assert isinstance(group.error, ZeroDivisionError)


def test_latched_messages_and_their_information_come(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', EVENTS)
    for i in range(3):
        publisher.publish(Int32(data=i))
    heard = []
    listener.poll(
        Int32,
        'numbers',
        lambda m, info: heard.append((m.data, info['received_timestamp'])),
        EVENTS,
    )
    spun(peer, listener)
    wait_until(lambda: [value for value, _ in heard] == [0, 1, 2])
    assert all(received_ns > 0 for _, received_ns in heard)


def test_without_a_period_all_that_waits_comes_together_when_it_is_asked_for(pair):
    came = []
    publisher, listener, _ = pair(
        lambda messages, _: came.extend(messages), poll_s=None, together=True
    )
    publish(publisher, range(5))
    wait_until(lambda: listener.poll_now() or len(came) == 5)
    assert [message.data for message in came] == [0, 1, 2, 3, 4]
    assert not [t for t in threading.enumerate() if t.name == 'topics of listener']


def test_nothing_comes_after_a_subscription_is_closed_and_others_go_on(context, spun):
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    spun(peer, listener)
    for turn in range(20):
        heard = []
        gone = listener.poll(
            Int32, 'numbers', lambda message, _, heard=heard: heard.append(message.data), STREAM
        )
        wait_until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(Int32(data=turn))
        wait_until(lambda heard=heard, turn=turn: heard == [turn])
        listener.unpoll(gone)
        listener.unpoll(gone)
        wait_until(lambda: publisher.get_subscription_count() == 0)
        publisher.publish(Int32(data=-1))
        assert heard == [turn]


def test_a_slow_callback_loses_the_oldest_as_any_queue_of_dds_does(pair):
    begun, go, values = threading.Event(), threading.Event(), []

    def take(message, _):
        begun.set()
        assert go.wait(DEADLINE_S)
        values.append(message.data)

    publisher, *_ = pair(take, rclpy.qos.QoSProfile(depth=5))
    publish(publisher, [0])
    assert begun.wait(DEADLINE_S)
    publish(publisher, range(1, 101))
    go.set()
    wait_until(lambda: values[-1:] == [100])
    assert values == [0, 96, 97, 98, 99, 100]


def test_a_publisher_whose_profile_does_not_fit_is_named_once(context, spun, monkeypatch, capfd):
    monkeypatch.setattr('tactile_ros.polling.MISFITS_S', 0.01)
    peer, listener = Node('peer', context=context), Listener('listener', context=context)
    listener.poll(Int32, 'numbers', listener.take, STREAM)
    spun(peer, listener)
    peer.create_publisher(Int32, 'numbers', qos_profile_sensor_data)
    sentence = 'no messages are received from /peer on /numbers, because its QoS is incompatible'
    wait_until(lambda: sentence in read_stderr())
    looks = threading.Semaphore(0)
    listener.call_every(0.01, looks.release)
    for _ in range(5):
        assert looks.acquire(timeout=DEADLINE_S)
    assert capfd.readouterr().err.count('no messages are received from /peer') == 1


def test_polling_ends_with_its_context():
    context = Context()
    rclpy.init(context=context)
    listener = Listener('listener', context=context)
    listener.poll(Int32, 'numbers', listener.take, STREAM)
    rclpy.try_shutdown(context=context)
    listener.destroy_node()
    wait_until(lambda: not [t for t in threading.enumerate() if t.name == 'topics of listener'])


def test_a_node_that_is_destroyed_meanwhile_does_not_end_the_periodic_calls_of_others(context):
    first, other = (Listener(name, context=context) for name in ('first', 'other'))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(first)
    is_called, is_destroyed = threading.Event(), threading.Event()

    def use_destroyed_node():
        is_called.set()
        assert is_destroyed.wait(DEADLINE_S)
        first.count_publishers('numbers')

    first.call_every(0.001, use_destroyed_node)
    assert is_called.wait(DEADLINE_S)
    executor.shutdown()
    first.destroy_node()
    is_destroyed.set()
    looks = threading.Semaphore(0)
    other.call_every(0.001, looks.release)
    assert looks.acquire(timeout=DEADLINE_S)
    other.destroy_node()


class Doubling(Stage):
    """A stage that doubles numbers. It stores the numbers for which it created a message."""

    def __init__(self, node, emit):
        self.node, self.emit = node, emit
        self.calls, self.built = [], []
        self.numbers = RecordPublisher(node, Int32, '~/doubled', self.build, STREAM)
        node.listen(Int32, 'numbers', lambda message: self.add(message.data), STREAM)

    def build(self, number):
        self.built.append(number)
        return Int32(data=number)

    def add(self, number):
        if number < 0:
            raise MessageError(f'{number} is negative')
        if self.node.is_active:
            self.numbers.publish(2 * number)
            self.emit(2 * number)

    def stop(self):
        self.calls.append('stop')

    def close(self):
        self.calls.append('close')
        self.numbers.close()


class DoublingNode(StageNode):
    def __init__(self, name, **options):
        self.emit = lambda _: None
        super().__init__(name, Nothing, **options)

    def make_stage(self, config):
        return Doubling(self, self.emit)


@pytest.mark.parametrize('by_calls', [True, False])
def test_one_stage_after_the_other_by_calls_and_by_topics(context, spun, by_calls):
    first, second = DoublingNode('first', context=context), DoublingNode('second', context=context)
    peer, results = Node('peer', context=context), []
    second.emit = results.append
    if by_calls:
        first.is_fed_by_calls = second.is_fed_by_calls = True
        first.emit = second.input('first/doubled', lambda stage, number: stage.add(number))
    else:
        first.emit = lambda _: None
        second = DoublingNode(
            'third', context=context, cli_args=['--ros-args', '-r', 'numbers:=first/doubled']
        )
        second.emit = results.append
    assert first.bring_up()
    assert second.bring_up()
    spun(first, second, peer)
    take = first.input('numbers', lambda stage, number: stage.add(number))
    wait_until(lambda: by_calls or first.stage.numbers._publisher.get_subscription_count() == 1)
    for number in (1, -1, 2):
        take(number)
    wait_until(lambda: results == [4, 8])
    assert first.message_guard.refused.count == 1
    assert first.stage.built == ([] if by_calls else [2, 4])
    heard = []
    outside = peer.create_subscription(
        Int32, 'first/doubled', lambda message: heard.append(message.data), STREAM
    )
    wait_until(lambda: first.stage.numbers._publisher.get_subscription_count() == 2 - by_calls)
    take(3)
    # The new subscriber receives the first message that is published after its discovery.
    wait_until(lambda: heard == [6] and results == [4, 8, 12])
    peer.destroy_subscription(outside)
    stage = first.stage
    first.trigger_deactivate()
    take(4)
    first.trigger_cleanup()
    take(5)
    assert stage.calls == ['stop', 'close']
    assert results == [4, 8, 12]
    assert first.trigger_configure().name == 'SUCCESS'
    assert first.stage is not stage
