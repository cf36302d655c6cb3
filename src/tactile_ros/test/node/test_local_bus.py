# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records go in memory within a process, and as messages to everybody else."""

from dataclasses import dataclass
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Int32

from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import BUS
from tactile_ros.errors import MessageError
from tactile_ros.programs.node_group import NodeGroup
from tactile_ros.qos import STREAM
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0
OVERRIDE = 'qos_overrides./numbers.publisher.reliability'


@dataclass(frozen=True)
class Nothing:
    pass


@dataclass(frozen=True)
class Number:
    value: int


class Source(DataNode):
    """Publishes numbers; counts the messages that it builds."""

    def __init__(self, name='source', **options):
        super().__init__(name, Nothing, **options)
        self.built = []
        self.numbers = None

    def set_up(self, config):
        self.numbers = self.publish_records(Int32, 'numbers', self.build, STREAM)

    def build(self, record):
        self.built.append(record.value)
        return Int32(data=record.value)

    def tear_down(self):
        if self.numbers is not None:
            self.numbers.close()
            self.numbers = None

    def send(self, *values):
        for value in values:
            self.numbers.publish(Number(value))


class Sink(DataNode):
    """Takes numbers; notes each record and the thread that it came on."""

    def __init__(self, name='sink', poll_s=None, **options):
        super().__init__(name, Nothing, **options)
        self.records = []
        self.threads = set()
        self.numbers = None
        self.hold = None
        self.poll_s = poll_s

    @property
    def values(self):
        return [record.value for record in self.records]

    def set_up(self, config):
        self.numbers = self.subscribe_records(
            Int32,
            'numbers',
            self.take,
            from_message=lambda message: check(Number(message.data)),
            from_record=check,
            profile=STREAM,
            poll_s=self.poll_s,
        )

    def tear_down(self):
        if self.numbers is not None:
            self.numbers.close()
            self.numbers = None

    def take(self, record):
        if self.hold is not None:
            self.hold.wait(DEADLINE_S)
        if record.value == 99_999:
            raise ValueError('a fault of the program')
        self.threads.add(threading.current_thread().name)
        self.records.append(record)


def check(record):
    if record.value < 0:
        raise MessageError(f'value is {record.value}; it must not be negative')
    return record


@pytest.fixture
def run(context, monkeypatch):
    """Return a function that configures, activates and spins nodes."""
    monkeypatch.setattr('tactile_ros.bus.local_bus.LOOK_PERIOD_S', 0.1)
    groups = []

    def start(*nodes, **options):
        for node in nodes:
            assert not isinstance(node, DataNode) or node.bring_up()
        group = NodeGroup(nodes, context=options.get('context', context))
        groups.append(group.__enter__())
        return group

    yield start
    for group in reversed(groups):
        group.close()
    assert not BUS._topics, 'a topic is left on the bus'


@pytest.mark.parametrize('source_first', [True, False])
def test_a_record_comes_itself_and_no_message_is_built(context, run, source_first):
    source, sink = Source(context=context), Sink(context=context)
    run(*((source, sink) if source_first else (sink, source)))
    wait_until(lambda: sink.numbers.is_local)
    sent = [Number(i) for i in range(100)]
    for record in sent:
        source.numbers.publish(record)
    wait_until(lambda: len(sink.records) == 100)
    assert all(a is b for a, b in zip(sink.records, sent, strict=True))
    assert source.built == []
    assert sink.threads == {'worker of sink'}


def test_the_graph_is_the_same(context, run):
    source, sink, peer = Source(context=context), Sink(context=context), Node('p', context=context)
    run(source, sink, peer)
    wait_until(lambda: sink.numbers.is_local)
    # What a node knows of the graph comes later than the match of two ends.
    wait_until(lambda: peer.count_subscribers('/numbers') == 1)
    wait_until(lambda: peer.count_publishers('/numbers') == 1)
    wait_until(
        lambda: '/numbers' in dict(peer.get_subscriber_names_and_types_by_node('sink', '/'))
    )


def test_a_listener_outside_gets_messages_as_long_as_it_listens(context, run):
    source, sink, peer = Source(context=context), Sink(context=context), Node('p', context=context)
    run(source, sink, peer)
    wait_until(lambda: sink.numbers.is_local)
    source.send(1)
    heard = []
    outside = peer.create_subscription(Int32, 'numbers', lambda m: heard.append(m.data), STREAM)
    wait_until(lambda: source.count_subscribers('/numbers') == 2)
    wait_until(lambda: source.numbers._publisher.get_subscription_count() == 2)
    source.send(2, 3)
    wait_until(lambda: heard == [2, 3] and sink.values == [1, 2, 3])
    peer.destroy_subscription(outside)
    wait_until(lambda: source.numbers._publisher.get_subscription_count() == 1)
    source.send(4)
    wait_until(lambda: sink.values == [1, 2, 3, 4])
    assert source.built == [2, 3]


def test_a_publisher_outside_is_heard_beside_the_one_within(context, run):
    source, sink, peer = Source(context=context), Sink(context=context), Node('p', context=context)
    run(source, sink, peer)
    wait_until(lambda: sink.numbers.is_local)
    source.send(1)
    wait_until(lambda: sink.values == [1])
    outside = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(lambda: not sink.numbers.is_local)
    wait_until(lambda: outside.get_subscription_count() == 1)
    wait_until(lambda: source.numbers._publisher.get_subscription_count() == 1)
    outside.publish(Int32(data=2))
    source.send(3)
    wait_until(lambda: sorted(sink.values) == [1, 2, 3])
    peer.destroy_publisher(outside)
    wait_until(lambda: sink.numbers.is_local)
    source.send(4)
    wait_until(lambda: sink.values[3:] == [4])
    assert source.built == [3]


def test_a_publisher_of_another_context_sends_messages(context, run):
    sink = Sink(context=context)
    run(sink)
    other = Context()
    rclpy.init(context=other, domain_id=context.get_domain_id())
    source = Source(context=other)
    assert source.bring_up()
    with NodeGroup([source], context=other):
        wait_until(lambda: source.numbers._publisher.get_subscription_count() == 1)
        source.send(1, 2)
        wait_until(lambda: sink.values == [1, 2])
        assert not sink.numbers.is_local
        assert source.built == [1, 2]
    rclpy.try_shutdown(context=other)


def test_a_polled_subscription_takes_messages_on_its_worker(context, run):
    sink, peer = Sink(context=context, poll_s=0.02), Node('p', context=context)
    outside = peer.create_publisher(Int32, 'numbers', STREAM)
    run(sink, peer)
    wait_until(lambda: outside.get_subscription_count() == 1)
    for value in (1, -2, 3, 4):
        outside.publish(Int32(data=value))
    wait_until(lambda: sink.values == [1, 3, 4])
    assert sink.threads == {'worker of sink'}
    assert sink.message_guard.refused_count == 1
    source = Source(context=context)
    run(source)
    wait_until(lambda: source.numbers._publisher.get_subscription_count() == 1)
    source.send(5)
    wait_until(lambda: sink.values == [1, 3, 4, 5])
    peer.destroy_publisher(outside)
    wait_until(lambda: sink.numbers.is_local)
    source.send(6)
    wait_until(lambda: sink.values == [1, 3, 4, 5, 6])
    assert source.built == [5]


def test_namespaces_and_remapping_decide_who_hears_whom(context, run):
    left, right = (Source(namespace=n, context=context) for n in ('left', 'right'))
    sink = Sink(namespace='left', context=context)
    turned = Sink(
        'turned',
        context=context,
        cli_args=['--ros-args', '--remap', 'numbers:=/right/numbers'],
    )
    run(left, right, sink, turned)
    wait_until(lambda: sink.numbers.is_local and turned.numbers.is_local)
    left.send(1)
    right.send(2)
    wait_until(lambda: sink.values == [1] and turned.values == [2])


def test_an_inactive_publisher_passes_nothing_on(context, run):
    source, sink = Source(context=context), Sink(context=context)
    run(source, sink)
    wait_until(lambda: sink.numbers.is_local)
    source.trigger_deactivate()
    source.send(1)
    source.trigger_activate()
    source.send(2)
    wait_until(lambda: sink.values == [2])


def test_a_publisher_that_is_gone_is_replaced_by_one_outside(context, run):
    source, sink, peer = Source(context=context), Sink(context=context), Node('p', context=context)
    run(source, sink, peer)
    wait_until(lambda: sink.numbers.is_local)
    source.trigger_deactivate()
    assert source.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    wait_until(lambda: not sink.numbers.is_local)
    outside = peer.create_publisher(Int32, 'numbers', STREAM)
    wait_until(lambda: outside.get_subscription_count() == 1)
    outside.publish(Int32(data=5))
    wait_until(lambda: sink.values == [5])
    peer.destroy_publisher(outside)
    assert source.bring_up()
    wait_until(lambda: sink.numbers.is_local)
    source.send(6)
    wait_until(lambda: sink.values == [5, 6])


def test_profiles_that_do_not_fit_do_not_connect(context, run):
    best_effort = [Parameter(OVERRIDE, value='best_effort')]
    source = Source(context=context, parameter_overrides=best_effort)
    fitting = Source('fitting', namespace='other', context=context)
    sink = Sink(context=context)
    run(source, fitting, sink)
    source.send(1)
    sink.numbers._choose()
    assert not sink.numbers.is_local
    assert sink.values == []


@pytest.mark.parametrize('outside', [True, False])
def test_what_cannot_be_converted_is_refused_and_a_fault_ends_the_group(context, run, outside):
    source, sink, peer = Source(context=context), Sink(context=context), Node('p', context=context)
    if outside:
        peer.create_publisher(Int32, 'numbers', STREAM)
    group = run(source, sink, peer)
    wait_until(lambda: sink.numbers.is_local is not outside)
    wait_until(lambda: source.numbers._publisher.get_subscription_count() == 1)
    source.send(1, -2, 3)
    wait_until(lambda: sink.values == [1, 3])
    assert sink.message_guard.refused_count == 1
    assert sink.message_guard.last_reason == 'numbers: value is -2; it must not be negative'
    source.send(99_999)
    assert group.ended.wait(DEADLINE_S)
    assert isinstance(group.error, ValueError)


def test_a_slow_sink_does_not_hold_its_source_and_loses_the_oldest(context, run):
    source, sink = Source(context=context), Sink(context=context)
    sink.hold = threading.Event()
    run(source, sink)
    wait_until(lambda: sink.numbers.is_local)
    source.send(0)
    wait_until(lambda: not sink.numbers._inbox._records)
    source.send(*range(1, STREAM.depth + 4))
    sink.hold.set()
    wait_until(lambda: len(sink.values) == STREAM.depth + 1)
    assert sink.values == [0, *range(4, STREAM.depth + 4)]


def test_a_transition_waits_for_the_callback_that_runs(context, run):
    source, sink = Source(context=context), Sink(context=context)
    sink.hold = threading.Event()
    run(source, sink)
    wait_until(lambda: sink.numbers.is_local)
    source.send(1)
    wait_until(lambda: not sink.numbers._inbox._records)
    over = []
    thread = threading.Thread(target=lambda: over.append(sink.trigger_deactivate()))
    thread.start()
    assert not over
    sink.hold.set()
    thread.join(DEADLINE_S)
    assert over == [TransitionCallbackReturn.SUCCESS]
    assert sink.values == [1]
