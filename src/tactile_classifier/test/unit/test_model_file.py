# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import builtins
import dataclasses

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    SCORE_KINDS,
)
from tactile_classifier.model_file import model as model_module
from tactile_classifier.model_file.manifest import FULL_WINDOW
from tactile_classifier.model_file.model import load_model, read_manifest, TactileModel
from tactile_classifier.records import CLASSIFIERS, SCALINGS
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import FittedStage, train, Trained
from tactile_features.config import FeatureConfig
from tactile_features.model_contract import MAX_MODEL_BYTES
from tactile_features.spec import spec_for

READERS = (load_model, read_manifest)


def expected_scores(trained, values):
    scores = compute_raw_scores(trained.estimator, values)
    calibration = trained.stages[0].calibration
    return scores if calibration is None else calibration.compute(scores)


@pytest.mark.parametrize('scaling', SCALINGS)
@pytest.mark.parametrize('classifier', CLASSIFIERS)
@pytest.mark.parametrize('labels', ['eight textures', 'two textures', 'stiffness'])
def test_model_file_answers_as_scikit_learn_does(
    texture_table, stiffness_table, tmp_path, labels, classifier, scaling
):
    table = {
        'eight textures': texture_table.take(np.arange(0, 480, 4)),
        'two textures': texture_table.take(np.arange(0, 120, 4)),
        'stiffness': stiffness_table,
    }[labels]
    trained = train(table, classifier, scaling)
    write_model(tmp_path / 'm.onnx', trained)
    model = load_model(tmp_path / 'm.onnx')
    rng = np.random.default_rng(5)
    size = table.values.std(axis=0)
    for values in (table.values, table.values + rng.normal(size=table.values.shape) * size / 3):
        scores = model.compute(values).scores
        np.testing.assert_allclose(scores, expected_scores(trained, values), atol=1e-12, rtol=0)
        answer = np.array(model.labels)[model.compute(values).answer]
        np.testing.assert_array_equal(answer, trained.estimator.predict(values))


@pytest.mark.parametrize('scaling', SCALINGS)
@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf'])
def test_features_far_from_zero_keep_double_precision(
    stiffness_table, tmp_path, classifier, scaling
):
    # Single precision would leave nothing of the differences beside the offset.
    values = stiffness_table.values * 1e-3 + 1e6
    table = FeatureTable(values, stiffness_table.labels, stiffness_table.spec)
    trained = train(table, classifier, scaling)
    model = write_model(tmp_path / 'm.onnx', trained)
    between = (values + values[::-1]) / 2
    answer = np.array(model.labels)[model.compute(between).answer]
    np.testing.assert_array_equal(answer, trained.estimator.predict(between))
    # A linear kernel of 1e12 costs four digits in scikit-learn as well.
    expected = expected_scores(trained, between)
    np.testing.assert_allclose(model.compute(between).scores, expected, atol=1e-2)


def test_many_windows_of_many_trials_fit_into_the_memory_limit(small_table, tmp_path):
    values = np.random.default_rng(2).normal(size=(4000, 91))
    estimator = build_estimator('knn', 'none').fit(values, np.tile(['a', 'b'], 2000))
    trained = train(small_table.take(small_table.labels != 'plate 2'), 'knn', 'none')
    part = FittedStage(0, estimator, values[:64], None, None)
    manifest = dataclasses.replace(
        trained.manifest, labels=('a', 'b'), stages=(FULL_WINDOW,), score_kind=SCORE_KINDS['knn']
    )
    # All differences of 64 windows at once would be 186 MB.
    write_model(tmp_path / 'm.onnx', Trained((part,), manifest))


def test_model_that_changes_labels_is_not_written(small_table, tmp_path):
    trained = train(small_table, 'knn', 'none')
    path = tmp_path / 'm.onnx'
    path.write_bytes(b'the old one')
    # Other labels on the same neighbours, as a faulty conversion would give.
    trained.estimator.named_steps['classify'].predict = lambda values: np.full(
        len(values), 'plate 0'
    )
    with pytest.raises(ModelFileError, match='changes the label of 24 of 36 training trials'):
        write_model(path, trained)
    assert path.read_bytes() == b'the old one'
    assert list(tmp_path.iterdir()) == [path]


def test_labels_of_manifest_must_be_the_estimators(small_table, tmp_path):
    trained = train(small_table, 'tree')
    manifest = dataclasses.replace(trained.manifest, labels=trained.manifest.labels[::-1])
    with pytest.raises(ModelFileError, match='labels of the manifest'):
        write_model(tmp_path / 'm.onnx', dataclasses.replace(trained, manifest=manifest))


def test_written_file_replaces_and_leaves_nothing_behind(small_table, tmp_path):
    path = tmp_path / 'm.onnx'
    path.write_bytes(b'old')
    trained = train(small_table, 'knn')
    model = write_model(path, trained)
    assert [p.name for p in tmp_path.iterdir()] == ['m.onnx']
    assert load_model(path).model_id == model.model_id
    with pytest.raises(ModelFileError, match='cannot write model'):
        write_model(tmp_path / 'no' / 'm.onnx', trained)


def test_missing_skl2onnx_says_what_to_install(small_table, tmp_path, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith('skl2onnx'):
            raise ImportError(f'No module named {name}')
        return real(name, *args, **kwargs)

    trained = train(small_table, 'tree')
    monkeypatch.setattr(builtins, '__import__', without)
    with pytest.raises(ModelFileError, match='pip install skl2onnx'):
        write_model(tmp_path / 'm.onnx', trained)


# -- loading ------------------------------------------------------------------------


def test_model_id_names_task_contact_classifier_and_content(model_path):
    model = load_model(model_path)
    assert model.model_id.startswith('texture-flexion-svm_linear-')
    assert len(model.model_id.rsplit('-', 1)[1]) == 12


def test_truncated_file_is_refused_at_any_length(model_path):
    data = model_path.read_bytes()
    for size in [*range(40), *range(40, len(data), 997), len(data) - 1]:
        with pytest.raises(ModelFileError):
            TactileModel(data[:size])


def test_flipped_bits_never_reach_the_runtime(model_path, monkeypatch):
    data = model_path.read_bytes()
    monkeypatch.setattr(model_module, 'open_session', lambda data: pytest.fail('reached'))
    rng = np.random.default_rng(0)
    for at in rng.integers(0, len(data), 100):
        damaged = bytearray(data)
        damaged[at] ^= 1 << rng.integers(8)
        with pytest.raises(ModelFileError):
            TactileModel(bytes(damaged))


@pytest.mark.parametrize('content', [b'', b'hello, world', b'\x80\x04\x95'])  # a pickle
@pytest.mark.parametrize('read', READERS)
def test_what_is_no_model_is_refused_with_its_path(tmp_path, content, read):
    path = tmp_path / 'm.onnx'
    with pytest.raises(ModelFileError, match=r'cannot read model .*: No such file'):
        read(path)
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=r'm\.onnx is refused: it is not an ONNX file'):
        read(path)
    with path.open('wb') as file:
        file.truncate(MAX_MODEL_BYTES + 1)
    with pytest.raises(ModelFileError, match='the limit is 64 MiB'):
        read(path)


def test_the_manifest_alone_is_read_without_a_runtime(model_path, monkeypatch, tmp_path):
    whole = load_model(model_path)
    monkeypatch.setattr(model_module, 'open_session', lambda data: pytest.fail('a session'))
    assert read_manifest(model_path) == whole.manifest
    changed = tmp_path / 'm.onnx'
    changed.write_bytes(model_path.read_bytes().replace(b'plate 0', b'plate 9'))
    with pytest.raises(ModelFileError, match='changed or damaged'):
        read_manifest(changed)


def test_features_of_another_window_do_not_fit(model_path):
    model = load_model(model_path)
    model.check_fits(spec_for('texture', FeatureConfig()))
    with pytest.raises(ModelFileError, match='rate in Hz differs'):
        model.check_fits(spec_for('texture', FeatureConfig(rate_hz=100.0)))
    with pytest.raises(ModelFileError, match='feature set differs'):
        model.check_fits(spec_for('stiffness', FeatureConfig()))
