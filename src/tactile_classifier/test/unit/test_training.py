# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import datetime

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_classifier.training import trainer
from tactile_classifier.training.trainer import train


def test_manifest_states_what_was_trained(small_table):
    score = evaluate(small_table, ['knn'], ['none'], repetitions=2).score('knn', 'none')
    trained = train(small_table, 'knn', score=score)
    manifest = trained.manifest
    assert list(trained.estimator.classes_) == list(manifest.labels)
    assert (manifest.task, manifest.contact) == ('texture', 'flexion')
    assert (manifest.classifier, manifest.scaling, manifest.score_kind) == (
        'knn',
        'none',
        'probability',
    )
    assert manifest.simulated
    assert manifest.trials == 36
    assert manifest.training_sha256 == small_table.compute_sha256()
    assert manifest.cross_validation == {
        'mean': score.mean,
        'spread': score.spread,
        'spread_of': 'repetitions',
        'split': 'stratified 6-fold, 2 times',
    }
    age = datetime.datetime.now(datetime.timezone.utc) - datetime.datetime.fromisoformat(
        manifest.created
    )
    assert age < datetime.timedelta(hours=1)
    assert {'python', 'numpy', 'scikit-learn'} <= set(manifest.versions)


def test_a_label_that_the_model_never_gives_is_told_once(small_table):
    spec, labels = small_table.spec, small_table.labels[1:]
    table = FeatureTable(1e-9 * small_table.values[1:], labels, spec)
    with pytest.warns(UserWarning, match='never answers') as told:
        train(table, 'svm_linear', 'none')
    assert len(told) == 1


def test_contact_is_empty_when_mixed_or_unknown(small_table, stiffness_table):
    manifest = train(stiffness_table, 'tree').manifest
    assert (manifest.contact, manifest.scaling) == ('', 'standard')  # the default of the task
    contact = np.where(np.arange(36) % 2, 'flexion', 'abduction')
    mixed = FeatureTable(
        small_table.values, small_table.labels, small_table.spec, {'contact': contact}
    )
    manifest = train(mixed, 'tree').manifest
    assert (manifest.contact, manifest.simulated) == ('', False)


def test_score_of_another_classifier_is_refused(small_table):
    score = evaluate(small_table, ['knn'], ['standard'], repetitions=1).scores[0]
    with pytest.raises(ValueError, match='the score is of knn with scaling standard'):
        train(small_table, 'knn', 'none', score=score)


def test_too_little_to_train_on(small_table):
    with pytest.raises(DatasetError, match='one class only'):
        train(small_table.take(np.arange(5)), 'knn')
    with pytest.raises(DatasetError, match='three trials'):
        train(small_table.take([0, 20]), 'tree')


def test_only_too_few_trials_are_a_reason_for_no_probabilities(small_table, monkeypatch):
    few = small_table.take(np.arange(36) % 3 == 0)
    stated = train(few, 'knn', false_alarm_rate=0.01).manifest.calibration
    assert stated == {'reason': '12 trials cannot bound false rejection at 0.01; 99 are needed'}

    def fail(*_):
        raise ValueError('a fault')

    monkeypatch.setattr(trainer, 'calibrate_stage', fail)
    with pytest.raises(ValueError, match='a fault'):
        train(small_table, 'knn')
