# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The classifier of waveforms, in scikit-learn's terms and in the model file."""

import numpy as np
import pytest

from tactile_classifier.datasets.archive import LabelledTrials
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores
from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier
from tactile_classifier.evaluation.cross_validation import evaluate, list_pairs
from tactile_classifier.model_file.graphs import add_random_convolutions
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig


@pytest.fixture(autouse=True)
def few_features(monkeypatch):
    monkeypatch.setattr(random_convolutions, 'FEATURES', 336)


def make_trials(channels=1, samples=60, classes=3, each=12, offset=5.0, seed=0):
    """Waves of the class's own frequency and phase under noise, and a level of the class."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples)
    rows, labels = [], []
    for k in range(classes):
        for _ in range(each):
            wave = np.sin((0.3 + 0.1 * k) * time + np.arange(channels)[:, None])
            rows.append(offset + wave + 0.5 * rng.normal(size=(channels, samples)))
            labels.append(f'plate {k}')
    return LabelledTrials(np.array(rows), np.array(labels), 60.0, {})


def waveform_table(**arguments):
    trials = make_trials(**arguments)
    config = FeatureConfig(texture_features='glide_waveform')
    return table_from_trials('texture', trials, 'all', config=config)


@pytest.mark.parametrize(
    ('channels', 'samples', 'classes', 'offset'),
    [(1, 60, 3, 5.0), (1, 61, 2, 1e4), (4, 33, 3, 5.0), (12, 20, 2, 0.0), (1, 9, 3, 0.0)],
)
def test_the_graph_counts_as_the_features_do(run_graph, channels, samples, classes, offset):
    trials = make_trials(channels, samples, classes, offset=offset)
    values = trials.x.reshape(len(trials), -1)
    model = RandomConvolutionClassifier(channels).fit(values[::2], trials.label[::2])
    # One other count would change a score by a weight over the samples: some 0.01.
    model.coef_ = np.random.default_rng(1).normal(size=model.coef_.shape)
    scores = run_graph(
        lambda graph, x: add_random_convolutions(graph, model, x), values[1::2], classes
    )
    expected = model.decision_function(values[1::2])
    if classes == 2:
        expected = np.stack([-expected, expected], axis=1)
    np.testing.assert_allclose(scores, expected, atol=1e-9, rtol=0)


@pytest.mark.parametrize(('channels', 'classes'), [(1, 2), (3, 3)])
def test_the_model_file_answers_as_the_estimator(channels, classes, tmp_path):
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    table = waveform_table(channels=channels, classes=classes)
    assert table.channels == channels
    trained = train(table, 'rocket')
    written = write_model(tmp_path / 'm.onnx', trained)
    model = load_model(tmp_path / 'm.onnx')
    assert (model.manifest.classifier, model.manifest.scaling) == ('rocket', 'none')
    assert model.model_id == written.model_id
    others = make_trials(channels, classes=classes, seed=1).x.reshape(len(table), -1)
    found, (part,) = model.compute(others), trained.stages
    raw = compute_raw_scores(trained.estimator, others)
    answer = np.array(model.labels)[found.answer]
    np.testing.assert_array_equal(answer, trained.estimator.predict(others))
    np.testing.assert_allclose(found.scores, part.calibration.compute(raw), atol=1e-9, rtol=0)
    np.testing.assert_allclose(found.novelty, part.novelty.compute(others), rtol=1e-6)
    assert np.mean(found.scores.argmax(axis=1) == found.answer) == 1.0


def test_a_waveform_is_told_by_its_shape_and_its_level_alone():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(60, 50))
    labels = np.where(np.arange(60) % 2, 'high', 'low')
    # A level of a tenth of the noise of one sample, under a large offset.
    values[labels == 'high'] += 1.0
    values += 1e4
    model = RandomConvolutionClassifier().fit(values[:40], labels[:40])
    assert np.mean(model.predict(values[40:]) == labels[40:]) > 0.9


def test_an_offset_that_single_precision_cannot_hold_leaves_the_shape():
    trials = make_trials(offset=0.0, each=20)
    values = trials.x[:, 0] + 1e9
    model = RandomConvolutionClassifier().fit(values[::2], trials.label[::2])
    assert np.mean(model.predict(values[1::2]) == trials.label[1::2]) > 0.9


def test_evaluation_adds_random_convolutions_to_the_four_where_features_are_a_waveform(
    texture_table,
):
    table = waveform_table()
    assert list_pairs(table)[-1] == ('rocket', 'none')
    assert len(list_pairs(table)) == 9
    assert len(list_pairs(texture_table)) == 8
    evaluation = evaluate(table, ['rocket'], repetitions=1)
    assert [score.scaling for score in evaluation.scores] == ['none']
    assert evaluation.score('rocket', 'none').mean > 0.9


def test_what_is_no_waveform_or_is_scaled_is_refused(texture_table):
    labels = ['a', 'a', 'b', 'b']
    with pytest.raises(ValueError, match='use the scaling "none"'):
        build_estimator('rocket', 'standard')
    with pytest.raises(DatasetError, match='texture_spectrum is none: take glide_waveform'):
        train(texture_table, 'rocket')
    with pytest.raises(DatasetError, match='9 samples or more'):
        RandomConvolutionClassifier().fit(np.zeros((4, 8)), labels)
    with pytest.raises(ValueError, match='50 values are not 3 waveforms'):
        RandomConvolutionClassifier(3).fit(np.zeros((4, 50)), labels)
