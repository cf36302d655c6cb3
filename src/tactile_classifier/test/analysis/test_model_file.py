# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of writing model files, and of refusing damaged or malicious ones."""

import dataclasses
import subprocess
import sys
import tracemalloc

from model_checks import change_file, check_model
import numpy as np
import pytest

from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import (
    build_estimator,
)
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.training import model_writer
from tactile_classifier.training.model_writer import check_labels, make_predictor, write_model
from tactile_classifier.training.trainer import train, Trained
from tactile_classifier.types import CLASSIFIERS, PredictionOutcome, UNKNOWN
from tactile_features.config import FeatureConfig
from tactile_features.model_container import open_container
from tactile_features.spec import spec_for


@pytest.mark.parametrize('classifier', CLASSIFIERS)
@pytest.mark.parametrize(
    ('labels', 'scaling'),
    [('eight', 'standard'), ('two', 'none'), ('two', 'standard'), ('stiffness', 'standard')],
)
def test_model_file_answers_as_scikit_learn_does(
    texture_table, stiffness_table, tmp_path, labels, classifier, scaling
):
    table = {
        'eight': texture_table.take(np.arange(0, 480, 4)),
        'two': texture_table.take(np.arange(0, 120, 4)),
        'stiffness': stiffness_table,
    }[labels]
    noise = np.random.default_rng(5).normal(size=table.values.shape)
    near = table.values + noise * table.values.std(axis=0) / 3
    values = np.concatenate([table.values, near])
    check_model(train(table, classifier, scaling), tmp_path / 'm.npz', values)


@pytest.mark.parametrize('scaling', ['none', 'standard'])
@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf'])
def test_features_far_from_zero_keep_double_precision(
    stiffness_table, tmp_path, classifier, scaling
):
    # In single precision, the offset would leave no digits for the differences.
    values = stiffness_table.values * 1e-3 + 1e6
    trained = train(dataclasses.replace(stiffness_table, values=values), classifier, scaling)
    # The values of the linear kernel are so large that scikit-learn also loses four digits.
    check_model(trained, tmp_path / 'm.npz', (values + values[::-1]) / 2, 1e-2)


def test_the_memory_for_many_windows_of_many_trials_is_that_of_a_copy_of_the_trials():
    values = np.random.default_rng(2).normal(size=(4000, 91))
    estimator = build_estimator('knn', 'none').fit(values, np.tile(['a', 'b'], 2000))
    predictor = make_predictor(Trained(estimator, values, None, None, None))
    windows = values[:300] + 1e-3  # their distances from all trials would take 10 MB
    tracemalloc.start()
    try:
        scores = predictor.compute_raw_scores(windows)
        assert tracemalloc.get_traced_memory()[1] < 1.2 * values.nbytes
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(scores.argmax(axis=1) == 0, estimator.predict(windows) == 'a')


def test_a_model_that_changes_labels_is_not_written(small_table, tmp_path):
    trained = train(small_table, 'knn', 'none')
    path = tmp_path / 'm.npz'
    path.write_bytes(b'the old one')
    manifest = dataclasses.replace(trained.manifest, labels=trained.manifest.labels[::-1])
    with pytest.raises(ModelFileError, match='labels of manifest and estimator'):
        write_model(path, dataclasses.replace(trained, manifest=manifest))
    labels = np.where(small_table.labels == 'plate 0', UNKNOWN, small_table.labels)
    with pytest.raises(ModelFileError, match='the label "unknown" is reserved'):
        write_model(path, train(dataclasses.replace(small_table, labels=labels), 'knn'))
    # The estimator now predicts other labels than the model, as if the model had a fault.
    trained.estimator[-1].predict = lambda values: np.full(len(values), 'plate 0')
    with pytest.raises(ModelFileError, match='labels of 24 of 36 training trials differ from'):
        write_model(path, trained)
    assert path.read_bytes() == b'the old one'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('classifier', CLASSIFIERS)
@pytest.mark.parametrize('labels', [2, 3])
def test_a_fault_that_shows_only_near_borders_is_found(small_table, classifier, labels):
    table = small_table.take(small_table.labels < f'plate {labels}')
    trained = train(table, classifier, 'standard')
    predictor = make_predictor(trained)
    check_labels(predictor, trained.estimator, trained.values)
    # The changed estimator predicts another label at one point between two trials only.
    near = model_writer._find_points_near_borders(predictor, trained.values)
    real, names = trained.estimator.predict, trained.estimator.classes_
    turned = dict(zip(names, np.roll(names, 1), strict=True))

    def predict(values):
        found = real(values)
        is_near = (values == near[0]).all(axis=1)
        return np.where(is_near, [turned[label] for label in found], found)

    trained.estimator.predict = predict
    with pytest.raises(ModelFileError, match='labels of 1 of 1000 points near boundaries differ'):
        check_labels(predictor, trained.estimator, trained.values)


@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf'])
@pytest.mark.parametrize('labels', ['ab', 'abcd'])
def test_a_label_that_rounding_decides_may_differ(classifier, labels):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(60, 3)) + 4.0 * np.eye(4, 3)[np.arange(60) % 4]
    names = np.array(list(labels))[np.arange(60) % len(labels)]
    estimator = build_estimator(classifier, 'none').fit(values, names)
    part = make_predictor(Trained(estimator, values, None, None, None)).classifier
    low, high = first, second = values[0], values[1]
    assert (part.compute(first).argmax(), part.compute(second).argmax()) == (0, 1)
    for _ in range(60):
        middle = (low + high) / 2
        is_low = part.compute(middle).argmax() == 0
        low, high = (middle, high) if is_low else (low, middle)
    border = (low + high) / 2
    for point, is_decided in (
        (border, False),
        (border + 1e-11 * (second - first), False),
        (border + 1e-4 * (second - first), True),
        (second, True),
    ):
        assert (part.find_margin(point) > model_writer.ROUNDING) == is_decided


def test_written_file_replaces_and_leaves_nothing_behind(small_table, tmp_path, monkeypatch):
    path = tmp_path / 'm.npz'
    path.write_bytes(b'old')
    trained = train(small_table, 'tree')
    model = write_model(path, trained)
    assert [p.name for p in tmp_path.iterdir()] == ['m.npz']
    assert load_model(path).model_id == model.model_id
    assert model.model_id == f'texture-flexion-tree-{model.sha256[:12]}'
    with pytest.raises(ModelFileError, match='cannot write model'):
        write_model(tmp_path / 'no' / 'm.npz', trained)


# -- random convolutions ------------------------------------------------------------


@pytest.fixture(scope='module')
def rocket_path(small_table, tmp_path_factory):
    rng = np.random.default_rng(2)
    spec = spec_for('texture', FeatureConfig(texture_features='glide_waveform'))
    level = np.unique(small_table.labels, return_inverse=True)[1]
    values = rng.normal(size=(len(small_table), len(spec.names))) + level[:, np.newaxis]
    path = tmp_path_factory.mktemp('rocket') / 'rocket.npz'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(random_convolutions, 'FEATURES', 168)
        write_model(
            path, train(dataclasses.replace(small_table, values=values, spec=spec), 'rocket')
        )
    return path


@pytest.mark.parametrize(
    ('name', 'edit'),
    [
        ('dilations', lambda a: a * 10**9),  # kernels that reach beyond the waveform
        ('dilations', lambda a: a * 0),
        ('counts', lambda a: a + 1),
        ('counts', lambda a: a - a),
        ('sources', lambda a: a + 1),
        ('sources', lambda a: a - 1),
        ('samples', lambda a: a + 1),
    ],
)
def test_convolutions_that_do_not_fit_are_refused(rocket_path, name, edit):
    assert load_model(rocket_path).manifest.classifier == 'rocket'
    old = open_container(rocket_path.read_bytes()).arrays[f'classifier.{name}']
    with pytest.raises(ModelFileError, match='are inconsistent with other arrays'):
        TactileModel(change_file(rocket_path, {f'classifier.{name}': edit(old)}))


def test_counts_of_convolutions_are_added_without_overflow(rocket_path):
    classifier = load_model(rocket_path).predictor.classifier
    features = classifier.references.shape[1] * int(classifier.samples)
    classifier.check(features, len(classifier.intercept))
    # These counts have the same sum as the right ones modulo 2**64.
    counts = np.array([2**63 - 1, 2**63 - 1, classifier.counts.sum() + 2])
    with pytest.raises(ModelFileError, match='biases'):
        dataclasses.replace(classifier, counts=counts).check(features, len(classifier.intercept))


def test_convolutions_that_take_too_long_are_refused(rocket_path):
    arrays = open_container(rocket_path.read_bytes()).arrays
    counts = arrays['classifier.counts'] + 2**26 // 2 // 180 // 84
    shares = 84 * int(counts.sum())
    huge = {
        'classifier.counts': counts,
        'classifier.biases': np.zeros((2, shares), dtype=np.float32),
        'classifier.coefficients': np.zeros((3, 2 * shares)),
    }
    with pytest.raises(ModelFileError, match='for one window; the limit is 67,108,864'):
        TactileModel(change_file(rocket_path, huge))


def test_scores_that_are_not_finite_name_nothing(rocket_path, make_window):
    huge = {'classifier.intercept': np.full(3, 1e308), 'classifier.coefficients': None}
    old = open_container(rocket_path.read_bytes()).arrays['classifier.coefficients']
    huge['classifier.coefficients'] = np.full(old.shape, 1e308)
    model = TactileModel(change_file(rocket_path, huge))
    window = make_window(
        feature_set='glide_waveform',
        feature_set_version=model.spec.version,
        values=np.arange(float(len(model.spec.names))),
        specification_digest=model.spec.digest,
    )
    for each in (window, dataclasses.replace(window, values=window.values * 1e40)):
        answer = model.classify_window(each)
        assert (answer.outcome, answer.label) == (PredictionOutcome.NO_FEATURES, '')
        assert 'are not finite' in answer.reason


def test_a_loaded_model_needs_neither_scikit_learn_nor_numba(rocket_path, model_path):
    program = (
        'import sys, numpy; from tactile_classifier import load_model\n'
        'import tactile_classifier.model_set\n'
        'windows = numpy.random.default_rng(0).normal(size=(3, 180))\n'
        f'for path in ({str(rocket_path)!r}, {str(model_path)!r}):\n'
        '    model = load_model(path)\n'
        '    for values in (windows, windows[:, : len(model.spec.names)]):\n'
        '        for name in ("predict", "predict_or_unknown", "predict_proba", "novelty", '
        '"p_value"):\n'
        '            assert len(getattr(model, name)(values)) == 3\n'
        'assert not {"sklearn", "scipy", "numba"} & {n.partition(".")[0] for n in sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True)
