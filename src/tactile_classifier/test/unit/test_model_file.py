# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of writing model files, and of refusing damaged or malicious ones."""

import dataclasses
import subprocess
import sys

from model_checks import check_model
import numpy as np
import pytest

from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    SCORE_KINDS,
)
from tactile_classifier.model_file import prediction
from tactile_classifier.model_file.manifest import Confidence
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.training import model_writer
from tactile_classifier.training.model_writer import check_labels, make_predictor, write_model
from tactile_classifier.training.trainer import train, Trained
from tactile_classifier.types import CLASSIFIERS, PredictionOutcome, UNKNOWN
from tactile_features.config import FeatureConfig
from tactile_features.model_container import MAX_MODEL_BYTES, open_container, pack_container
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


def test_many_windows_of_many_trials_fit_into_the_memory_limit(small_table, tmp_path):
    values = np.random.default_rng(2).normal(size=(4000, 91))
    estimator = build_estimator('knn', 'none').fit(values, np.tile(['a', 'b'], 2000))
    trained = train(small_table.take(small_table.labels != 'plate 2'), 'knn', 'none')
    manifest = dataclasses.replace(
        trained.manifest, labels=('a', 'b'), confidence=Confidence(), score_kind=SCORE_KINDS['knn']
    )
    write_model(tmp_path / 'm.npz', Trained(estimator, values[:64], None, None, manifest))


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


def test_equal_distances_go_to_the_earlier_trial_and_equal_votes_to_the_first_label():
    def answer(trials, labels, row=(0.0,)):
        names, codes = np.unique(list(labels), return_inverse=True)
        knn = prediction.Neighbours(np.array(trials)[:, None], np.eye(len(names))[codes])
        return names[knn.compute(np.array(row)).argmax()]

    assert answer([1.0, -2.0, 3.0], 'cba') == 'a'  # if votes are equal, the first label
    assert answer([0.1, 1.0, 1.1, 9.0], 'abba') == 'b'
    assert answer([1.0] * 5, 'babaa') == 'b'  # the three earliest of equal trials
    assert answer([1.0, -1.0, 1.0, -1.0], 'bbaa') == 'b'


def test_a_pair_of_labels_with_a_value_of_zero_votes_for_the_first():
    np.testing.assert_array_equal(prediction.count_votes(np.array([0.5])), [-0.5, 0.5])
    votes = prediction.count_votes(np.zeros(3))
    np.testing.assert_array_equal(votes, [2.0, 1.0, 0.0])
    # Label 0 loses both of its pairs. Label 1 wins both of its pairs, (0, 1) and (1, 2).
    one_sided = prediction.count_votes(np.array([-1.0, -1.0, 1e-300]))
    assert one_sided.argmax() == 1
    np.testing.assert_allclose(one_sided, [-2 / 9, 2 + 1 / 6, 1 + 1 / 6])


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


# -- damaged files ------------------------------------------------------------------


def test_damaged_bytes_are_refused(model_path):
    data = model_path.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [data[:size] for size in (*range(40), *range(40, len(data), 9_973), len(data) - 1)]
    for at in rng.integers(0, len(data), 100):
        damaged.append(bytearray(data))
        damaged[-1][at] ^= 1 << rng.integers(8)
    whole = TactileModel(data)
    for each in damaged:
        try:
            found = TactileModel(bytes(each))
        except ModelFileError:
            continue
        # The damaged bit does not belong to the contents; it may be in a date, for example.
        assert len(each) == len(data)
        assert found.manifest == whole.manifest


@pytest.mark.parametrize('content', [b'', b'hello, world', b'\x80\x04\x95'])
def test_what_is_no_model_is_refused_with_its_path(tmp_path, content):
    path = tmp_path / 'm.npz'
    with pytest.raises(ModelFileError, match=r'cannot read model .*: No such file'):
        load_model(path)
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=r'm\.npz is refused: it is not an \.npz file'):
        load_model(path)
    with path.open('wb') as file:
        file.truncate(MAX_MODEL_BYTES + 1)
    with pytest.raises(ModelFileError, match='the limit is 64 MiB'):
        load_model(path)


# -- untrusted models with a valid digest -------------------------------------------


def change(path, arrays=(), **entries):
    """Return a model file with changed arrays and entries; an array that is None is removed."""
    manifest, old = open_container(path.read_bytes())
    new = {**old, **dict(arrays)}
    kept = {name: array for name, array in new.items() if array is not None}
    return pack_container({**manifest, **entries}, kept)


LINEAR = {
    'classifier.coefficients': np.zeros((3, 91)),
    'classifier.intercept': np.zeros(3),
    'novelty.scale': np.ones(36),
}


@pytest.mark.parametrize(
    ('name', 'edit', 'message'),
    [
        ('classifier.coefficients', lambda a: None, 'has no array "classifier.coefficients"'),
        ('novelty.within', lambda a: None, 'it has no array "novelty.within"'),
        ('classifier.trials', lambda a: np.zeros(3), 'unexpected array "classifier.trials"'),
        (
            '60.classifier.intercept',
            lambda a: np.zeros(3),
            'unexpected array "60.classifier.intercept"',
        ),
        ('classifier.intercept', lambda a: a.astype(np.float32), 'has type float32, not float64'),
        ('classifier.intercept', lambda a: np.arange(3), 'has type int64, not float64'),
        ('classifier.coefficients', lambda a: a[:, 1:], r'shape \(3, 90\); it must be \(3, 91\)'),
        ('classifier.coefficients', lambda a: a[0], r'has shape \(91,\); it must be'),
        ('classifier.intercept', lambda a: a[:2], r'shape \(2,\); it must be \(3,\), that is'),
        ('novelty.means', lambda a: a[:2], r'shape \(2, 91\); it must be \(3, 91\)'),
        ('novelty.references', lambda a: a * np.nan, 'has values that are not finite'),
        ('classifier.intercept', lambda a: a + np.inf, 'has values that are not finite'),
        ('novelty.scales', lambda a: a * 0.0, r'"scales" are not positive \(novelty\)'),
    ],
)
def test_an_array_that_does_not_fit_is_named(model_path, name, edit, message):
    old = open_container(model_path.read_bytes()).arrays.get(name)
    with pytest.raises(ModelFileError, match=message):
        TactileModel(change(model_path, {name: edit(old)}))


def test_arrays_under_the_manifest_of_another_model_are_refused(model_path):
    manifest = load_model(model_path).manifest
    half = spec_for('texture', FeatureConfig(texture_samples=90))

    def load(**changes):
        entries = dataclasses.replace(manifest, **changes).to_dict()
        TactileModel(change(model_path, **entries))

    load()
    for changes, message in (
        ({'labels': ('a', 'b', 'c', 'd')}, 'values of its array "intercept" are inconsistent'),
        ({'spec': half}, r'it must be \(3, 46\)'),
        ({'confidence': Confidence()}, 'its calibration and its kind of scores are inconsistent'),
        ({'scaling': 'standard'}, 'has no array "scaling.mean"'),
        ({'classifier': 'tree'}, 'has no array "classifier.feature"'),
        (
            {'confidence': dataclasses.replace(manifest.confidence, novelty_threshold=-1.0)},
            'unexpected array "novelty.centre"',
        ),
    ):
        with pytest.raises(ModelFileError, match=message):
            load(**changes)


def test_a_card_that_a_terminal_would_obey_is_refused(model_path):
    for card, message in (
        ('\x1b[2J', 'not plain text'),
        (3, 'not plain text'),
        ('a' * 70_000, 'KiB'),
    ):
        with pytest.raises(ModelFileError, match=message):
            TactileModel(change(model_path, card=card))


@pytest.fixture(scope='module')
def tree_path(small_table, tmp_path_factory):
    path = tmp_path_factory.mktemp('tree') / 'tree.npz'
    write_model(path, train(small_table, 'tree'))
    return path


@pytest.mark.parametrize(
    ('name', 'edit'),
    [
        ('feature', lambda a: np.where(a >= 0, 91, a)),
        ('feature', lambda a: np.where(a >= 0, -1, a)),
        ('below', lambda a: np.where(a >= 0, 0, a)),  # the path returns to the root
        ('above', lambda a: np.where(a >= 0, len(a), a)),
    ],
)
def test_a_tree_without_an_end_is_refused(tree_path, name, edit):
    old = open_container(tree_path.read_bytes()).arrays[f'classifier.{name}']
    with pytest.raises(ModelFileError, match=f'"{name}" are inconsistent with other arrays'):
        TactileModel(change(tree_path, {f'classifier.{name}': edit(old)}))


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
        TactileModel(change(rocket_path, {f'classifier.{name}': edit(old)}))


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
        TactileModel(change(rocket_path, huge))


def test_scores_that_are_not_finite_name_nothing(rocket_path, make_window):
    huge = {'classifier.intercept': np.full(3, 1e308), 'classifier.coefficients': None}
    old = open_container(rocket_path.read_bytes()).arrays['classifier.coefficients']
    huge['classifier.coefficients'] = np.full(old.shape, 1e308)
    model = TactileModel(change(rocket_path, huge))
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
        'import sys; import numpy as np; from tactile_classifier import load_model\n'
        'import tactile_classifier.model_set\n'
        f'for path in ({str(rocket_path)!r}, {str(model_path)!r}):\n'
        '    model = load_model(path)\n'
        '    model.predict(np.zeros((1, len(model.spec.names))))\n'
        'assert not {"sklearn", "scipy", "numba"} & {n.partition(".")[0] for n in sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True)
