# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A replay through nodes computes the same results as a replay without ROS, and as recorded."""

import dataclasses

import numpy as np
from rclpy.serialization import serialize_message

from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bags import TactileBag
from tactile_bags.bag_writer import BagWriter
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import compare, replay_through_core
from tactile_classifier import ModelInfos, ModelSet
from tactile_classifier.conversions import classification_to_msg, model_infos_to_msg
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.conversions import feature_window_to_msg
from tactile_lab.commands.replay import replay_and_compare
from tactile_lab.replay_nodes import replay_through_nodes
from tactile_ros.topics import CLASSIFICATION_TOPIC, FEATURES_TOPIC, MODELS_TOPIC


def train_model(bag, path, classifier='knn', change=lambda table: table, **options):
    (table,) = read_tables([bag]).values()
    return write_model(path, train(change(table), classifier, **options))


def of_any_contact(table):
    contacts = np.where(np.arange(len(table)) % 2, 'flexion', 'abduction')
    return dataclasses.replace(table, columns={**table.columns, 'contact': contacts})


def replayed(source, path, results, infos=(), *, models=None, through_nodes=False):
    """Copy a bag, add ``results`` as if nodes had published them, and replay the copy."""
    with TactileBag(source) as bag, BagWriter(path, bag.metadata) as writer:
        for topic in bag.stored_topics:
            writer.add_stored_topic(topic)
        for message in bag.messages():
            writer.write_raw(message.topic, message.received_at_ns, message.data)

        def write(topic, items):
            name = writer.add_topic(topic)
            for at_ns, message in items:
                writer.write_raw(name, at_ns, serialize_message(message))

        write(MODELS_TOPIC, [(bag.end_ns, model_infos_to_msg(ModelInfos(tuple(infos))))])
        write(
            FEATURES_TOPIC, [(w.window_end_ns, feature_window_to_msg(w)) for w in results.windows]
        )
        answers = [(a.window_end_ns, classification_to_msg(a)) for a in results.classifications]
        write(CLASSIFICATION_TOPIC, answers)
    (report,) = replay_and_compare(path, models, through_nodes=through_nodes)
    assert report.is_equal, report.comparisons
    return report


def test_windows_are_determined_by_the_model_not_by_the_parameters(
    stiffness_bag, trained, context
):
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, ModelSet.load(trained), features)
        other = dataclasses.replace(features.config, stiffness_settle_s=1.0)
        nodes = replay_through_nodes(bag, trained, other, context, expected=core)
    comparison = compare(core, nodes, ('the core', 'the nodes'))
    assert comparison.is_equal, comparison.first_difference
    assert comparison.window_count == comparison.classification_count == 15


def test_replay_classifies_only_windows_of_the_contact_of_the_node(stiffness_bag, tmp_path):
    """The model is trained on both contacts; the node is set to classify only one of them."""
    model = tmp_path / 'any.npz'
    train_model(stiffness_bag, model, change=of_any_contact)
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        taken = replay_through_core(bag, ModelSet.load(model), features)
        passed_over = replay_through_core(bag, ModelSet.load(model, 'abduction'), features)
    assert (len(taken.classifications), len(passed_over.classifications)) == (15, 0)
    infos = ModelSet.load(model, 'abduction').infos
    replayed(stiffness_bag, tmp_path / 'live', passed_over, infos, through_nodes=True)


def test_raw_scores_are_the_same_live_and_replayed(stiffness_bag, tmp_path, context):
    """The scores are margins, because there are too few trials to calibrate probabilities."""
    path = tmp_path / 'raw.npz'
    model = train_model(stiffness_bag, path, 'svm_linear', false_alarm_rate=0.01)
    assert 'reason' in model.manifest.calibration
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, ModelSet.load(path), features)
        nodes = replay_through_nodes(bag, path, features.config, context, expected=core)
    assert len(nodes.classifications) == 15
    for answer, window in zip(nodes.classifications, nodes.windows, strict=True):
        assert answer.score_kind == 'margin'
        assert answer.scores == tuple(model.compute(window.values[np.newaxis]).scores[0].tolist())
    replayed(stiffness_bag, tmp_path / 'live', nodes, models=path)
