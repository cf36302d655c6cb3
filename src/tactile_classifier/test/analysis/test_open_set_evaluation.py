# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import json

from classifier_tables import make_table
import numpy as np
import pytest

from tactile_classifier.confidence import fit_calibration
from tactile_classifier.confidence.fit_calibration import (
    compute_calibration_error,
    compute_uncalibrated,
    make_group_folds,
)
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.errors import EvaluationError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores
from tactile_classifier.evaluation.open_set import evaluate_open_set
from tactile_classifier.training.trainer import train
from tactile_classifier.types import MARGIN
from tactile_features.config import FeatureConfig


@pytest.fixture(scope='module')
def few(texture_table):
    """Return 4 labels, 30 trials each, from 3 sessions."""
    return texture_table.take(np.arange(480).reshape(8, 60)[:4, :30].ravel())


@pytest.fixture(scope='module')
def three_features(few):
    """Return every second trial, with three features that distinguish the labels."""
    half = few.take(np.arange(0, 120, 2))
    means = [half.values[half.labels == label].mean(axis=0) for label in set(half.labels)]
    chosen = np.sort(np.argsort(np.std(means, axis=0))[-3:])
    return make_table(half.labels, half.values[:, chosen], **half.columns)


def test_textures_far_apart_are_all_found_out(few):
    found = evaluate_open_set(few, 'knn', false_alarm_rate=0.1)
    assert found.split == 'one session held out'
    # The threshold comes from models of half the training trials, so few trials are rejected.
    assert found.realised_false_alarm_rate <= 0.12
    assert len(found.group_false_alarm_rates) == 3
    assert [unknown.label for unknown in found.unknown] == [f'plate {k}' for k in range(4)]
    assert sum(unknown.trials for unknown in found.unknown) == 120
    assert found.auroc > 0.9
    assert found.miss_rate < 0.4
    assert found.accuracy > 0.9
    json.dumps(found.to_dict(), allow_nan=False)


def test_two_names_for_one_thing_cannot_be_told_apart(few):
    twin = np.where(np.arange(120) % 2, 'twin', few.labels)
    labels = np.where(few.labels == 'plate 0', twin, few.labels)
    table = dataclasses.replace(few, labels=labels)
    found = {u.label: u for u in evaluate_open_set(table, 'tree').unknown}
    assert found['twin'].auroc < 0.7
    assert found['twin'].miss_rate > 0.8


def test_label_that_is_always_held_out_alone_is_refused(three_features, monkeypatch):
    # Each session contains only one plate, so no fold tests two labels together.
    known = three_features.take(three_features.labels != 'plate 3')
    day = np.arange(len(known)) % 2
    sessions = np.array([f'{label} {i}' for label, i in zip(known.labels, day, strict=True)])
    table = dataclasses.replace(known, columns={'session_id': sessions})
    with pytest.raises(EvaluationError, match=r'"plate 0" is never held out together.*record'):
        evaluate_open_set(table, 'knn', false_alarm_rate=0.1)
    # If single trials are held out, the labels are tested together, even in few folds.
    monkeypatch.setattr(fit_calibration, 'MAX_FOLDS', 3)
    assert evaluate_open_set(table, 'knn', hold_out=(), false_alarm_rate=0.1).trials == 45


def test_calibration_says_each_way_it_held_out(three_features):
    # Plate 3 is in two of seven sessions only. If one of them is tested, its trials cannot be held
    # out by session for calibration.
    session = np.arange(60) % 7
    kept = (three_features.labels != 'plate 3') | (session < 2)
    columns = {'session_id': session[kept]}
    table = dataclasses.replace(three_features.take(kept), columns=columns)
    found = evaluate_open_set(table, 'knn', false_alarm_rate=0.1)
    assert found.split == 'session held out in 6 folds'
    assert 'stratified' in found.calibration_split
    assert 'one session held out' in found.calibration_split


def test_random_convolutions_of_several_channels_are_those_of_the_model_file(monkeypatch):
    monkeypatch.setattr(random_convolutions, 'FEATURES', 168)
    generator = np.random.default_rng(2)
    label, session = np.tile(['a', 'b', 'c'], 20), np.repeat([0, 1], 30)
    level = 0.4 * np.tile([0.0, 1.0, 2.0], 20)[:, None]
    x = generator.normal(size=(60, 3, 40))
    x[:, 1] += level
    config = FeatureConfig(texture_features='glide_waveform')
    table = table_from_trials(
        'texture', x, label, 60.0, 'all', columns={'session_id': session}, config=config
    )
    assert table.channels == 3
    found = evaluate_open_set(table, 'rocket', false_alarm_rate=0.1)
    classes, true = np.unique(table.labels, return_inverse=True)
    scores, fold = np.zeros((60, 3)), make_group_folds(table).fold
    for i in np.unique(fold):
        part = table.take(fold != i)
        model = build_estimator('rocket', 'none', channels=3).fit(part.values, part.labels)
        assert model.classes_.tolist() == classes.tolist()
        scores[fold == i] = compute_raw_scores(model, table.values[fold == i])
    stated = compute_calibration_error(compute_uncalibrated(scores, MARGIN), true)
    assert found.calibration_error_before == pytest.approx(stated, rel=1e-12)
    # The manifest of a trained model states the same error; its model also has three channels.
    trained = train(table, 'rocket', false_alarm_rate=0.1)
    assert trained.manifest.confidence.calibration_error_before == pytest.approx(stated, rel=1e-12)
    whole = build_estimator('rocket', 'none', channels=3).fit(table.values, table.labels)
    np.testing.assert_array_equal(
        compute_raw_scores(trained.estimator, table.values),
        compute_raw_scores(whole, table.values),
    )


def test_too_few_labels_or_trials_are_refused(small_table):
    with pytest.raises(EvaluationError, match='there are 2 labels'):
        evaluate_open_set(small_table.take(small_table.labels != 'plate 2'), 'tree')
    with pytest.raises(EvaluationError, match='needs 99 trials'):
        evaluate_open_set(small_table, 'tree', false_alarm_rate=0.01)
