# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node over real DDS: features in, classifications out."""

from functools import partial

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_classifier.answering import LiveRecalibration
from tactile_classifier.conversions import classification_from_msg
from tactile_classifier.model_file.model import load_model
from tactile_classifier.records import Outcome
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.conversions import feature_window_to_msg
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.records import Outcome as FeatureOutcome
from tactile_msgs.msg import Classification, TactileFeatures
from tactile_ros.qos import RESULTS
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


class Graph:
    """The node under test beside one that sends features and collects answers."""

    def __init__(self, context, parameters):
        overrides = [Parameter(k, value=v) for k, v in parameters.items()]
        self.node = TactileClassifierNode(
            context=context, namespace='/finger', parameter_overrides=overrides
        )
        self.peer = Node('peer', context=context, namespace='/finger')
        self.answers = []
        self.peer.create_subscription(
            Classification, 'tactile_classifier/classification', self.answers.append, RESULTS
        )
        self.features = self.peer.create_publisher(
            TactileFeatures, 'tactile_features/features', RESULTS
        )
        self.executor = SingleThreadedExecutor(context=context)
        for node in (self.node, self.peer):
            self.executor.add_node(node)

    def spin_until(self, condition, what):
        step = partial(self.executor.spin_once, timeout_sec=0.05)
        wait_until(condition, f'{what} took too long', step=step)

    def connect(self):
        self.spin_until(
            lambda: (
                self.features.get_subscription_count()
                and self.peer.count_publishers('tactile_classifier/classification')
            ),
            'discovery',
        )

    def listen_partial(self):
        self.partial_answers = []
        self.peer.create_subscription(
            Classification,
            'tactile_classifier/partial_classification',
            self.partial_answers.append,
            RESULTS,
        )
        self.partial_features = self.peer.create_publisher(
            TactileFeatures, 'tactile_features/partial_features', RESULTS
        )
        self.connect()
        self.spin_until(
            lambda: (
                self.partial_features.get_subscription_count()
                and self.peer.count_publishers('tactile_classifier/partial_classification')
            ),
            'discovery',
        )

    def close(self):
        self.executor.shutdown()
        self.node.take_down()
        self.peer.destroy_node()


@pytest.fixture
def make_graph(context):
    graphs = []

    def make(**parameters):
        graphs.append(Graph(context, parameters))
        return graphs[-1]

    yield make
    for graph in graphs:
        graph.close()


def test_windows_are_classified_over_the_wire(make_graph, model_path, make_window):
    graph = make_graph(models=str(model_path), contact='flexion')
    assert graph.node.bring_up()
    graph.connect()
    windows = [
        make_window(0),
        make_window(20, contact='abduction'),
        make_window(0, feature_set='stiffness_regression'),
        make_window(3, rate_hz=100.0),
        make_window(4, outcome=FeatureOutcome.GAP, reason='12 samples are missing'),
        make_window(30),
    ]
    for window in windows:
        graph.features.publish(feature_window_to_msg(window))
    graph.spin_until(lambda: graph.node.answering.seen_count == 6, 'the windows')
    graph.spin_until(lambda: len(graph.answers) == 4, 'the answers')
    answers = [classification_from_msg(message) for message in graph.answers]
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
    assert (graph.node.answering.ignored_count, graph.node.answering.published_count) == (2, 4)
    assert graph.node.answering.models.models[0].model_id == model.model_id


def test_samples_alone_are_answered_as_the_node_answers_their_window(
    make_graph, model_path, make_window
):
    graph = make_graph(models=str(model_path))
    assert graph.node.bring_up()
    graph.connect()
    rng = np.random.default_rng(4)
    windows = rng.normal(3.0, 0.1, (2, 180))
    windows[1, 90] = 4.0
    for values in features_from_trials('texture', windows, 60.0)[0]:
        graph.features.publish(feature_window_to_msg(make_window(values=values)))
    graph.spin_until(lambda: len(graph.answers) == 2, 'the answers')
    model = load_model(model_path)
    for samples, message in zip(windows, graph.answers, strict=True):
        answer = model.classify(samples, 60)
        live = classification_from_msg(message)
        assert tuple(answer.scores.values()) == live.scores
        assert (answer.novelty, answer.reason) == (live.novelty, live.reason)
        assert answer.label == (live.label or 'unknown')


def test_partial_windows_are_answered_on_a_topic_of_their_own(
    make_graph, partial_tables, tmp_path, make_window, capfd
):
    table, partial = partial_tables
    path = tmp_path / 'partial.onnx'
    model = write_model(path, train(table, 'knn', partial=partial))
    graph = make_graph(models=str(path))
    assert graph.node.bring_up()
    graph.listen_partial()
    windows = [
        make_window(values=partial.get(count, table).values[0], partial=True, sample_count=count)
        for count in (60, 90, 120)
    ]
    for window in windows:
        graph.partial_features.publish(feature_window_to_msg(window))
    graph.features.publish(feature_window_to_msg(make_window(values=table.values[0])))
    graph.spin_until(lambda: graph.answers and len(graph.partial_answers) == 2, 'the answers')
    answers = [classification_from_msg(message) for message in graph.partial_answers]
    assert answers == [model.classify_window(windows[0]), model.classify_window(windows[2])]
    assert all(answer.partial and answer.decided for answer in answers)
    assert not classification_from_msg(graph.answers[0]).partial
    assert graph.node.answering.partial_count == 2
    log = capfd.readouterr().err
    assert log.count('plate 0 after') == 1  # the first decided answer alone


def test_nothing_is_answered_while_inactive(make_graph, model_path, make_window):
    graph = make_graph(models=str(model_path))
    graph.node.trigger_configure()
    graph.connect()
    graph.features.publish(feature_window_to_msg(make_window(0)))
    for _ in range(5):
        graph.executor.spin_once(timeout_sec=0.1)
    graph.node.trigger_activate()
    graph.features.publish(feature_window_to_msg(make_window(30)))
    graph.spin_until(lambda: graph.answers, 'the answer')
    assert [a.trial_id for a in graph.answers] == ['trial-30']
    assert graph.node.answering.seen_count == 1


def test_node_can_be_cleaned_up_and_configured_again(make_graph, model_path, make_window):
    graph = make_graph(models=str(model_path))
    assert graph.node.bring_up()
    graph.node.trigger_deactivate()
    graph.node.trigger_cleanup()
    assert graph.node.bring_up()
    graph.connect()
    graph.features.publish(feature_window_to_msg(make_window(0)))
    graph.spin_until(lambda: graph.answers, 'the answer')


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'models': ''}, 'the parameter models is empty'),
        ({'models': '/nowhere/m.onnx'}, 'cannot read model /nowhere/m.onnx'),
        ({'contact': 'abduction'}, 'are for flexion, the parameter contact is abduction'),
    ],
    ids=str,
)
def test_without_a_usable_model_it_is_not_configured_and_says_why(
    make_graph, model_path, changes, sentence, capfd
):
    graph = make_graph(**{'models': str(model_path), **changes})
    assert not graph.node.bring_up()
    assert sentence in capfd.readouterr().err
    graph.node.set_parameters(
        [Parameter('models', value=str(model_path)), Parameter('contact', value='flexion')]
    )
    assert graph.node.bring_up()


def test_known_trials_recalibrate_the_answers_of_a_session(make_graph, model_path, make_window):
    graph = make_graph(models=str(model_path), contact='flexion', recalibration_trials=5)
    assert graph.node.bring_up()
    graph.connect()
    live = LiveRecalibration(load_model(model_path), 5)
    labels = 12 * ['plate 0'] + 12 * ['plate 1'] + 12 * ['plate 2']
    windows = [
        make_window(trial, session_id=session, object_label=labels[trial])
        for session in ('monday', 'tuesday')
        for trial in (0, 12, 24, 3, 15, 27, 6)
    ]
    for window in windows:
        graph.features.publish(feature_window_to_msg(window))
    graph.spin_until(lambda: len(graph.answers) == len(windows), 'the answers')
    answers = [classification_from_msg(message) for message in graph.answers]
    assert answers == [live.classify(window) for window in windows]
    assert [answer.recalibration_trials for answer in answers] == 2 * [0, 0, 0, 0, 0, 5, 5]


def test_a_node_refuses_too_few_known_trials_and_says_so(make_graph, model_path, capfd):
    graph = make_graph(models=str(model_path), recalibration_trials=3)
    assert not graph.node.bring_up()
    assert 'recalibration_trials is 3; it must be 0 or at least 5' in capfd.readouterr().err
