# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Outputs of the node in messages of others: diagnostics, vision_msgs."""

import importlib.util

import pytest

from tactile_classifier.records import Outcome as Answer
from tactile_features.records import Outcome
from tactile_ros.qos import RESULTS

HAS_VISION = importlib.util.find_spec('vision_msgs') is not None


def test_its_model_and_its_counts_are_in_the_diagnostics(make_finger):
    finger = make_finger(use_sim_time=True)  # nobody sends a time: diagnostics come all the same
    finger.bring_up()
    finger.spin_until(lambda: finger.diagnostics)
    status = finger.diagnostics[0]
    assert status.hardware_id == finger.answering.models.models[0].model_id
    assert {v.key: v.value for v in status.values}['answers'] == '0'


def test_the_quality_of_its_answers_can_be_overridden(make_finger):
    name = 'qos_overrides./tactile_classifier/classification.publisher.depth'
    node = make_finger(**{name: 7}).classifier
    assert node.bring_up()
    assert node.get_parameter(name).value == 7
    assert RESULTS.depth == 100


@pytest.mark.skipif(HAS_VISION, reason='vision_msgs is installed')
def test_without_vision_msgs_its_messages_are_refused(make_finger):
    assert not make_finger(vision_messages=True).classifier.bring_up()


@pytest.mark.skipif(not HAS_VISION, reason='vision_msgs is not installed; it is not on PyPI')
def test_answers_are_said_in_the_standard_message_too(make_finger, make_window):
    from vision_msgs.msg import Classification

    heard = []
    topic = 'tactile_classifier/vision_classification'
    finger = make_finger(vision_messages=True)
    finger.peer.create_subscription(Classification, topic, heard.append, RESULTS)
    finger.bring_up()
    finger.spin_until(lambda: finger.peer.count_publishers(topic))
    model = finger.answering.models.models[0]
    window, answer = next(  # one that the model does not take for unknown
        (window, answer)
        for window in map(make_window, range(30))
        if (answer := model.classify_window(window)).outcome == Answer.LABEL
    )
    finger.send(window, make_window(1, outcome=Outcome.GAP, reason='12 samples are missing'))
    finger.spin_until(lambda: len(heard) == 2)
    scores = {result.class_id: result.score for result in heard[0].results}
    assert heard[0].results[0].class_id == answer.label
    assert scores == dict(zip(answer.labels, answer.scores, strict=True))
    assert heard[0].header.frame_id == answer.frame_id
    assert list(heard[1].results) == []
