# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A feature node that computes other features than the model needs: the classifier says so."""

from diagnostic_msgs.msg import DiagnosticStatus
from finger_nodes import make_header, PERIOD_NS
import numpy as np
import pytest

from tactile_classifier.records import Outcome
from tactile_msgs.msg import StrainBlock, TrialEvent


def glide(finger):
    """Play a trial; return the answer."""
    tension_n = np.random.default_rng(0).normal(3.0, 0.1, 600).tolist()
    finger.strain.publish(
        StrainBlock(header=make_header(0.0), period_ns=PERIOD_NS, tension_n=tension_n)
    )
    facts = {'trial_id': 't1', 'protocol': 'texture', 'contact': 'flexion'}
    for time_s, phase in ((1.0, 'glide'), (7.0, 'done')):
        finger.events.publish(TrialEvent(header=make_header(time_s), phase=phase, **facts))
    finger.spin_until(lambda: finger.heard)
    return finger.answers[0]


@pytest.mark.parametrize('has_models', [False, True])
def test_equal_parameters_or_the_same_models_are_answered(make_finger, model_path, has_models):
    models = {'models': str(model_path), 'texture_crop_start_s': 0.9}
    finger = make_finger(models if has_models else {})
    finger.bring_up()
    assert glide(finger).outcome in (Outcome.LABEL, Outcome.UNKNOWN)
    assert finger.answering.refused_count == 0


def test_a_parameter_of_the_feature_node_alone_is_noticed(make_finger, model_path, capfd):
    difference = '(texture_crop_start_s) differs: 0.6 here, 0.9 there'
    finger = make_finger({'texture_crop_start_s': 0.9})
    finger.bring_up()
    log = capfd.readouterr().err
    assert 'announces no features that model texture-flexion-svm_linear' in log
    assert f'give its parameter models {model_path}' in log
    answer = glide(finger)
    assert (answer.outcome, answer.label) == (Outcome.NO_FEATURES, '')
    assert difference in answer.reason
    assert 'name its file in the parameter models of the feature node' in answer.reason
    assert finger.answering.refused_count == 1
    finger.spin_until(
        lambda: finger.diagnostics and finger.diagnostics[-1].level == DiagnosticStatus.WARN
    )
    status = finger.diagnostics[-1]
    values = {pair.key: pair.value for pair in status.values}
    assert values['windows of another specification'] == '1'
    assert difference in status.message
