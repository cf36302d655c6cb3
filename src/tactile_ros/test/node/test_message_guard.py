# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages that a node cannot convert end with themselves, not with the node."""

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32

from tactile_ros import lifecycle
from tactile_ros.errors import MessageError
from tactile_ros.health import Diagnostics, Health, OK, WARN
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import CLOCK, STREAM
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


@dataclass(frozen=True)
class Nothing:
    pass


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
def graph(context, monkeypatch):
    monkeypatch.setattr('tactile_ros.health.PERIOD_S', 0.1)
    listener, peer = Listener(context=context), Node('peer', context=context)
    publisher = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(publisher.get_subscription_count)
    with NodeGroup([peer], context=context), NodeGroup([listener], context=context) as group:
        yield listener, peer, publisher, group


def test_a_refused_message_is_counted_and_the_next_one_is_taken(graph):
    listener, _, publisher, group = graph
    for number in (1, -2, 3, -4, 5):
        publisher.publish(Int32(data=number))
    wait_until(lambda: listener.numbers == [1, 3, 5])
    assert listener.message_guard.refused_count == 2
    assert listener.message_guard.last_reason == 'numbers: data is -4; it must not be negative'
    assert not group.ended.is_set()


def test_a_fault_of_the_program_still_ends_the_node(graph):
    _, _, publisher, group = graph
    publisher.publish(Int32(data=13))
    assert group.ended.wait(DEADLINE_S)
    assert isinstance(group.error, ValueError)


def test_bytes_that_are_no_message_do_not_end_the_node(graph):
    listener, _, publisher, group = graph
    publisher.publish(b'\x00')
    publisher.publish(b'\x00\x01\x00\x00\x07')
    publisher.publish(Int32(data=1))
    wait_until(lambda: listener.numbers[-1:] == [1])
    assert not group.ended.is_set()


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
    for number in (-1, -2, -3):
        publisher.publish(Int32(data=number))
    wait_until(lambda: listener.message_guard.refused_count == 3)
    monkeypatch.setattr(lifecycle, 'LOG_PERIOD_S', 0.0)
    publisher.publish(Int32(data=-4))
    wait_until(lambda: listener.message_guard.refused_count == 4)
    log = []
    wait_until(lambda: log.append(capfd.readouterr().err) or 'refused so far: 4' in ''.join(log))
    assert ''.join(log).count('refused a message on numbers') == 2


def test_an_impossible_clock_does_not_end_a_node(context):
    listener = Listener(
        context=context, parameter_overrides=[Parameter('use_sim_time', value=True)]
    )
    peer = Node('peer', context=context)
    clock = peer.create_publisher(Clock, '/clock', CLOCK)
    numbers = peer.create_publisher(Int32, 'numbers', QoSProfile(depth=10))
    with NodeGroup([peer], context=context), NodeGroup([listener], context=context) as group:
        wait_until(lambda: clock.get_subscription_count() and numbers.get_subscription_count())
        before = Clock()
        before.clock.sec = -1
        clock.publish(before)
        beyond = Clock()
        beyond.clock.sec, beyond.clock.nanosec = 2**31 - 1, 2**32 - 1
        clock.publish(beyond)
        numbers.publish(Int32(data=1))
        wait_until(lambda: listener.numbers == [1])
        now = Clock()
        now.clock.sec = 5
        clock.publish(now)
        wait_until(lambda: listener.get_clock().now().nanoseconds == 5 * 10**9)
        assert not group.ended.is_set()
