# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import os
import subprocess
import sys
import threading

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from tactile_bags import TactileBag
from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.graph_runner import create_node
from tactile_msgs.msg import StrainBlock, TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import CLOCK, EVENTS, STREAM
from tactile_ros.topics import EVENT, STRAIN
from tactile_testing.waiting import wait_until

DEADLINE_S = 60.0
MANY_EVENTS = QoSProfile(
    depth=STREAM.depth, reliability=EVENTS.reliability, durability=EVENTS.durability
)
"""Like `EVENTS`, with a larger depth, because many messages may queue on a busy computer."""


def player(bag, **parameters):
    return NodeDescription('bag_player', {'bag': str(bag), **parameters})


class Listener:
    """Stores the played messages as bytes, and the times on the topic /clock."""

    def __init__(self, context):
        self.node = Node('listener', context=context)
        self.received = {STRAIN: [], EVENT: []}
        self.clock_ns = []
        for kind, message_type, topic, qos in (
            (STRAIN, StrainBlock, 'tendon_sensor/strain', STREAM),
            (EVENT, TrialEvent, 'trial_runner/events', MANY_EVENTS),
        ):
            self.node.create_subscription(
                message_type, topic, self.received[kind].append, qos, raw=True
            )
        self.node.create_subscription(Clock, '/clock', self._on_clock, CLOCK)

    def _on_clock(self, message):
        self.clock_ns.append(message.clock.sec * 10**9 + message.clock.nanosec)


def recorded(path):
    with TactileBag(path) as bag:
        messages = list(bag.messages(STRAIN, EVENT))
    data = {kind: [m.data for m in messages if m.type_name == kind] for kind in (STRAIN, EVENT)}
    return data, (messages[0].received_at_ns, messages[-1].received_at_ns)


def test_recorded_bytes_are_played_with_the_clock_of_the_bag(context, stiffness_bag):
    expected, span_ns = recorded(stiffness_bag)
    listener = Listener(context)
    follower = Node('follower', context=context)
    follower.set_parameters([Parameter('use_sim_time', value=True)])
    node = create_node(player(stiffness_bag, rate=100.0, start_delay_s=0.0), context)
    with NodeGroup([node, listener.node, follower], context=context):
        node.trigger_configure()
        # The player waits for subscribers, and the subscribers must have found the player, too.
        readers = [*listener.node.subscriptions, *follower.subscriptions]
        wait_until(lambda: all(reader.get_publisher_count() for reader in readers))
        node.trigger_activate()
        wait_until(lambda: node.is_finished)
        wait_until(lambda: len(listener.received[STRAIN]) == len(expected[STRAIN]))
        wait_until(lambda: len(listener.received[EVENT]) == len(expected[EVENT]))
        wait_until(lambda: listener.clock_ns[-1] == span_ns[1])
        wait_until(lambda: follower.get_clock().now().nanoseconds == span_ns[1])
        assert not node.has_failed
    assert listener.received == expected
    assert listener.clock_ns == sorted(listener.clock_ns)
    assert listener.clock_ns[0] >= span_ns[0]
    assert len(listener.clock_ns) > 20


def test_invalid_bag_is_refused_by_the_player(context, stiffness_bag, tmp_path):
    for description in (player(tmp_path), player(''), player(stiffness_bag, namespace='toe')):
        node = create_node(description, context)
        assert not node.bring_up()
        node.take_down()
    with pytest.raises(TactileError):
        create_node(player(stiffness_bag, rate=0.0), context)


def test_playing_can_be_ended(context, stiffness_bag):
    node = create_node(player(stiffness_bag, rate=0.001, start_delay_s=0.0), context)
    with NodeGroup([node], context=context):
        assert node.bring_up()
        wait_until(lambda: node.message_count)
        assert not node.is_finished
    assert not node.is_finished
    assert not any(thread.name == 'bag player' for thread in threading.enumerate())


def test_error_while_playing_ends_the_player_as_failed(context, stiffness_bag, capfd):
    def fail(*_, **__):
        raise RuntimeError('the folder went away')

    node = create_node(player(stiffness_bag, start_delay_s=0.0), context)
    with NodeGroup([node], context=context):
        for transition in (node.trigger_configure, node.trigger_activate):
            transition()
            node._bag.messages = fail
        wait_until(lambda: node.is_finished)
        assert node.has_failed
    log = ''.join(capfd.readouterr())
    assert 'Traceback' in log
    assert 'RuntimeError: the folder went away' in log


def test_player_process_exits_with_0_at_the_end_of_the_bag(context, stiffness_bag):
    program = 'import sys; from tactile_bags.nodes.bag_player_node import main; sys.exit(main())'
    parameters = (f'bag:={stiffness_bag}', 'rate:=1000.0', 'start_delay_s:=0.1')
    done = subprocess.run(
        [
            sys.executable,
            '-c',
            program,
            '--ros-args',
            *(word for each in parameters for word in ('-p', each)),
        ],
        env={**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())},
        timeout=DEADLINE_S,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert 'played' in done.stdout + done.stderr
