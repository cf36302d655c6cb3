# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import time

from rclpy.node import Node
from rclpy.serialization import serialize_message
from tactile_msgs.msg import StrainBlock, TrialEvent

from tactile_bringup.bags import EVENT, STRAIN, TactileBag
from tactile_bringup.graph import recorder_node
from tactile_bringup.graph_runner import create_node, running_graph
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, STREAM

DEADLINE_S = 10.0


def wait_until(condition):
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, 'condition not met in time'
        time.sleep(0.005)


def test_recording_holds_the_very_bytes_that_were_sent(context, tmp_path):
    source = Node('source', context=context, namespace='thumb')
    strain = source.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    events = source.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
    early = TrialEvent(trial_id='a', phase='approach')
    events.publish(early)  # latched: sent before the recorder is there
    blocks = [
        serialize_message(
            StrainBlock(sequence=i, period_ns=16_666_667, tension_n=[0.1 * i, -1e-300])
        )
        for i in range(200)
    ]
    path = tmp_path / 'bag'
    graph = [recorder_node(path, None, ('c',), {}, namespaces=('thumb',), simulated=False)]
    with running_graph(graph, context, others=[source]) as nodes:
        recorder = nodes['bag_recorder']
        missing = '/thumb/tactile_features/features'
        wait_until(lambda: strain.get_subscription_count() == 1)
        assert missing in recorder.unmatched_topics()
        assert '/thumb/tendon_sensor/strain' not in recorder.unmatched_topics()
        for block in blocks:
            strain.publish(block)
        wait_until(lambda: recorder.message_count == 201)
    with TactileBag(path) as bag:
        assert bag.facts['simulated'] is False
        assert bag.namespaces == ('thumb',)
        assert [m.data for m in bag.messages(STRAIN)] == blocks
        assert [m.decode().trial_id for m in bag.messages(EVENT)] == ['a']


def test_latched_event_is_recorded_also_when_activated_late(context, tmp_path):
    source = Node('source', context=context)
    events = source.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
    events.publish(TrialEvent(trial_id='early', phase='approach'))
    path = tmp_path / 'bag'
    recorder = create_node(recorder_node(path, None, (), {}, simulated=False), context)
    recorder.trigger_configure()
    with NodeGroup([source, recorder], context=context):
        wait_until(lambda: '/trial_runner/events' not in recorder.unmatched_topics())
        assert recorder.message_count == 0
        recorder.trigger_activate()
        wait_until(lambda: recorder.message_count == 1)
        recorder.trigger_deactivate()
        events.publish(TrialEvent(trial_id='late', phase='done'))
        recorder.trigger_activate()
        wait_until(lambda: recorder.message_count >= 2)
