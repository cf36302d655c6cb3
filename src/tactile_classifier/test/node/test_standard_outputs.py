# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Outputs of the node in messages of others: diagnostics, vision_msgs."""

from functools import partial
import importlib.util

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_classifier.records import Outcome as Answer
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.conversions import feature_window_to_msg
from tactile_features.records import Outcome
from tactile_msgs.msg import TactileFeatures
from tactile_ros.qos import RESULTS
from tactile_testing.waiting import wait_until

HAS_VISION = importlib.util.find_spec('vision_msgs') is not None


@pytest.fixture
def make_node(context, model_path):
    made = []

    def make(**parameters):
        overrides = [
            Parameter(k, value=v) for k, v in {'models': str(model_path), **parameters}.items()
        ]
        made.append(TactileClassifierNode(context=context, parameter_overrides=overrides))
        return made[-1]

    yield make
    for node in made:
        node.take_down()


@pytest.fixture
def peer(context):
    node = Node('peer', context=context)
    yield node
    node.destroy_node()


@pytest.fixture
def spin_until(context):
    def spin(condition, *nodes):
        executor = SingleThreadedExecutor(context=context)
        for node in nodes:
            executor.add_node(node)
        wait_until(condition, step=partial(executor.spin_once, timeout_sec=0.05))
        executor.shutdown()

    return spin


def test_its_model_and_its_counts_are_in_the_diagnostics(make_node, peer, spin_until):
    heard = []
    peer.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 10)
    node = make_node(use_sim_time=True)  # nobody sends a time: diagnostics come all the same
    assert node.bring_up()
    spin_until(lambda: heard, node, peer)
    (status,) = heard[0].status
    assert status.name == 'tactile_classifier'
    assert status.hardware_id == node.answering.models.models[0].model_id
    assert {v.key: v.value for v in status.values}['answers'] == '0'


def test_the_quality_of_its_answers_can_be_overridden(make_node):
    topic = '/tactile_classifier/classification'
    node = make_node(**{f'qos_overrides.{topic}.publisher.depth': 7})
    assert node.bring_up()
    assert node.get_parameter(f'qos_overrides.{topic}.publisher.depth').value == 7
    assert RESULTS.depth == 100


@pytest.mark.skipif(HAS_VISION, reason='vision_msgs is installed')
def test_without_vision_msgs_its_messages_are_refused(make_node):
    assert not make_node(vision_messages=True).bring_up()


@pytest.mark.skipif(not HAS_VISION, reason='vision_msgs is not installed; it is not on PyPI')
def test_answers_are_said_in_the_standard_message_too(make_node, peer, make_window, spin_until):
    from vision_msgs.msg import Classification

    heard = []
    topic = 'tactile_classifier/vision_classification'
    peer.create_subscription(Classification, topic, heard.append, RESULTS)
    features = peer.create_publisher(TactileFeatures, 'tactile_features/features', RESULTS)
    node = make_node(vision_messages=True)
    assert node.bring_up()
    spin_until(
        lambda: features.get_subscription_count() and peer.count_publishers(topic), node, peer
    )
    window = next(  # one that the model does not take for unknown
        window
        for window in map(make_window, range(30))
        if node.answering.models.models[0].classify_window(window).outcome == Answer.LABEL
    )
    features.publish(feature_window_to_msg(window))
    features.publish(
        feature_window_to_msg(make_window(1, outcome=Outcome.GAP, reason='12 samples are missing'))
    )
    spin_until(lambda: len(heard) == 2, node, peer)
    answer = node.answering.models.models[0].classify_window(window)
    scores = {result.class_id: result.score for result in heard[0].results}
    assert heard[0].results[0].class_id == answer.label
    assert scores == dict(zip(answer.labels, answer.scores, strict=True))
    assert heard[0].header.frame_id == answer.frame_id
    assert list(heard[1].results) == []
