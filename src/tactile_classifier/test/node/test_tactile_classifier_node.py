# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node over real DDS: features in, classifications out."""

import pytest
from rclpy.parameter import Parameter

from tactile_classifier.model_file.model import load_model
from tactile_classifier.records import Outcome
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.records import Outcome as FeatureOutcome


def test_windows_are_classified_over_the_wire(make_finger, model_path, make_window):
    finger = make_finger(contact='flexion')
    finger.bring_up()
    windows = [
        make_window(0),
        make_window(20, contact='abduction'),
        make_window(0, feature_set='stiffness_regression'),
        make_window(3, rate_hz=100.0),
        make_window(4, outcome=FeatureOutcome.GAP, reason='12 samples are missing'),
        make_window(30),
    ]
    finger.send(*windows)
    finger.spin_until(lambda: finger.answering.seen_count == 6 and len(finger.heard) == 4)
    answers = finger.answers
    model = load_model(model_path)
    assert answers == [model.classify_window(windows[i]) for i in (0, 3, 4, 5)]
    assert [a.outcome for a in answers] == [
        Outcome.LABEL,
        Outcome.NO_FEATURES,
        Outcome.NO_FEATURES,
        Outcome.LABEL,
    ]
    assert [a.label for a in answers] == ['plate 0', '', '', 'plate 2']
    assert 'rate in Hz is 100.0' in answers[1].reason
    assert (finger.answering.ignored_count, finger.answering.published_count) == (2, 4)
    assert finger.answering.models.models[0].model_id == model.model_id


def test_partial_windows_are_answered_on_a_topic_of_their_own(
    make_finger, partial_tables, tmp_path, make_window, capfd
):
    table, partial = partial_tables
    path = tmp_path / 'partial.onnx'
    model = write_model(path, train(table, 'knn', partial=partial))
    finger = make_finger(models=str(path))
    finger.bring_up()
    windows = [
        make_window(values=partial.get(count, table).values[0], partial=True, sample_count=count)
        for count in (60, 90, 120)
    ]
    finger.send(*windows, make_window(values=table.values[0]))
    finger.spin_until(lambda: finger.heard and len(finger.heard_partial) == 2)
    answers = finger.partial_answers
    assert answers == [model.classify_window(windows[0]), model.classify_window(windows[2])]
    assert all(answer.partial and answer.decided for answer in answers)
    assert not finger.answers[0].partial
    assert finger.answering.partial_count == 2
    log = capfd.readouterr().err
    assert log.count('plate 0 after') == 1  # the first decided answer alone


def test_nothing_is_answered_while_inactive(make_finger, make_window):
    finger = make_finger()
    finger.classifier.trigger_configure()
    finger.connect()
    finger.send(make_window(0))
    for _ in range(5):
        finger.executor.spin_once(timeout_sec=0.1)
    finger.classifier.trigger_activate()
    finger.send(make_window(30))
    finger.spin_until(lambda: finger.heard)
    assert [a.trial_id for a in finger.answers] == ['trial-30']
    assert finger.answering.seen_count == 1


def test_node_can_be_cleaned_up_and_configured_again(make_finger, make_window):
    finger = make_finger()
    finger.bring_up()
    finger.classifier.trigger_deactivate()
    finger.classifier.trigger_cleanup()
    finger.bring_up()
    finger.send(make_window(0))
    finger.spin_until(lambda: finger.heard)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'models': ''}, 'the parameter models is empty'),
        ({'models': '/nowhere/m.onnx'}, 'cannot read model /nowhere/m.onnx'),
        ({'contact': 'abduction'}, 'are for flexion, the parameter contact is abduction'),
        ({'recalibration_trials': 3}, 'recalibration_trials is 3; it must be 0 or at least 5'),
    ],
    ids=str,
)
def test_without_a_usable_model_it_is_not_configured_and_says_why(
    make_finger, model_path, changes, sentence, capfd
):
    node = make_finger(**changes).classifier
    assert not node.bring_up()
    assert sentence in capfd.readouterr().err
    mended = {'models': str(model_path), 'contact': 'flexion', 'recalibration_trials': 5}
    node.set_parameters([Parameter(name, value=value) for name, value in mended.items()])
    assert node.bring_up()
    assert node.answering.models.infos[0].recalibration_trials == 5
