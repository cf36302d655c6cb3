# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Raw scores are kept where calibration is clearly worse on held-out sessions, and only there."""

import dataclasses
import json

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.confidence.calibration import (
    Calibration,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.confidence.score_choice import compute_log_loss, FLOOR, ScoreChoice
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import compute_raw_scores
from tactile_classifier.evaluation.open_set import evaluate_open_set
from tactile_classifier.model_file.model import read_manifest
from tactile_classifier.records import MARGIN, VOTES
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.spec import array_spec


def draw(noises, seed=3, each=20):
    """Return trials of three labels; one session for each size of noise."""
    rng = np.random.default_rng(seed)
    label = np.tile(np.repeat(np.arange(3), each), len(noises))
    session = np.repeat(np.arange(len(noises)), 3 * each)
    values = (
        3.0 * np.eye(3)[label] + rng.normal(size=(len(label), 3)) * np.array(noises)[session, None]
    )
    columns = {'session_id': session.astype(str)}
    spec = array_spec('stiffness', 50, 60.0)
    return FeatureTable(values, np.array(['foam', 'pla', 'steel'])[label], spec, columns)


@pytest.fixture(scope='module')
def unlike():
    """Return a table of two sessions, one with little noise and one with much."""
    return draw((0.2, 4.0))


def test_two_unlike_sessions_keep_raw_scores(unlike, tmp_path):
    trained = train(unlike, 'svm_linear')
    model = write_model(tmp_path / 'm.onnx', trained)
    manifest = read_manifest(tmp_path / 'm.onnx')
    assert manifest.score_kind == 'margin'
    stated = manifest.calibration['scores']
    assert stated['kept'] == 'raw'
    assert stated['log_loss_calibrated'] - stated['log_loss_raw'] > stated['margin']
    assert 'reason' not in manifest.calibration
    found = model.compute(unlike.values)
    expected = compute_raw_scores(trained.estimator, unlike.values)
    np.testing.assert_allclose(found.scores, expected, atol=1e-12, rtol=0)
    np.testing.assert_array_equal(found.answer, found.scores.argmax(axis=1))


def test_unknown_objects_are_rejected_by_the_same_threshold(unlike, tmp_path, monkeypatch):
    raw = write_model(tmp_path / 'raw.onnx', train(unlike, 'svm_linear'))
    compare = ScoreChoice.compare
    monkeypatch.setattr(
        ScoreChoice,
        'compare',
        lambda *arguments: dataclasses.replace(compare(*arguments), keeps_raw=False),
    )
    calibrated = write_model(tmp_path / 'calibrated.onnx', train(unlike, 'svm_linear'))
    assert (raw.manifest.score_kind, calibrated.manifest.score_kind) == ('margin', 'probability')
    assert raw.manifest.stages == calibrated.manifest.stages
    one, other = raw.compute(unlike.values), calibrated.compute(unlike.values)
    np.testing.assert_array_equal(one.novelty, other.novelty)
    np.testing.assert_array_equal(one.answer, other.answer)
    assert raw.manifest.stages[0].novelty_threshold > 0.0


@pytest.mark.parametrize('classifier', ['knn', 'tree'])
@pytest.mark.parametrize('sessions', [1, 2])
def test_votes_without_a_mistake_are_calibrated(classifier, sessions):
    trained = train(draw((0.2,) * sessions), classifier)
    part = trained.manifest.stages[0]
    assert (part.accuracy, part.calibration_error_before) == (1.0, 0.0)
    assert part.calibration_error_after > 0.0  # a naive rule would keep certainty 1
    assert trained.manifest.score_kind == 'probability'
    assert trained.stages[0].calibration.compute(np.eye(3))[0, 0] < 0.999


def test_more_sessions_are_calibrated_as_ever():
    table = draw((0.2, 4.0, 0.2, 4.0, 0.2, 4.0))
    trained = train(table, 'svm_linear')
    stated = trained.manifest.calibration['scores']
    assert stated['kept'] == 'calibrated'
    scores, true = hold_out_scores(table, 'svm_linear', 'standard', make_group_folds(table).fold)
    assert trained.stages[0].calibration == Calibration.fit(scores, true)


def test_partial_answers_keep_probabilities(unlike):
    # The stopping rule compares probabilities.
    trained = train(unlike, 'svm_linear', partial={30: unlike})
    stated = trained.manifest.calibration['scores']
    assert stated['log_loss_calibrated'] - stated['log_loss_raw'] > stated['margin']
    assert (stated['kept'], trained.manifest.score_kind) == ('calibrated', 'probability')


def test_evaluation_counts_parts_with_raw_scores():
    table = draw((0.2, 4.0, 0.2))
    found = evaluate_open_set(table, 'svm_linear')
    # Without the first or the last session, two unlike ones remain.
    assert found.raw_parts == 2
    assert json.loads(json.dumps(found.to_dict()))['raw_parts'] == 2


def test_comparison_of_known_numbers():
    true = np.zeros(4, dtype=np.intp)
    session = np.array([0, 0, 1, 1])
    assert compute_log_loss(np.array([[0.0, 1.0]]), np.array([0])) == -np.log(FLOOR)
    raw = np.array([[0.5, 0.5]] * 4)
    calibrated = np.array([[0.25, 0.75]] * 2 + [[0.0, 1.0]] * 2)
    found = ScoreChoice.compare(raw, calibrated, true, session, MARGIN)
    assert found.log_loss_raw == pytest.approx(np.log(2.0))
    assert found.log_loss_calibrated == pytest.approx((np.log(4.0) - np.log(FLOOR)) / 2)
    differences = np.array([np.log(2.0), -np.log(FLOOR) - np.log(2.0)])
    assert found.margin == pytest.approx(np.ptp(differences) / 2)
    assert found.keeps_raw
    votes = ScoreChoice.compare(raw, calibrated, true, session, VOTES)
    assert votes == dataclasses.replace(found, keeps_raw=False)
    # One session or three, or single trials: never.
    for other in (np.zeros(4, dtype=np.intp), np.array([0, 1, 2, 2]), None):
        assert not ScoreChoice.compare(raw, calibrated, true, other, MARGIN).keeps_raw


def test_worse_in_one_session_alone_is_calibrated():
    true = np.zeros(4, dtype=np.intp)
    raw = np.array([[0.5, 0.5]] * 4)
    calibrated = np.array([[0.51, 0.49]] * 2 + [[0.0, 1.0]] * 2)
    found = ScoreChoice.compare(raw, calibrated, true, np.array([0, 0, 1, 1]), MARGIN)
    assert found.log_loss_calibrated - found.log_loss_raw > 3.0
    assert not found.keeps_raw


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(6, 60))
def test_a_faultless_classifier_never_wins(seed, trials):
    """One imagined miss outweighs all that calibration takes off certainty."""
    rng = np.random.default_rng(seed)
    true = rng.integers(0, 3, trials)
    certain = np.eye(3)[true]
    calibrated = Calibration.fit(certain, true).compute(certain)
    session = np.arange(trials) % 2
    assert not ScoreChoice.compare(certain, calibrated, true, session, MARGIN).keeps_raw
