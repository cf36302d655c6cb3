# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every node keeps running after invalid messages, and a replay ignores these messages."""

import dataclasses

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.node import Node

from tactile_bags import TactileBag
from tactile_bags.audit import audit_bag
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import compare, replay_through_core
from tactile_bringup.launch_config.graph import (
    CLASSIFIER_NODE,
    ModelChoice,
    recorder_node,
    sensing_graph,
)
from tactile_bringup.nodes.graph_runner import create_node
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_lab.replay_nodes import replay_through_nodes
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.topics import STRAIN
from tactile_testing.waiting import wait_until


def test_nodes_refuse_invalid_messages_and_continue(context, trained, tmp_path):
    graph = [
        node
        for node in sensing_graph('', ModelChoice.read(trained), {})
        if node.name != 'tendon_sensor'
    ]
    graph.append(recorder_node(tmp_path / 'bag', rig=False))
    peer = Node('peer', context=context)
    strain = peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    events = peer.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
    features = peer.create_publisher(TactileFeatures, 'tactile_features/features', RESULTS)
    reasons = {}

    def take(message):
        for status in message.status:
            for pair in status.values:
                if pair.key == 'last_refused_message':
                    reasons[status.name] = pair.value

    peer.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    # The nodes communicate over topics, as in separate processes.
    nodes = {d.name: create_node(d, context) for d in graph}
    assert all(node.bring_up() for node in nodes.values())
    with NodeGroup([peer, *nodes.values()], context=context):
        listeners = ('tactile_features', 'bag_recorder')
        wait_until(lambda: strain.get_subscription_count() == events.get_subscription_count() == 2)
        wait_until(lambda: features.get_subscription_count() == 2)
        # Publish only after every subscriber has discovered the publishers of its topic.
        wanted = {'/tendon_sensor/strain': 1, '/trial_runner/events': 1}
        wanted['/tactile_features/features'] = 2
        readers = [s for node in nodes.values() for s in (*node._polled, *node.subscriptions)]
        wait_until(
            lambda: all(s.get_publisher_count() >= wanted.get(s.topic_name, 0) for s in readers)
        )
        strain.publish(StrainBlock(period_ns=-1, tension_n=[1.0]))
        strain.publish(StrainBlock(period_ns=1, tension_n=[]))
        strain.publish(StrainBlock(period_ns=1, tension_n=[1.0], status=2**31))
        events.publish(TrialEvent(trial_id='a', phase='dance'))
        features.publish(TactileFeatures(outcome=9))
        for name in listeners:
            wait_until(lambda name=name: nodes[name].message_guard.refused.count == 4)
        wait_until(lambda: nodes[CLASSIFIER_NODE].message_guard.refused.count == 1)
        wait_until(lambda: reasons.keys() == {*listeners, CLASSIFIER_NODE})
        assert 'outcome is 9' in reasons[CLASSIFIER_NODE]
        assert 'cannot be audited' in reasons['bag_recorder']
        # All nodes continue to work.
        strain.publish(StrainBlock(period_ns=1, tension_n=[1.0]))
        (model,) = nodes[CLASSIFIER_NODE].models.models
        window = {'feature_set': model.spec.feature_set, 'specification_digest': model.spec.digest}
        features.publish(TactileFeatures(outcome=1, **window))
        wait_until(lambda: nodes['tactile_features'].extractor.block_count == 1)
        wait_until(lambda: nodes[CLASSIFIER_NODE].models.counts['answers'] == 1)
        # The recorder has recorded four blocks, one event and two feature windows.
        wait_until(lambda: nodes['bag_recorder'].message_count >= 7)


def test_operator_continues_to_wait_after_an_invalid_message(context):
    operator, peer = OperatorNode(context, answers=True), Node('peer', context=context)
    answers = peer.create_publisher(Classification, f'{CLASSIFIER_NODE}/classification', RESULTS)
    with NodeGroup([operator], context=context) as group, NodeGroup([peer], context=context):
        wait_until(answers.get_subscription_count)
        (reader,) = [s for s in operator.subscriptions if s.topic_name == answers.topic_name]
        wait_until(reader.get_publisher_count)
        answers.publish(Classification(trial_id='a', outcome=9))
        answers.publish(Classification(trial_id='a', outcome=1, scores=[1.0]))
        answers.publish(Classification(trial_id='a', outcome=1))
        (answer,) = operator.wait_for_answers('a', [''])
        assert answer.scores == ()
        assert not group.ended.is_set()


def test_replay_omits_messages_that_the_nodes_refuse(stiffness_bag, rewrite, context, tmp_path):
    count = 0

    def spoil(type_name, message):
        nonlocal count
        count += type_name == STRAIN
        if type_name == STRAIN and count % 50 == 0:
            return dataclasses.replace(message, status=np.uint32(2**31))
        return message

    path = rewrite(stiffness_bag, tmp_path / 'spoiled', spoil)
    with TactileBag(path) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, None, features)
        try:
            nodes = replay_through_nodes(bag, None, features.config, context, expected=core)
        except TactileError as error:
            pytest.fail(str(error))
    comparison = compare(core, nodes, ('the core', 'the nodes'))
    assert comparison.is_equal, comparison.first_difference
    assert any(not audit.passed for audit in audit_bag(path))
