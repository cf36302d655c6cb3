# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import make_dataclass
from functools import partial
import gc
from pathlib import Path
import subprocess
import sys
import threading

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.node import Node
from std_msgs.msg import Int32

from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import NodeGroup
from tactile_testing.requests import send

DEADLINE_S = 10.0
NoConfig = make_dataclass('NoConfig', [], frozen=True)


class Probe(TactileNode):
    def __init__(self, name='probe', fails_in='', **options):
        super().__init__(name, NoConfig, **options)
        self.fails_in = fails_in
        self.is_torn_down = False

    def stop(self):
        if self.fails_in == 'stop':
            raise RuntimeError('no stop')

    def tear_down(self):
        self.is_torn_down = True
        if self.fails_in == 'tear_down':
            raise RuntimeError('no end')


def test_a_callback_that_raises_ends_the_executor_and_is_kept(context):
    node, ended = Probe(context=context), threading.Event()

    def fail():
        raise ZeroDivisionError('a bug')

    node.create_timer(0.01, fail)
    with NodeGroup([node], context=context, on_end=ended.set) as group:
        assert ended.wait(DEADLINE_S)
    assert isinstance(group.error, ZeroDivisionError)
    assert node.is_torn_down


def test_an_impossible_transition_does_not_stop_the_executor(context, spun):
    other = Node('other', context=context)
    client = other.create_client(ChangeState, 'probe/change_state')
    spun(other)
    group = spun(Probe(context=context))
    assert client.wait_for_service(timeout_sec=DEADLINE_S)
    for transition, is_possible in (('ACTIVATE', False), ('CONFIGURE', True)):
        step = Transition(id=getattr(Transition, f'TRANSITION_{transition}'))
        answer = send(other, lambda: client.call_async(ChangeState.Request(transition=step)))  # noqa: B023
        assert answer.result(DEADLINE_S).success == is_possible
    assert not group.ended.is_set()


@pytest.mark.parametrize('step', ['stop', 'tear_down'])
def test_a_node_that_ends_badly_does_not_keep_the_others_from_it(context, step):
    first = Probe('first', context=context)
    last = Probe('last', fails_in=step, context=context)
    assert last.bring_up()
    with NodeGroup([first, last], context=context):
        pass
    assert first.is_torn_down
    assert last.is_torn_down


INTERRUPTED = """
import os, signal, sys
from rclpy.context import Context
import rclpy
from tactile_ros.node_group import NodeGroup
from tactile_ros.process import hold_signals
from test_node_group import Probe

class Interrupting(Probe):
    def tear_down(self):
        os.kill(os.getpid(), signal.SIGINT)
        super().tear_down()

signals, context = hold_signals(), Context()
rclpy.init(context=context)
nodes = [Probe('first', context=context), Interrupting('last', context=context)]
try:
    with signals.raising(), NodeGroup(nodes, context=context):
        for node in nodes:
            assert node.bring_up()
except KeyboardInterrupt:
    print([node.is_torn_down for node in nodes])
rclpy.try_shutdown(context=context)
"""


def test_ctrl_c_while_nodes_are_taken_down_lets_all_of_them_end():
    done = subprocess.run(
        [sys.executable, '-c', INTERRUPTED],
        capture_output=True,
        text=True,
        timeout=60.0,
        cwd=Path(__file__).parent,
    )
    assert done.stdout == '[True, True]\n', done.stderr


def test_entities_may_be_destroyed_while_the_executor_waits(context, request):
    request.addfinalizer(partial(sys.setswitchinterval, sys.getswitchinterval()))
    sys.setswitchinterval(1e-6)
    node = Node('any', context=context)
    with NodeGroup([node], context=context) as group:
        for _ in range(300):
            publisher = node.create_publisher(Int32, 'numbers', 1)
            subscription = node.create_subscription(Int32, 'numbers', lambda _: None, 1)
            node.destroy_subscription(subscription)
            node.destroy_publisher(publisher)
        assert not group.ended.is_set(), group.error


def test_garbage_collections_skip_what_existed_when_the_nodes_started(context):
    """The more objects exist, the longer a full garbage collection stops all threads."""
    frozen = gc.get_freeze_count()
    gc.unfreeze()  # no objects are skipped at the start of a program
    try:
        before = [[number] for number in range(100_000)]
        with NodeGroup([Node('any', context=context)], context=context):
            assert gc.get_freeze_count() > len(before)
            assert len(gc.get_objects()) < len(before)
        assert gc.get_freeze_count() == 0
    finally:
        if frozen:
            gc.freeze()
