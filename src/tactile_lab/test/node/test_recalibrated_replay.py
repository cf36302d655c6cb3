# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Models that known trials correct while they run: recorded and replayed, bit for bit."""

from collections import Counter

import numpy as np
import pytest
from rclpy.serialization import serialize_message

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_bags import CLASSIFICATION_TOPIC, FEATURES_TOPIC, MODELS_TOPIC, TactileBag
from tactile_bags.bag_writer import BagWriter
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.recorded_topics import RecordedTopic
from tactile_bags.replay import replay_through_core
from tactile_bringup.nodes.replay_nodes import replay_through_nodes
from tactile_classifier import ModelInfos, ModelSet
from tactile_classifier.conversions import classification_to_msg, model_infos_to_msg
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.conversions import feature_window_to_msg
from tactile_lab.commands.replay import replay_and_compare
from tactile_lab.commands.train import model_path
from tactile_lab.datasets.feature_tables import read_tables

TRIALS = 6
NOISE = 1.0


@pytest.fixture(scope='module')
def models(tmp_path_factory, simulate_bag):
    bag = simulate_bag('stiffness', 'flexion', 4, seed=3, sessions=4)
    folder = tmp_path_factory.mktemp('models')
    for key, table in read_tables([bag]).tables.items():
        write_model(model_path(folder, *key), train(table, 'knn'))
    return folder


def record_answers(source, path, results, infos=()):
    """Write a copy of a bag with what nodes made of it, as a recorder beside them does."""
    with TactileBag(source) as bag, BagWriter(path, bag.metadata) as writer:
        for name, (type_name, _) in bag.topics.items():
            writer.add_topic(RecordedTopic(name.strip('/'), type_name))
        for message in bag.messages():
            writer.write_raw(message.topic, message.received_at_ns, message.data)
        features, answers = map(writer.add_topic, (FEATURES_TOPIC, CLASSIFICATION_TOPIC))
        message = serialize_message(model_infos_to_msg(ModelInfos(tuple(infos))))
        writer.write_raw(writer.add_topic(MODELS_TOPIC), bag.end_ns, message)
        for window in results.windows:
            data = serialize_message(feature_window_to_msg(window))
            writer.write_raw(features, window.window_end_ns, data)
        for answer in results.classifications:
            data = serialize_message(classification_to_msg(answer))
            writer.write_raw(answers, answer.window_end_ns, data)
    return path


def test_known_trials_correct_the_nodes_and_the_replay_alike(
    models, simulate_bag, tmp_path, context
):
    before = (models / 'stiffness_flexion.onnx').read_bytes()
    source = simulate_bag('stiffness', 'flexion', 2, seed=11, sessions=2)
    with TactileBag(source) as bag:
        features = recorded_features(bag)
        loaded = ModelSet.load(models, recalibration_trials=TRIALS)
        core = replay_through_core(bag, loaded, features)
        nodes = replay_through_nodes(
            bag, models, features.config, context, expected=core, recalibration_trials=TRIALS
        )
    # Each of the two sessions begins with the model as trained.
    counts = [answer.recalibration_trials for answer in nodes.classifications]
    assert counts == 2 * (TRIALS * [0] + 4 * [TRIALS])
    thresholds = Counter(answer.novelty_threshold for answer in nodes.classifications)
    assert sorted(thresholds.values()) == [4, 4, 2 * TRIALS]
    (report,) = replay_and_compare(
        record_answers(source, tmp_path / 'live', nodes), models, through_nodes=False
    )
    assert report.is_equal, report.comparisons
    assert all(c.classification_count == 20 for c in report.comparisons.values())
    assert (models / 'stiffness_flexion.onnx').read_bytes() == before
    with TactileBag(source) as bag:  # else there was nothing to repeat
        untouched = replay_through_core(bag, ModelSet.load(models), features)
    pairs = zip(untouched.classifications, nodes.classifications, strict=True)
    changed = [one.novelty != other.novelty for one, other in pairs]
    assert changed == 2 * (TRIALS * [False] + 4 * [True])


def test_a_replay_answers_windows_of_the_contact_that_the_node_answered(stiffness_bag, tmp_path):
    """A model of any contact, in a node that takes one of them."""
    (table,) = read_tables([stiffness_bag]).tables.values()
    contacts = np.where(np.arange(len(table)) % 2, 'flexion', 'abduction')
    mixed = FeatureTable(
        table.values, table.labels, table.spec, {**table.columns, 'contact': contacts}
    )
    model = tmp_path / 'any.onnx'
    write_model(model, train(mixed, 'knn'))
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        taken = replay_through_core(bag, ModelSet.load(model), features)
        passed_over = replay_through_core(bag, ModelSet.load(model, 'abduction'), features)
    assert (len(taken.classifications), len(passed_over.classifications)) == (15, 0)
    infos = ModelSet.load(model, 'abduction').infos
    recorded = record_answers(stiffness_bag, tmp_path / 'live', passed_over, infos)
    (report,) = replay_and_compare(recorded, None, through_nodes=True)
    assert report.is_equal, report.comparisons


def test_raw_scores_are_the_same_live_and_replayed(simulate_bag, tmp_path, context):
    """A model of too few trials to calibrate: margins in nodes, core and replay, bit for bit."""
    (tmp_path / 'models').mkdir()
    training = simulate_bag('stiffness', 'flexion', 3, seed=3)
    ((key, table),) = read_tables([training]).tables.items()
    few = train(table, 'svm_linear', false_alarm_rate=0.01)
    model = write_model(model_path(tmp_path / 'models', *key), few)
    assert 'reason' in model.manifest.calibration
    source = simulate_bag('stiffness', 'flexion', 2, seed=11)
    with TactileBag(source) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, ModelSet.load(tmp_path / 'models'), features)
        nodes = replay_through_nodes(
            bag, tmp_path / 'models', features.config, context, expected=core
        )
    assert len(nodes.classifications) == 10
    for answer, window in zip(nodes.classifications, nodes.windows, strict=True):
        assert answer.score_kind == 'margin'
        assert answer.scores == tuple(model.compute(window.values[np.newaxis]).scores[0].tolist())
    (report,) = replay_and_compare(
        record_answers(source, tmp_path / 'live', nodes), tmp_path / 'models', through_nodes=False
    )
    assert report.is_equal, report.comparisons
