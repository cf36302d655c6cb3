# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of a model for windows of features: a label, unknown, or a reason."""

import dataclasses

from model_checks import check_model
import numpy as np
import pytest

from tactile_classifier.errors import DatasetError, ModelFileError
from tactile_classifier.estimators.classifiers import compute_raw_scores
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_classifier.types import CLASSIFIERS, NO_ANSWER, PredictionOutcome, UNKNOWN
from tactile_features.config import FeatureConfig
from tactile_features.spec import array_spec, spec_for
from tactile_features.types import WindowOutcome


@pytest.fixture
def model(model_path):
    return load_model(model_path)


def test_classification_repeats_the_window_and_names_the_model(model, make_window, small_table):
    result = model.classify_window(make_window(30))
    assert (result.outcome, result.label) == (PredictionOutcome.LABEL, small_table.labels[30])
    assert (result.labels, result.reason) == (model.labels, '')
    assert result.label == result.labels[int(np.argmax(result.scores))]
    assert sum(result.scores) == pytest.approx(1.0)
    assert (result.task, result.trial_id, result.contact) == ('texture', 'trial-30', 'flexion')
    assert result.model_id == model.model_id
    assert (result.window_start_ns, result.window_end_ns) == (10**18 + 1, 10**18 + 2_983_333_334)
    assert result.frame_id == 'tendon_sensor_link'
    assert (result.score_kind, result.false_alarm_rate) == ('probability', 0.05)
    assert 0.0 <= result.novelty < result.novelty_threshold
    assert result.simulated  # the model was trained on simulated trials


def test_simulated_comes_from_the_window_too(make_window, small_table, tmp_path):
    table = dataclasses.replace(small_table, columns={})
    model = write_model(tmp_path / 'm.npz', train(table, 'tree'))
    assert not model.classify_window(make_window()).simulated
    assert model.classify_window(make_window(simulated=True)).simulated


def test_values_of_another_shape_are_refused(model, small_table):
    one = small_table.values[30]
    with pytest.raises(DatasetError, match=r'\(91,\).* \(windows, 91\)'):
        model.predict(one)
    for wrong in (small_table.values[:, 1:], 3.0, small_table.values[np.newaxis]):
        with pytest.raises(DatasetError, match=r'\(windows, 91\)'):
            model.predict(wrong)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'outcome': WindowOutcome.GAP, 'reason': '3 samples are missing'}, '3 samples are'),
        ({'outcome': WindowOutcome.ABORTED}, 'the window ended with ABORTED'),
        ({'feature_set_version': 99}, 'version of the feature set is 99; the model was'),
        (
            {'rate_hz': 100.0},
            'rate in Hz is 100; the model was trained on 60: name its file in the parameter '
            'models of the feature node',
        ),
        ({'specification_digest': 'ab' * 8}, 'with max_gap_samples 0, spectrum_detrend linear'),
        ({'sample_count': 90}, 'window in samples is 90; the model was trained on 180'),
        ({'values': np.zeros(90)}, 'number of features is 90; the model was trained on 91'),
        ({'values': np.full(91, np.nan)}, 'the features are not finite'),
        ({'values': np.full(91, 1.7e308)}, 'scores of these features are not finite'),
    ],
)
def test_window_that_gives_no_answer_says_why(model, make_window, changes, reason):
    result = model.classify_window(make_window(**changes))
    assert result.outcome == PredictionOutcome.NO_FEATURES
    assert reason in result.reason
    assert (result.label, result.scores, result.labels) == ('', (), model.labels)


def test_ready_cut_windows_take_their_specification_from_whoever_asks(
    small_table, make_window, tmp_path
):
    table = dataclasses.replace(small_table, spec=array_spec('texture', 180, 60.0))
    model = write_model(tmp_path / 'm.npz', train(table, 'tree'))
    assert model.spec.missing_parameters == ('texture_crop_start_s', 'max_gap_samples')
    assert model.find_mismatch(make_window(specification_digest='')) is None
    later = spec_for('texture', FeatureConfig(texture_crop_start_s=0.9))
    faster = spec_for('texture', FeatureConfig(rate_hz=100.0))
    model.set_specifications([later, faster])
    assert model.fits(later.digest)
    assert model.find_mismatch(make_window(specification_digest=later.digest)) is None
    assert not model.fits(faster.digest)
    assert 'rate in Hz differs: required 60, found 100' in model.find_mismatch(
        make_window(specification_digest=faster.digest)
    )
    assert 'another specification' in model.find_mismatch(make_window())


def test_accepts_and_fits_its_own_features_alone(model, make_window):
    assert model.accepts(make_window())
    assert model.accepts(make_window(contact=''))
    assert model.accepts(make_window(outcome=WindowOutcome.GAP))
    assert not model.accepts(make_window(contact='abduction'))
    assert not model.accepts(make_window(feature_set='stiffness_regression'))
    model.check_fits(spec_for('texture', FeatureConfig()))
    with pytest.raises(ModelFileError, match='rate in Hz differs'):
        model.check_fits(spec_for('texture', FeatureConfig(rate_hz=100.0)))


@pytest.mark.parametrize('classifier', ['knn', 'svm_rbf', 'tree'])
def test_answers_on_many_windows_are_those_on_each(small_table, make_window, tmp_path, classifier):
    model = write_model(tmp_path / 'm.npz', train(small_table, classifier))
    generator = np.random.default_rng(2)
    values = small_table.values * generator.uniform(0.2, 5.0, (len(small_table), 1))
    outcomes = {PredictionOutcome.UNKNOWN: UNKNOWN, PredictionOutcome.NO_FEATURES: NO_ANSWER}
    expected, alone = [], []
    for row in values:
        result = model.classify_window(make_window(0, values=row))
        expected.append(outcomes.get(result.outcome, result.label))
        alone.append(result.scores)
    assert model.predict_or_unknown(values).tolist() == expected
    assert {UNKNOWN, *small_table.labels} >= set(expected) > {UNKNOWN}
    np.testing.assert_allclose(alone, model.compute(values).scores, rtol=0, atol=1e-12)
    assert model.predict(values[:0]).shape == (0,)


def test_the_manifest_lists_the_training_trials_and_no_others(
    texture_table, stiffness_table, tmp_path
):
    for table in (texture_table, stiffness_table):
        keep = np.arange(len(table)) % 4 == 0
        model = write_model(tmp_path / 'm.npz', train(table.take(keep), 'knn'))
        found = np.isin(table.digest_trials(), model.manifest.trial_digests)
        np.testing.assert_array_equal(found, keep)


def test_too_few_trials_give_raw_scores_and_the_reason(stiffness_table, tmp_path):
    table = stiffness_table.take(np.r_[0:6, 12:18, 24:30])
    trained = train(table, 'svm_linear')
    assert trained.manifest.calibration == {
        'reason': 'a threshold with a false rejection rate of 0.05 needs 19 trials, '
        'but the number of held-out trials is 18'
    }
    model = write_model(tmp_path / 'm.npz', trained)
    found = model.compute(table.values)
    expected = compute_raw_scores(trained.estimator, table.values)
    np.testing.assert_allclose(found.scores, expected, atol=1e-12)
    assert (model.manifest.score_kind, len(found.novelty)) == ('margin', 0)
    assert model.predict_or_unknown(np.full((1, 3), 1.7e308)).tolist() == [NO_ANSWER]


# -- early windows ------------------------------------------------------------------


@pytest.fixture(scope='module')
def early_model(early_path):
    return load_model(early_path)


@pytest.fixture
def early_window(early_table, make_window):
    """Return a function that makes an early window with the features of a trial."""

    def make(trial, **changes):
        fields = {
            'values': early_table.values[trial],
            'sample_count': 60,
            'specification_digest': early_table.spec.digest,
        }
        return make_window(0, **{**fields, **changes})

    return make


@pytest.mark.parametrize('classifier', CLASSIFIERS)
def test_a_model_of_early_windows_answers_as_scikit_learn_does(early_table, tmp_path, classifier):
    trained = train(early_table, classifier)
    rows = (0.6 * trained.values + 0.4 * trained.values[::-1])[:100]
    check_model(trained, tmp_path / 'm.npz', rows)


def test_an_early_answer_has_probabilities_and_an_unknown_of_its_own(
    early_model, early_window, early_table
):
    result = early_model.classify_window(early_window(0))
    assert (result.outcome, result.label) == (PredictionOutcome.LABEL, early_table.labels[0])
    assert sum(result.scores) == pytest.approx(1.0)
    assert 'the first 60 samples' in early_model.card
    result = early_model.classify_window(early_window(0, values=early_table.values[0] + 1.0))
    assert (result.outcome, result.label) == (PredictionOutcome.UNKNOWN, '')
    assert result.novelty > result.novelty_threshold > 0.0
    assert 'unlike all training trials' in result.reason
    assert (len(result.scores), result.false_alarm_rate) == (4, 0.05)
    silent = early_window(0, values=np.full(31, np.nan))
    assert early_model.classify_window(silent).outcome == PredictionOutcome.NO_FEATURES


def test_a_full_window_of_the_same_length_is_no_early_one(early_model, early_window):
    full = spec_for('texture', FeatureConfig(texture_samples=60))
    early_model.set_specifications([full])
    reason = early_model.classify_window(early_window(0, specification_digest=full.digest)).reason
    early_model.set_specifications([])
    assert 'the window (early_windows) differs' in reason


def test_a_refusal_after_an_early_window_is_no_answer(early_model, early_window):
    refusal = early_window(
        0, outcome=WindowOutcome.TOO_SHORT, reason='the glide ended', values=np.empty(0)
    )
    result = early_model.classify_window(refusal)
    assert (result.outcome, result.reason) == (PredictionOutcome.NO_FEATURES, 'the glide ended')


def test_manifest_states_rates_and_how_they_were_found(early_model):
    manifest = Manifest.from_dict(early_model.manifest.to_dict())
    assert manifest == early_model.manifest
    stated = dict(manifest.calibration)
    known = stated.pop('held_out_novelty')
    assert (len(known['names']), sum(map(len, known['sessions']))) == (3, 240)
    assert stated.pop('unlearned')['labels'] == 4
    assert set(stated.pop('surplus')) == {'mean', 'half_width'}
    assert stated == {
        'split': 'one session held out', 'groups': 3, 'held_out': ['session_id'], 'trials': 240,
        'strict': False,
    }  # fmt: skip
    assert (manifest.false_alarm_rate, manifest.score_kind) == (0.05, 'probability')
