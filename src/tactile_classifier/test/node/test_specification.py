# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A feature node that computes other features than the model needs: the classifier says so."""

from functools import partial

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from tactile_classifier.conversions import classification_from_msg
from tactile_classifier.records import Outcome
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import Classification, StrainBlock, TrialEvent
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_testing.waiting import wait_until

PERIOD_NS = 16_666_667
START_NS = 1_760_000_000_000_000_000


def header(time_s):
    stamp_ns = START_NS + round(time_s * 1e9)
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))


class Finger:
    """Both nodes, and a peer that plays sensor and trial runner and listens."""

    def __init__(self, context, model_path, **feature_parameters):
        overrides = [Parameter(name, value=value) for name, value in feature_parameters.items()]
        self.features = TactileFeaturesNode(context=context, parameter_overrides=overrides)
        self.classifier = TactileClassifierNode(
            context=context, parameter_overrides=[Parameter('models', value=str(model_path))]
        )
        self.peer = Node('peer', context=context)
        self.strain = self.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self.events = self.peer.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
        self.answers, self.diagnostics = [], []
        self.peer.create_subscription(
            Classification, 'tactile_classifier/classification', self.answers.append, RESULTS
        )
        self.peer.create_subscription(DiagnosticArray, '/diagnostics', self._diagnose, 10)
        self.executor = SingleThreadedExecutor(context=context)
        for node in (self.features, self.classifier, self.peer):
            self.executor.add_node(node)

    def _diagnose(self, message):
        self.diagnostics += [s for s in message.status if s.name == 'tactile_classifier']

    def spin_until(self, condition):
        wait_until(condition, step=partial(self.executor.spin_once, timeout_sec=0.05))

    def bring_up(self):
        assert self.features.bring_up()
        assert self.classifier.bring_up()
        self.spin_until(
            lambda: self.strain.get_subscription_count()
            and self.events.get_subscription_count()
            and self.classifier.count_publishers('tactile_features/features')
            and self.features.count_subscribers('tactile_features/features')
            and self.peer.count_publishers('tactile_classifier/classification')
            and self.classifier.answering.is_told
        )

    def glide(self):
        """Play a trial; return the answer."""
        tension_n = np.random.default_rng(0).normal(3.0, 0.1, 600).tolist()
        self.strain.publish(
            StrainBlock(header=header(0.0), period_ns=PERIOD_NS, tension_n=tension_n)
        )
        for time_s, phase in ((1.0, 'glide'), (7.0, 'done')):
            self.events.publish(
                TrialEvent(
                    header=header(time_s),
                    trial_id='t1',
                    protocol='texture',
                    contact='flexion',
                    phase=phase,
                )
            )
        self.spin_until(lambda: self.answers)
        return classification_from_msg(self.answers[0])

    def close(self):
        self.executor.shutdown()
        for node in (self.classifier, self.features):
            node.take_down()
        self.peer.destroy_node()


@pytest.fixture
def make_finger(context, model_path):
    fingers = []

    def make(**parameters):
        fingers.append(Finger(context, model_path, **parameters))
        fingers[-1].bring_up()
        return fingers[-1]

    yield make
    for finger in fingers:
        finger.close()


def test_equal_parameters_are_answered(make_finger):
    finger = make_finger()
    assert finger.glide().outcome in (Outcome.LABEL, Outcome.UNKNOWN)
    assert finger.classifier.answering.refused_count == 0


@pytest.mark.parametrize(
    ('parameters', 'difference'),
    [
        ({'texture_crop_start_s': 0.9}, '(texture_crop_start_s) differs: 0.6 here, 0.9 there'),
        ({'max_gap_samples': 3}, '(max_gap_samples) differs: 0.0 here, 3.0 there'),
    ],
    ids=str,
)
def test_a_parameter_of_the_feature_node_alone_is_noticed(
    make_finger, model_path, parameters, difference, capfd
):
    finger = make_finger(**parameters)
    log = capfd.readouterr().err
    assert 'announces no features that model texture-flexion-svm_linear' in log
    assert f'give its parameter models {model_path}' in log
    answer = finger.glide()
    assert (answer.outcome, answer.label) == (Outcome.NO_FEATURES, '')
    assert difference in answer.reason
    assert 'name its file in the parameter models of the feature node' in answer.reason
    assert finger.classifier.answering.refused_count == 1
    finger.spin_until(
        lambda: finger.diagnostics and finger.diagnostics[-1].level == DiagnosticStatus.WARN
    )
    status = finger.diagnostics[-1]
    values = {pair.key: pair.value for pair in status.values}
    assert values['windows of another specification'] == '1'
    assert difference in status.message


def test_a_feature_node_with_the_same_models_needs_no_parameters(make_finger, model_path):
    finger = make_finger(models=str(model_path), texture_crop_start_s=0.9)
    assert finger.glide().outcome in (Outcome.LABEL, Outcome.UNKNOWN)
    assert finger.classifier.answering.refused_count == 0
