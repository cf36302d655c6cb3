# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.errors import DatasetError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.records import Outcome
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.records import Outcome as FeatureOutcome
from tactile_features.spec import array_spec, spec_for


@pytest.fixture
def model(model_path):
    return load_model(model_path)


def test_classification_repeats_the_window_and_names_the_model(model, make_window, small_table):
    result = model.classify_window(make_window(30))
    assert result.outcome == Outcome.LABEL
    assert result.label == small_table.labels[30]
    assert result.reason == ''
    assert result.labels == model.labels
    assert result.label == result.labels[int(np.argmax(result.scores))]
    assert sum(result.scores) == pytest.approx(1.0)
    assert (result.task, result.trial_id) == ('texture', 'trial-30')
    assert result.contact == make_window(30).contact == 'flexion'
    assert result.model_id == model.model_id
    assert (result.window_start_ns, result.window_end_ns) == (10**18 + 1, 10**18 + 2_983_333_334)
    assert result.frame_id == 'tendon_sensor_link'
    assert (result.score_kind, result.false_alarm_rate) == ('probability', 0.05)
    assert 0.0 <= result.novelty < result.novelty_threshold
    assert (result.partial, result.decided, result.error_rate) == (False, True, -1.0)
    assert result.simulated  # the model was trained on simulated trials


def test_values_of_another_shape_are_refused(model, small_table):
    one = small_table.values[30]
    with pytest.raises(DatasetError, match=r'shape \(91,\); model .* takes \(windows, 91\); one'):
        model.predict(one)
    for wrong in (small_table.values[:, 1:], 3.0, small_table.values[np.newaxis]):
        with pytest.raises(DatasetError, match=r'takes \(windows, 91\)'):
            model.predict(wrong)
    assert model.predict(one[np.newaxis]).tolist() == [small_table.labels[30]]


def test_simulated_comes_from_the_window_too(make_window, small_table, tmp_path):
    columns = {'simulated': np.zeros(len(small_table), dtype=bool)}
    table = type(small_table)(small_table.values, small_table.labels, small_table.spec, columns)
    model = write_model(tmp_path / 'm.onnx', train(table, 'tree'))
    assert not model.classify_window(make_window()).simulated
    assert model.classify_window(make_window(simulated=True)).simulated


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'outcome': FeatureOutcome.GAP, 'reason': '3 samples are missing'}, '3 samples are'),
        ({'outcome': FeatureOutcome.ABORTED}, 'the window ended with ABORTED'),
        (
            {'feature_set_version': 99},
            'version of the feature set is 99; the model was',
        ),
        (
            {'rate_hz': 100.0},
            'rate in Hz is 100.0; the model was trained on 60.0: name its file in the parameter '
            'models of the feature node',
        ),
        (
            {'specification_digest': 'ab' * 8},
            'with max_gap_samples 0, spectrum_detrend linear',
        ),
        ({'sample_count': 90}, 'window in samples is 90; the model was trained on 180'),
        ({'values': np.zeros(90)}, 'number of features is 90; the model was trained on 91'),
        ({'values': np.full(91, np.nan)}, 'the features are not finite'),
        ({'values': np.full(91, 1.7e308)}, 'the model gives no finite scores'),
    ],
)
def test_window_that_gives_no_answer_says_why(model, make_window, changes, reason):
    result = model.classify_window(make_window(**changes))
    assert result.outcome == Outcome.NO_FEATURES
    assert reason in result.reason
    assert (result.label, result.scores) == ('', ())
    assert result.labels == model.labels


def test_ready_cut_windows_take_their_specification_from_whoever_asks(
    small_table, make_window, tmp_path
):
    spec = array_spec('texture', 180, 60.0)
    table = type(small_table)(small_table.values, small_table.labels, spec, small_table.columns)
    model = write_model(tmp_path / 'm.onnx', train(table, 'tree'))
    assert model.spec.missing_parameters == ('texture_crop_start_s', 'max_gap_samples')
    assert model.format_mismatch(make_window(specification_digest='')) == ''
    later = spec_for('texture', FeatureConfig(texture_crop_start_s=0.9))
    faster = spec_for('texture', FeatureConfig(rate_hz=100.0))
    model.set_specifications([later, faster])
    assert model.fits(later.digest)
    assert model.format_mismatch(make_window(specification_digest=later.digest)) == ''
    assert not model.fits(faster.digest)
    assert 'rate in Hz differs: 60.0 here, 100.0 there' in model.format_mismatch(
        make_window(specification_digest=faster.digest)
    )
    assert 'another specification' in model.format_mismatch(make_window())


def test_accepts_its_own_feature_set_and_contact(model, make_window):
    assert model.accepts(make_window())
    assert model.accepts(make_window(contact=''))
    assert model.accepts(make_window(outcome=FeatureOutcome.GAP))
    assert not model.accepts(make_window(contact='abduction'))
    assert not model.accepts(make_window(feature_set='stiffness_regression'))


def test_one_window_alone_scores_as_in_a_batch(model, small_table):
    batch = model.compute(small_table.values).scores
    alone = np.concatenate([model.compute(row[np.newaxis]).scores for row in small_table.values])
    np.testing.assert_allclose(alone, batch, rtol=0, atol=1e-12)
