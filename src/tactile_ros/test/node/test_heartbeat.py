# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

import pytest
from rclpy.event_handler import UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Empty

from tactile_ros import health
from tactile_ros.errors import TactileError
from tactile_ros.health import Heartbeat, HeartbeatWatch
from tactile_testing.waiting import wait_until

START_S = 60.0
"""Timeout for the start of a process on a busy computer [s]."""

PEER = Path(__file__).with_name('beating_peer.py')


@pytest.fixture
def node(context):
    node = Node('listener', context=context)
    yield node
    node.destroy_node()


@pytest.fixture
def start_peer(context):
    """Return a function that starts a node with a heartbeat in a separate process.

    The name of the node is ``peer``.
    """
    processes = []

    def start():
        process = subprocess.Popen(
            [sys.executable, PEER, 'peer'],
            env={**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())},
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.wait()


@contextmanager
def beating(*hearts):
    """Publish heartbeats on a separate thread during a ``with`` block."""
    end = threading.Event()

    def run():
        while not end.wait(0.01):
            for heart in hearts:
                heart.beat()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def has(watch, text):
    return lambda: text in str(watch.find_loss() or '')


def test_a_watch_that_joins_beside_another_hears_a_peer_that_lives_already(node, context):
    peer = Node('peer', context=context)
    heart = Heartbeat(peer, lambda: True)
    first = HeartbeatWatch(node, 'peer/heartbeat')
    with beating(heart):
        wait_until(lambda: not first.find_loss())
        late = [HeartbeatWatch(node, 'peer/heartbeat') for _ in range(3)]
        wait_until(lambda: not any(watch.find_loss() for watch in late))
        late.pop().close()
        assert not any(watch.find_loss() for watch in (first, *late))
    wait_until(lambda: all(watch.find_loss() for watch in (first, *late)))
    for watch in (first, *late):
        watch.close()
    heart.close()
    peer.destroy_node()


def test_a_heart_beats_while_its_node_is_well_and_until_it_is_closed(node, context, spun):
    beats, asked, well = [], [], [True]
    listener = Node('other', context=context)
    listener.create_subscription(Empty, 'listener/heartbeat', beats.append, 1)
    other = Node('plain', context=context)
    other.create_subscription(Empty, 'listener/heartbeat', beats.append, qos_profile_sensor_data)

    def is_well():
        asked.append(True)
        return well[0]

    heart = Heartbeat(node, is_well)
    spun(listener, other)
    with beating(heart):
        wait_until(lambda: len(beats) >= 3)
        well[0] = False
        wait_until(lambda: heart._due_s and len(asked) > 5)
        heard_at = len(asked) + 20
        wait_until(lambda: len(asked) > heard_at)  # by now, pending messages have arrived
        count = len(beats)
        wait_until(lambda: len(asked) > heard_at + 20)
        assert len(beats) == count
        heart.close()
        well[0] = True
        heart.beat()
    assert node.count_publishers('/listener/heartbeat') == 0


@pytest.mark.parametrize('fault', [signal.SIGKILL, signal.SIGSTOP])
def test_a_peer_that_dies_or_freezes_is_lost_and_its_return_is_noticed(node, start_peer, fault):
    watch = HeartbeatWatch(node, 'peer/heartbeat')
    assert 'peer/heartbeat' in watch.find_loss().reason
    assert not watch.was_heard
    peer = start_peer()
    wait_until(lambda: not watch.find_loss(), timeout_s=START_S)
    late = HeartbeatWatch(node, 'peer/heartbeat')  # created while the peer is alive
    wait_until(lambda: not late.find_loss())
    peer.send_signal(fault)
    for each in (watch, late):
        wait_until(has(each, 'peer/heartbeat for 0.15 s'))
        assert each.was_heard
    if fault == signal.SIGSTOP:
        peer.send_signal(signal.SIGCONT)
    else:
        start_peer()
    # The killed peer is in the ROS graph for many seconds, but only the new one counts as alive.
    wait_until(lambda: not (watch.find_loss() or late.find_loss()), timeout_s=START_S)
    if fault == signal.SIGKILL:
        assert node.count_publishers('/peer/heartbeat') == 2
    for each in (watch, late):
        each.close()
        assert each.find_loss() is None  # after `close`, the last state is returned


def test_two_living_peers_of_one_name_are_named_and_one_killed_is_none(node, start_peer):
    watch = HeartbeatWatch(node, 'peer/heartbeat')
    peers = [start_peer(), start_peer()]
    wait_until(has(watch, '2 nodes'), timeout_s=START_S)
    wait_until(has(watch, '(/peer, /peer)'))
    peers[0].kill()
    wait_until(lambda: not watch.find_loss())
    peers[1].kill()
    wait_until(has(watch, 'for 0.15 s'))
    watch.close()


def test_the_own_heartbeat_may_be_silent_but_must_be_the_only_one(node, start_peer):
    watch = HeartbeatWatch(node, '~/heartbeat', rivals_only=True)
    heart = Heartbeat(node, lambda: True)
    twin = Node('listener', context=node.context)
    its_heart = Heartbeat(twin, lambda: True)
    assert (watch.was_heard, watch.find_loss()) == (True, None)
    with beating(heart):
        wait_until(lambda: watch._count_alive() == 1)
        assert watch.find_loss() is None
        with beating(its_heart):
            wait_until(has(watch, 'listener/heartbeat (/listener, /listener)'))
        wait_until(lambda: not watch.find_loss())
    wait_until(lambda: watch._count_alive() == 0)
    assert watch.find_loss() is None
    watch.close()
    twin.destroy_node()


def test_a_middleware_that_tells_nothing_of_liveliness_is_named(node, monkeypatch):
    def refuse(*_):
        raise UnsupportedEventTypeError('event type is not supported')

    monkeypatch.setattr(health, 'SubscriptionStatus', refuse)
    with pytest.raises(TactileError, match=r'rmw_.*RMW_IMPLEMENTATION'):
        HeartbeatWatch(node, 'peer/heartbeat')
    assert node.count_subscribers('/peer/heartbeat') == 0


def test_a_publisher_without_a_lease_is_told_what_it_lacks(node, context):
    watch = HeartbeatWatch(node, 'plain/heartbeat', 0.5)
    plain = Node('plain', context=context)
    plain.create_publisher(Empty, '~/heartbeat', qos_profile_sensor_data)
    wait_until(has(watch, 'MANUAL_BY_TOPIC'))
    watch.close()
    plain.destroy_node()
