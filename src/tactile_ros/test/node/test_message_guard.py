# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A message that cannot be converted is refused and does not end the node."""

from dataclasses import make_dataclass

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32

from tactile_ros import lifecycle
from tactile_ros.errors import MessageError
from tactile_ros.health import Diagnostics, Health, OK, WARN
from tactile_ros.lifecycle import TactileNode
from tactile_ros.qos import CLOCK, STREAM
from tactile_ros.rclpy_internals import RCLError
from tactile_testing.waiting import read_stderr, wait_until

DEADLINE_S = 10.0
Nothing = make_dataclass('Nothing', [], frozen=True)


class Listener(TactileNode):
    def __init__(self, **options):
        super().__init__('listener', Nothing, **options)
        self.numbers = []
        self.create_subscription(Int32, 'numbers', self.take, STREAM)
        self.diagnostics = Diagnostics(self, lambda: '', lambda: Health(OK, 'well', {'a': 1}))

    def take(self, message):
        if message.data < 0:
            raise MessageError(f'data is {message.data}; it must not be negative')
        if message.data == 13:
            raise ValueError('a fault of the program')
        self.numbers.append(message.data)


@pytest.fixture
def graph(context, spun, monkeypatch):
    monkeypatch.setattr('tactile_ros.health.PERIOD_S', 0.1)
    listener, peer = Listener(context=context), Node('peer', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(publisher.get_subscription_count)
    spun(peer)
    return listener, peer, publisher, spun(listener)


def test_a_message_is_refused_or_unusable_and_only_a_fault_of_the_program_ends_the_node(graph):
    listener, _, publisher, group = graph
    for data in (b'\x00', b'\x00\x01\x00\x00\x07'):  # bytes that are not valid messages
        publisher.publish(data)
    for number in (1, -2, 3, -4, 5):
        publisher.publish(Int32(data=number))
    wait_until(lambda: listener.numbers == [1, 3, 5])
    refused = listener.message_guard.refused
    assert refused.count == 2
    assert refused.last_reason == 'numbers: data is -4; it must not be negative'
    assert not group.ended.is_set()
    publisher.publish(Int32(data=13))
    assert group.ended.wait(DEADLINE_S)
    assert isinstance(group.error, ValueError)


def test_diagnostics_show_the_count_and_warn_for_a_while(graph, monkeypatch):
    _, peer, publisher, _ = graph
    heard = []
    peer.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: heard.append(message.status[0]), 10
    )
    wait_until(lambda: heard)
    assert (heard[-1].level, heard[-1].message) == (OK, 'well')
    publisher.publish(Int32(data=-1))
    wait_until(lambda: heard[-1].level == WARN)
    assert 'data is -1' in heard[-1].message
    values = {pair.key: pair.value for pair in heard[-1].values}
    assert values['a'] == '1'
    assert values['refused_messages'] == '1'
    assert 'data is -1' in values['last_refused_message']
    monkeypatch.setattr(lifecycle, 'SHOWN_S', 0.0)
    wait_until(lambda: heard[-1].level == OK)
    assert {pair.key: pair.value for pair in heard[-1].values} == values


def test_the_log_mentions_refused_messages_now_and_then(graph, capfd, monkeypatch):
    listener, _, publisher, _ = graph
    for number in (-1, -2, -3, 1):
        publisher.publish(Int32(data=number))
    wait_until(lambda: listener.numbers == [1])  # the negative numbers have been refused
    assert listener.message_guard.refused.count == 3
    monkeypatch.setattr(lifecycle, 'LOG_PERIOD_S', 0.0)
    publisher.publish(Int32(data=-4))
    wait_until(lambda: listener.message_guard.refused.count == 4)
    wait_until(lambda: '(messages so far: 4)' in read_stderr())
    assert capfd.readouterr().err.count('refused a message on numbers') == 2


def test_a_node_survives_messages_that_cannot_be_published(graph, capfd):
    """Fast DDS sometimes fails to publish while another process that subscribes is ending."""
    listener, _, _, group = graph
    sent, failures = [], 3

    def publish(message):
        nonlocal failures
        if failures:
            failures -= 1
            raise RCLError('cannot publish data')
        sent.append(message)

    guarded = listener.message_guard.wrap_publish('strain', publish)
    for number in range(3):
        guarded(number)
    assert sent == [1, 2]  # message 0 failed twice, message 1 once
    assert listener.message_guard.unpublished.count == 1
    assert listener.message_guard.warning.startswith('could not publish a message on strain')
    assert listener.message_guard.values['unpublished_messages'] == 1
    assert not group.ended.is_set()
    wait_until(lambda: 'could not publish a message on strain' in read_stderr())


def test_every_publisher_of_a_node_is_guarded(context, monkeypatch):
    def fail(*_):
        raise RCLError('cannot publish data')

    listener = Listener(context=context)
    monkeypatch.setattr('rclpy.publisher.Publisher.publish', fail)
    listener.trigger_configure()
    listener.trigger_activate()
    listener.create_publisher(Int32, 'plain', STREAM).publish(Int32())
    stream = listener.create_stream_publisher(Int32, 'stream', STREAM)
    stream.on_activate(None)
    stream.publish(Int32())
    assert listener.message_guard.unpublished.count == 2
    listener.take_down()


def test_an_impossible_clock_does_not_end_a_node(context, spun):
    listener = Listener(
        context=context, parameter_overrides=[Parameter('use_sim_time', value=True)]
    )
    peer = Node('peer', context=context)
    clock = peer.create_publisher(Clock, '/clock', CLOCK)
    group = spun(listener)
    wait_until(clock.get_subscription_count)
    for sec, nanosec in (*((-1, 0), (2**31 - 1, 2**32 - 1)) * 5, (5, 0)):
        message = Clock()
        message.clock.sec, message.clock.nanosec = sec, nanosec
        clock.publish(message)
        # The queue contains only the newest message, so the node receives some of these messages.
        assert clock.wait_for_all_acked(Duration(seconds=DEADLINE_S))
    wait_until(lambda: listener.get_clock().now().nanoseconds == 5 * 10**9)
    assert not group.ended.is_set()
    peer.destroy_node()
