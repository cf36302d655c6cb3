# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Model files that answer before the window is full, and that may say "unknown"."""

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators.classifiers import compute_raw_scores
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.records import CLASSIFIERS, Outcome, UNKNOWN
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train


@pytest.fixture(scope='module')
def table(partial_tables):
    return partial_tables[0]


@pytest.fixture(scope='module')
def partial(partial_tables):
    return partial_tables[1]


@pytest.fixture(scope='module', params=CLASSIFIERS)
def trained(request, table, partial):
    return train(table, request.param, partial=partial)


@pytest.fixture(scope='module')
def model(trained, tmp_path_factory):
    return write_model(tmp_path_factory.mktemp('partial') / 'm.onnx', trained)


def test_every_part_answers_as_scikit_learn_does(trained, model):
    assert model.partial_samples == (60, 120)
    assert model.manifest.partial_samples == (60, 120)
    for part in trained.stages:
        rows = (0.6 * part.values + 0.4 * part.values[::-1])[:100]
        found = model.compute(rows, part.sample_count)
        raw = compute_raw_scores(part.estimator, rows)
        np.testing.assert_allclose(found.scores, part.calibration.compute(raw), atol=1e-12)
        np.testing.assert_allclose(found.novelty, part.novelty.compute(rows), rtol=1e-9)
        named = np.array(model.labels)[found.answer]
        np.testing.assert_array_equal(named, part.estimator.predict(rows))
        is_new = found.novelty > model.manifest.stages[part.sample_count // 60].novelty_threshold
        expected = np.where(is_new, UNKNOWN, named)
        np.testing.assert_array_equal(model.predict(rows, part.sample_count), expected)
    with pytest.raises(KeyError):
        model.compute(rows, 90)


@pytest.mark.parametrize('trained', ['knn'], indirect=True)
def test_partial_windows_change_nothing_for_whole_ones(trained, model, table, tmp_path):
    alone = write_model(tmp_path / 'm.onnx', train(table, trained.manifest.classifier))
    for one, two in zip(alone.compute(table.values), model.compute(table.values), strict=True):
        np.testing.assert_array_equal(one, two)


def test_partial_window_is_decided_by_its_probability(model, partial, make_window):
    threshold = model.manifest.stages[1].stop_threshold
    # A tree is as sure of every answer; on these trials that proves no threshold.
    assert (threshold > 0.0) == (model.manifest.classifier != 'tree')
    seen = set()
    for trial in range(0, 240, 7):
        window = make_window(values=partial[60].values[trial], partial=True, sample_count=60)
        assert model.accepts(window)
        result = model.classify_window(window)
        assert (result.partial, result.error_rate) == (True, 0.05)
        is_known = result.outcome == Outcome.LABEL
        assert is_known == (result.novelty <= result.novelty_threshold)
        assert result.decided == (is_known and max(result.scores) >= threshold > 0.0)
        seen.add(result.decided)
    assert (True in seen) == (threshold > 0.0)
    assert not model.accepts(make_window(partial=True, sample_count=90))


@pytest.mark.parametrize('trained', ['knn'], indirect=True)
@pytest.mark.parametrize('sample_count', [60, 180])
def test_what_is_unlike_all_training_is_unknown(model, table, make_window, sample_count):
    values = table.values[0] + 1.0
    is_partial = sample_count < 180
    result = model.classify_window(
        make_window(values=values, partial=is_partial, sample_count=sample_count)
    )
    assert (result.outcome, result.label) == (Outcome.UNKNOWN, '')
    assert result.novelty > result.novelty_threshold > 0.0
    assert 'unlike all that the model was trained on' in result.reason
    assert len(result.scores) == 4
    assert result.false_alarm_rate == 0.05
    assert result.decided is not is_partial  # a full window is all there is


@pytest.mark.parametrize('trained', ['knn'], indirect=True)
def test_partial_window_without_features_is_not_decided(model, make_window):
    window = make_window(values=np.full(91, np.nan), partial=True, sample_count=60)
    result = model.classify_window(window)
    assert (result.outcome, result.decided) == (Outcome.NO_FEATURES, False)


@pytest.mark.parametrize('trained', ['knn'], indirect=True)
def test_manifest_states_rates_and_how_they_were_found(trained):
    manifest = Manifest.from_dict(trained.manifest.to_dict())
    assert manifest == trained.manifest
    stated = dict(manifest.calibration)
    assert len(stated.pop('session_statistics')) == len(manifest.stages)
    known = stated.pop('held_out_novelty')
    assert [each['rank'] for each in known] == [3, 3, 3]
    assert [sum(map(len, each['sessions'])) for each in known] == [240, 240, 240]
    assert stated.pop('unlearned')['labels'] == 4
    assert stated == {
        'split': 'one session held out',
        'groups': 3,
        'held_out': ['session_id'],
        'trials': 240,
        'session_share': 0.75,
    }
    assert (manifest.false_alarm_rate, manifest.stop_error_rate) == (0.05, 0.05)
    assert manifest.score_kind == 'probability'
    assert [part.sample_count for part in manifest.stages] == [0, 60, 120]


def test_too_few_trials_give_raw_scores_and_the_reason(stiffness_table, tmp_path):
    table = stiffness_table.take(np.r_[0:6, 12:18, 24:30])
    trained = train(table, 'svm_linear')
    assert trained.manifest.calibration == {
        'reason': '18 trials cannot bound false rejection at 0.05; 19 are needed'
    }
    model = write_model(tmp_path / 'm.onnx', trained)
    found = model.compute(table.values)
    expected = compute_raw_scores(trained.estimator, table.values)
    np.testing.assert_allclose(found.scores, expected, atol=1e-12)
    assert (model.manifest.score_kind, len(found.novelty)) == ('margin', 0)


def test_rates_and_partial_tables_are_checked(table, partial):
    with pytest.raises(ValueError, match='a rate is 0'):
        train(table, 'tree', false_alarm_rate=0.0)
    with pytest.raises(DatasetError, match='table of 60 samples is not of the same trials'):
        train(table, 'tree', partial={60: partial[60].take(np.arange(239))})
    few = np.r_[0:4, 60:64, 120:124]
    with pytest.raises(DatasetError, match='early predictions need calibrated ones: 12 trials'):
        train(table.take(few), 'tree', partial={60: partial[60].take(few)})
