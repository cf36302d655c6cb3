# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import datetime

from classifier_tables import make_table
import numpy as np
import pytest

from tactile_classifier.confidence.fit_calibration import (
    fit_calibration,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.errors import DatasetError
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_classifier.model_file.manifest import list_limits
from tactile_classifier.training import trainer
from tactile_classifier.training.trainer import train


def test_manifest_states_what_was_trained(small_table):
    score = evaluate(small_table, ['knn'], ['none'], repetitions=2).score('knn', 'none')
    trained = train(small_table, 'knn', score=score)
    manifest = trained.manifest
    assert list(trained.estimator.classes_) == list(manifest.labels)
    assert (manifest.task, manifest.contact, manifest.simulated) == ('texture', 'flexion', True)
    assert (manifest.classifier, manifest.scaling, manifest.trials) == ('knn', 'none', 36)
    assert manifest.score_kind == 'probability'
    assert manifest.training_sha256 == small_table.compute_sha256()
    assert manifest.cross_validation == {
        'mean': score.mean,
        'spread': score.spread,
        'spread_of': 'repetitions',
        'split': 'stratified 6-fold, 2 times',
        'interval': score.interval.to_dict(),
    }
    created = datetime.datetime.fromisoformat(manifest.created)
    age = datetime.datetime.now(datetime.timezone.utc) - created
    assert age < datetime.timedelta(hours=1)
    assert {'python', 'numpy', 'scikit-learn'} <= set(manifest.versions)


def test_a_label_that_the_model_never_gives_is_told_once(small_table):
    table = dataclasses.replace(small_table, values=1e-9 * small_table.values)
    table = table.take(np.arange(1, 36))
    with pytest.warns(UserWarning, match='never predicts') as told:
        train(table, 'svm_linear', 'none')
    assert len(told) == 1


def test_contact_is_empty_when_mixed_or_unknown(small_table, stiffness_table):
    manifest = train(stiffness_table, 'tree').manifest
    assert (manifest.contact, manifest.scaling) == ('', 'standard')  # the default of the task
    contact = np.where(np.arange(36) % 2, 'flexion', 'abduction')
    mixed = dataclasses.replace(small_table, columns={'contact': contact})
    manifest = train(mixed, 'tree').manifest
    assert (manifest.contact, manifest.simulated) == ('', False)


def test_what_cannot_be_trained_is_refused(small_table):
    score = evaluate(small_table, ['knn'], ['standard'], repetitions=1).scores[0]
    with pytest.raises(ValueError, match='the score belongs to knn with scaling standard'):
        train(small_table, 'knn', 'none', score=score)
    with pytest.raises(DatasetError, match='only one class'):
        train(small_table.take(np.arange(5)), 'knn')
    with pytest.raises(DatasetError, match='three trials'):
        train(small_table.take([0, 20]), 'tree')
    with pytest.raises(ValueError, match='false_alarm_rate is 0'):
        train(small_table, 'tree', false_alarm_rate=0.0)


def test_only_too_few_trials_are_a_reason_for_no_probabilities(small_table, monkeypatch):
    few = small_table.take(np.arange(36) % 3 == 0)
    stated = train(few, 'knn', false_alarm_rate=0.01).manifest.calibration
    assert set(stated) == {'reason'}
    assert ' 99 trials' in stated['reason']

    def fail(*_, **__):
        raise ValueError('a fault')

    monkeypatch.setattr(trainer, 'calibrate_held_out', fail)
    with pytest.raises(ValueError, match='a fault'):
        train(small_table, 'knn')


def draw_sessions(noises):
    """Return trials of three labels; each session has its own standard deviation of noise."""
    label = np.tile(np.repeat(np.arange(3), 20), len(noises))
    session = np.repeat(np.arange(len(noises)), 60)
    noise = np.random.default_rng(3).normal(size=(len(label), 3)) * np.array(noises)[session, None]
    labels = np.array(['foam', 'pla', 'steel'])[label]
    return make_table(labels, 3.0 * np.eye(3)[label] + noise, session_id=session)


@pytest.mark.parametrize('classifier', ['knn', 'tree'])
@pytest.mark.parametrize('sessions', [1, 2])
def test_votes_without_a_mistake_are_calibrated(classifier, sessions):
    trained = train(draw_sessions((0.2,) * sessions), classifier)
    part = trained.manifest.confidence
    assert (part.accuracy, part.calibration_error_before) == (1.0, 0.0)
    assert part.calibration_error_after > 0.0
    assert trained.manifest.score_kind == 'probability'
    assert trained.calibration.compute(np.eye(3))[0, 0] < 0.999


@pytest.mark.parametrize('noises', [(0.2, 4.0), (0.2, 4.0, 0.2, 4.0)])
def test_unlike_sessions_are_calibrated_by_all(noises):
    table = draw_sessions(noises)
    trained = train(table, 'svm_linear')
    assert trained.manifest.score_kind == 'probability'
    scores, true = hold_out_scores(table, 'svm_linear', 'standard', make_group_folds(table).fold)
    assert trained.calibration == fit_calibration(scores, true)


def test_a_model_for_new_groups_is_calibrated_on_held_out_groups():
    rng = np.random.default_rng(4)
    session, speed, label = (each.ravel() for each in np.mgrid[:4, :4, :24])
    label %= 3
    # At each speed, the same feature value belongs to another label.
    values = np.column_stack([30.0 * speed + 9.0 * ((label + speed) % 3), np.zeros(len(label))])
    values = values + 0.7 * rng.normal(size=values.shape)
    columns = {'session_id': session.astype(str), 'speed': speed.astype(float)}
    table = make_table(np.array(['foam', 'pla', 'steel'])[label], values, **columns)
    by_session, by_speed = (
        train(table, 'knn', 'none', hold_out=(column,)).manifest for column in columns
    )
    scores, true = hold_out_scores(table, 'knn', 'none', make_group_folds(table, ('speed',)).fold)
    known = float(np.mean(scores.argmax(axis=1) == true))
    assert by_speed.confidence.accuracy == pytest.approx(known)
    assert known <= 0.5 < 0.9 < by_session.confidence.accuracy
    assert by_speed.calibration['held_out'] == ['speed']
    assert any('4 groups by speed was' in line for line in list_limits(by_speed))
    assert any('4 sessions was' in line for line in list_limits(by_session))


def test_groups_that_cannot_be_held_out_are_said_so(small_table):
    with pytest.raises(DatasetError, match='there is no column "typo"'):
        train(small_table, 'knn', hold_out=('session_id', 'typo'))
    columns = {**small_table.columns, 'speed': small_table.labels}  # each label has its own speed
    table = dataclasses.replace(small_table, columns=columns)
    manifest = train(table, 'knn', hold_out=('speed',)).manifest
    assert manifest.calibration['groups'] == 0
    assert any(
        line.startswith('No groups by speed were held out') for line in list_limits(manifest)
    )
