# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparison of random convolutions with their definition, and with aeon's MiniRocket."""

from itertools import combinations
from pathlib import Path
import sys

from model_checks import check_model
import numpy as np
import pytest
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.datasets.splits import stratified_split
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators import convolutions as convolutions_module
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.estimators.random_convolutions import (
    ALPHAS,
    fit_convolutions,
    LeaveOneOutRidge,
    RandomConvolutionClassifier,
)
from tactile_classifier.evaluation.cross_validation import evaluate, list_pairs
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig

REFERENCE = Path(__file__).parents[1] / 'data' / 'minirocket.npz'
"""Signals, biases and features of MiniRocket(random_state=7) of aeon, fitted to five signals."""

CASES = {'offset': 336, 'channels': 336, 'short': 168}


def convolve_by_definition(signal, dilation, places):
    """Return one kernel's sum at each sample, in long doubles."""
    edge = 4 * int(dilation)
    padded = np.pad(signal.astype(np.longdouble), edge)
    shifted = (padded[tap * int(dilation) :][: len(signal)] for tap in range(9))
    return sum((2 if tap in places else -1) * each for tap, each in enumerate(shifted))


def check_features(convolutions, signal, largest):
    """Compare features of one channel with the definition; return how many are exact."""
    found = convolutions.transform(signal[None, None])[0]
    # Bound on the rounding error: no sum exceeds twelve times the largest sample.
    error = 12 * 12 * np.finfo(np.float32).eps * largest
    at = exact = 0
    counts = convolutions.counts
    parts = np.split(convolutions.biases, 84 * np.cumsum(counts)[:-1])
    for i, (dilation, part) in enumerate(zip(convolutions.dilations, parts, strict=True)):
        biases = part.reshape(84, counts[i])
        for k, places in enumerate(combinations(range(9), 3)):
            sums = convolve_by_definition(signal, dilation, places)
            if (i + k) % 2:
                sums = sums[4 * dilation : -4 * dilation]
            for bias in biases[k].astype(np.longdouble):
                low, high = np.mean(sums > bias + error), np.mean(sums > bias - error)
                assert low <= found[at] <= high
                exact += low == high
                at += 1
    assert at == len(found)
    return exact


@pytest.mark.parametrize('samples', [9, 10, 33])
def test_features_of_whole_numbers_are_those_of_the_definition(samples):
    rng = np.random.default_rng(samples)
    x = rng.integers(-9, 10, (6, 1, samples)).astype(np.float32)
    convolutions = fit_convolutions(x[:5], 336, random_state=1)
    # Sums of whole numbers are exact in any order, so all features must be exact.
    assert check_features(convolutions, x[5, 0], 0.0) == len(convolutions.biases)


@pytest.mark.parametrize(
    ('offset', 'change', 'decided'),
    [(0.0, 1.0, 0.99), (1e4, 10.0, 0.9), (1e4, 1e-2, 0.0), (0.0, 1e-40, 0.99)],
)
def test_features_under_an_offset_err_by_the_digits_of_single_precision_only(
    offset, change, decided
):
    rng = np.random.default_rng(3)
    x = (offset + change * rng.normal(size=(6, 1, 40)).cumsum(axis=2)).astype(np.float32)
    convolutions = fit_convolutions(x[:5], 336, random_state=2)
    exact = check_features(convolutions, x[5, 0], float(np.abs(x).max()))
    assert exact >= decided * len(convolutions.biases)


def test_a_constant_signal_has_features_of_its_ends_only():
    x = np.full((4, 1, 50), 3.0) + np.arange(4)[:, None, None]
    convolutions = fit_convolutions(x, 336)
    values = convolutions.transform(x)
    # The sums are 0 except at the ends of a signal, so only the ends distinguish the signals.
    assert len(np.unique(values, axis=0)) == 4
    cropped = np.concatenate(
        [np.repeat((i + np.arange(84)) % 2, count) for i, count in enumerate(convolutions.counts)]
    )
    assert set(np.unique(values[:, cropped == 1])) <= {0.0, 1.0}


def test_a_signal_gives_the_same_bits_alone_and_again_and_others_with_another_seed():
    x = np.random.default_rng(5).normal(size=(40, 3, 100)) * 100
    first, again, other = (fit_convolutions(x, 840, random_state=s) for s in (0, 0, 2))
    alone = np.concatenate([again.transform(row[None]) for row in x])
    assert first.transform(x).tobytes() == alone.tobytes()
    assert not np.array_equal(first.biases, other.biases)
    assert not np.array_equal(first.sources, other.sources)


@pytest.mark.parametrize(
    ('signals', 'sentence'),
    [
        (np.zeros((3, 1, 8)), 'with 9 samples or more'),
        (np.zeros((0, 1, 20)), 'with 9 samples or more'),
        (np.zeros((3, 20)), 'with 9 samples or more'),
        (np.full((3, 1, 20), np.nan), 'not finite in single precision'),
        (np.full((3, 1, 20), 1e40), 'not finite in single precision'),
    ],
)
def test_signals_that_cannot_be_convolved_are_refused(signals, sentence):
    with pytest.raises(DatasetError, match=sentence):
        fit_convolutions(signals)
    convolutions = fit_convolutions(np.zeros((3, 2, 20)), 84)
    with pytest.raises(DatasetError, match='1 channels of 20 samples'):
        convolutions.transform(np.zeros((3, 1, 20)))


@pytest.mark.parametrize('case', CASES)
def test_biases_and_features_are_those_that_aeon_gave(case):
    with np.load(REFERENCE, allow_pickle=False) as stored:
        x, biases, values = (
            stored[f'{case}_{name}'] for name in ('signals', 'biases', 'features')
        )
    convolutions = fit_convolutions(x[:5], CASES[case], random_state=7)
    np.testing.assert_array_equal(convolutions.biases, biases)
    np.testing.assert_allclose(convolutions.transform(x[5:]), values, rtol=0, atol=1e-6)


# -- the classifier, in scikit-learn's terms and in the model file ------------------


@pytest.fixture
def few_features(monkeypatch):
    monkeypatch.setattr(random_convolutions, 'FEATURES', 336)


def make_trials(channels=1, samples=60, classes=3, each=12, offset=5.0, seed=0):
    """Return noisy waves and their labels; the frequency of a wave depends on its label."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples)
    rows, labels = [], []
    for k in range(classes):
        for _ in range(each):
            wave = np.sin((0.3 + 0.1 * k) * time + np.arange(channels)[:, None])
            rows.append(offset + wave + 0.5 * rng.normal(size=(channels, samples)))
            labels.append(f'plate {k}')
    return np.array(rows), np.array(labels)


def waveform_table(**arguments):
    x, labels = make_trials(**arguments)
    config = FeatureConfig(texture_features='glide_waveform')
    return table_from_trials('texture', x, labels, 60.0, 'all', config=config)


@pytest.mark.parametrize(
    ('channels', 'samples', 'classes', 'offset'),
    [(1, 60, 3, 5.0), (1, 61, 2, 1e4), (4, 33, 3, 5.0), (12, 20, 2, 0.0), (1, 9, 3, 0.0)],
)
def test_without_numba_every_bit_is_the_same(
    few_features, monkeypatch, channels, samples, classes, offset
):
    x, labels = make_trials(channels, samples, classes, offset=offset)
    values = x.reshape(len(x), -1)
    compiled = RandomConvolutionClassifier(channels).fit(values[::2], labels[::2])
    expected = compiled.decision_function(values[1::2])
    assert convolutions_module.load_loops(16) is not convolutions_module
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, 'numba', None)
        patch.delitem(sys.modules, 'tactile_classifier.estimators.compiled_convolutions')
        # The package also keeps the module as an attribute, which an import would find.
        patch.delattr('tactile_classifier.estimators.compiled_convolutions')
        assert convolutions_module.load_loops(16) is convolutions_module
        plain = RandomConvolutionClassifier(channels).fit(values[::2], labels[::2])
        np.testing.assert_array_equal(plain.decision_function(values[1::2]), expected)
    for one, other in zip(plain.convolutions_, compiled.convolutions_, strict=True):
        np.testing.assert_array_equal(one.biases, other.biases)


@pytest.mark.parametrize(('channels', 'classes'), [(1, 2), (3, 3)])
def test_the_model_file_answers_as_the_estimator(few_features, channels, classes, tmp_path):
    table = waveform_table(channels=channels, classes=classes)
    assert table.channels == channels
    trained = train(table, 'rocket')
    others = make_trials(channels, classes=classes, seed=1)[0].reshape(len(table), -1)
    model = check_model(trained, tmp_path / 'm.npz', others)
    assert (model.manifest.classifier, model.manifest.scaling) == ('rocket', 'none')


@pytest.mark.parametrize('classes', [2, 3])
def test_the_linear_classifier_is_that_of_scikit_learn(classes):
    rng = np.random.default_rng(classes)
    labels = np.resize(['a', 'b', 'c'][:classes], 60)
    chosen = set()
    for effect in (0.0, 0.3, 3.0):  # each effect selects another penalty
        values = 0.4 + rng.normal(size=(60, 200))
        values[:, :50] += effect * np.unique(labels, return_inverse=True)[1][:, np.newaxis]
        values[:, 7], values[:, 9] = 0.3, 1e4 * values[:, 9]
        peer = make_pipeline(StandardScaler(), RidgeClassifierCV(ALPHAS))
        peer.fit(values[:40], labels[:40])
        chosen.add(peer[-1].alpha_)
        ridge = LeaveOneOutRidge(values[:40])
        likeness = ridge.compare(values[40:])
        names, dual, offset = ridge.solve(labels[:40])
        expected = peer.decision_function(values[40:]).reshape(20, -1)
        np.testing.assert_allclose(likeness @ dual + offset, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(names, peer.classes_)
        expected = peer.predict(values[40:])
        np.testing.assert_array_equal(ridge.predict(likeness, labels[:40]), expected)
    assert len(chosen) > 1


def test_labelings_and_folds_are_predicted_together_as_one_by_one(few_features):
    table = waveform_table(classes=3)
    values, labels = table.values, table.labels
    shuffled = np.random.default_rng(0).permutation(labels)
    (train, test), *_ = folds = stratified_split(table, 3, 1).repeats[0]
    model = RandomConvolutionClassifier()
    together = list(model.predict_folds(values, [labels, shuffled], folds))
    for i, labeling in enumerate((labels, shuffled)):
        for fold, found in zip(folds, together, strict=True):
            ((alone,),) = model.predict_folds(values, [labeling], [fold])
            np.testing.assert_array_equal(found[i], alone)
    # If the convolutions are fitted to the training trials, the fold equals an ordinary fit.
    ((said,),) = model.predict_folds(values, [labels], [(train, test)], train)
    expected = model.fit(values[train], labels[train]).predict(values[test])
    np.testing.assert_array_equal(said, expected)


def test_a_share_that_is_equal_in_all_training_trials_has_no_weight():
    # There is so little noise that many features are equal in all trials.
    rng = np.random.default_rng(0)
    labels = np.repeat(['a', 'b', 'c'], 20)
    level = np.repeat([5.0, 6.0, 7.0], 20)[:, np.newaxis]
    relaxation = 1 - 0.1 * (1 - np.exp(-np.arange(100) / 37.5))
    values = level * relaxation * (1 + 0.01 * rng.normal(size=(60, 1)))
    values += 0.004 * rng.normal(size=(60, 100))
    model = RandomConvolutionClassifier().fit(values, labels)
    shares = model._transform(model._check(values))
    is_equal = (shares == shares[0]).all(axis=0)
    # Some equal features have a computed deviation above 0, because their mean is rounded.
    assert (shares[:, is_equal].std(axis=0) > 0.0).any()
    assert np.abs(model.coef_[:, is_equal]).max() < 1e-9


def test_a_waveform_is_told_by_its_shape_and_its_level_alone(few_features):
    rng = np.random.default_rng(3)
    labels = np.where(np.arange(60) % 2, 'high', 'low')
    # The labels differ only in their level, by as much as the noise of one sample.
    level = 1e4 + rng.normal(size=(60, 50)) + (labels == 'high')[:, None]
    # In single precision, this offset would leave no digits for the shape.
    shape, plates = make_trials(offset=1e9, each=20)
    for values, known in ((level, labels), (shape[:, 0], plates)):
        model = RandomConvolutionClassifier().fit(values[::3], known[::3])
        test = np.arange(60) % 3 > 0
        assert np.mean(model.predict(values[test]) == known[test]) > 0.9


def test_evaluation_adds_random_convolutions_to_the_four_for_a_waveform(
    few_features, texture_table
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
    with pytest.raises(DatasetError, match='not texture_spectrum: use glide_waveform'):
        train(texture_table, 'rocket')
    with pytest.raises(DatasetError, match='9 samples or more'):
        RandomConvolutionClassifier().fit(np.zeros((4, 8)), labels)
    with pytest.raises(ValueError, match='50 values are not divisible by 3 channels'):
        RandomConvolutionClassifier(3).fit(np.zeros((4, 50)), labels)
