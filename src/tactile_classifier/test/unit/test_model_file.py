# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Model files: written as trained, refused when damaged or hostile."""

import builtins
import dataclasses
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

import onnx
from onnx import helper, numpy_helper, TensorProto

from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    SCORE_KINDS,
)
from tactile_classifier.model_file import model as model_module
from tactile_classifier.model_file.manifest import FULL_WINDOW
from tactile_classifier.model_file.model import load_model, SCORES, TactileModel
from tactile_classifier.records import CLASSIFIERS, Outcome, UNKNOWN
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import FittedStage, train, Trained
from tactile_features.config import FeatureConfig
from tactile_features.model_contract import MAX_MODEL_BYTES
from tactile_features.onnx_container import open_container, pack_container
from tactile_features.spec import spec_for


def check_answers(trained, model, values, atol):
    """Compare a model file with the estimator and the calibration that it was made of."""
    raw = compute_raw_scores(trained.estimator, values)
    calibration = trained.stages[0].calibration
    expected = raw if calibration is None else calibration.compute(raw)
    found = model.compute(values)
    np.testing.assert_allclose(found.scores, expected, atol=atol, rtol=0)
    answer = np.array(model.labels)[found.answer]
    np.testing.assert_array_equal(answer, trained.estimator.predict(values))


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
    trained = train(table, classifier, scaling)
    model = write_model(tmp_path / 'm.onnx', trained)
    noise = np.random.default_rng(5).normal(size=table.values.shape)
    for values in (table.values, table.values + noise * table.values.std(axis=0) / 3):
        check_answers(trained, model, values, 1e-12)


@pytest.mark.parametrize('scaling', ['none', 'standard'])
@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf'])
def test_features_far_from_zero_keep_double_precision(
    stiffness_table, tmp_path, classifier, scaling
):
    # Single precision would leave nothing of the differences beside the offset.
    values = stiffness_table.values * 1e-3 + 1e6
    trained = train(dataclasses.replace(stiffness_table, values=values), classifier, scaling)
    model = write_model(tmp_path / 'm.onnx', trained)
    # A linear kernel of 1e12 costs four digits in scikit-learn as well.
    check_answers(trained, model, (values + values[::-1]) / 2, 1e-2)


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
    neighbours = trained.estimator.named_steps['classify']
    neighbours.predict = lambda values: np.full(len(values), 'plate 0')
    with pytest.raises(ModelFileError, match='changes the label of 24 of 36 training trials'):
        write_model(path, trained)
    manifest = dataclasses.replace(trained.manifest, labels=trained.manifest.labels[::-1])
    with pytest.raises(ModelFileError, match='labels of the manifest'):
        write_model(path, dataclasses.replace(trained, manifest=manifest))
    labels = np.where(small_table.labels == 'plate 0', UNKNOWN, small_table.labels)
    with pytest.raises(ModelFileError, match='the label "unknown" is the name of an answer'):
        write_model(path, train(dataclasses.replace(small_table, labels=labels), 'knn'))
    assert path.read_bytes() == b'the old one'
    assert list(tmp_path.iterdir()) == [path]


def test_written_file_replaces_and_leaves_nothing_behind(small_table, tmp_path, monkeypatch):
    path = tmp_path / 'm.onnx'
    path.write_bytes(b'old')
    trained = train(small_table, 'tree')
    model = write_model(path, trained)
    assert [p.name for p in tmp_path.iterdir()] == ['m.onnx']
    assert load_model(path).model_id == model.model_id
    assert model.model_id == f'texture-flexion-tree-{model.sha256[:12]}'
    with pytest.raises(ModelFileError, match='cannot write model'):
        write_model(tmp_path / 'no' / 'm.onnx', trained)
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith('skl2onnx'):
            raise ImportError(f'No module named {name}')
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, '__import__', without)
    with pytest.raises(ModelFileError, match='pip install skl2onnx'):
        write_model(path, trained)


# -- damaged files ------------------------------------------------------------------


def test_damaged_bytes_never_reach_the_runtime(model_path, monkeypatch):
    data = model_path.read_bytes()
    monkeypatch.setattr(model_module, 'open_session', lambda data: pytest.fail('reached'))
    rng = np.random.default_rng(0)
    damaged = [data[:size] for size in (*range(40), *range(40, len(data), 997), len(data) - 1)]
    for at in rng.integers(0, len(data), 100):
        damaged.append(bytearray(data))
        damaged[-1][at] ^= 1 << rng.integers(8)
    for each in damaged:
        with pytest.raises(ModelFileError):
            TactileModel(bytes(each))


@pytest.mark.parametrize('content', [b'', b'hello, world', b'\x80\x04\x95'])  # a pickle
def test_what_is_no_model_is_refused_with_its_path(tmp_path, content):
    path = tmp_path / 'm.onnx'
    with pytest.raises(ModelFileError, match=r'cannot read model .*: No such file'):
        load_model(path)
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=r'm\.onnx is refused: it is not an ONNX file'):
        load_model(path)
    with path.open('wb') as file:
        file.truncate(MAX_MODEL_BYTES + 1)
    with pytest.raises(ModelFileError, match='the limit is 64 MiB'):
        load_model(path)


# -- untrusted models with a valid digest -------------------------------------------


def change(path, edit=lambda model: None, manifest=None):
    """Return a model file with another graph or another manifest, as whole as the first."""
    data = path.read_bytes()
    model = onnx.load_model_from_string(data)
    del model.metadata_props[:]
    edit(model)
    old, card, _ = open_container(data)
    return pack_container(model.SerializeToString(), manifest.to_dict() if manifest else old, card)


def extend(model, constants, *nodes):
    """Add constants by name, and operators, to a graph."""
    for name, value in constants.items():
        model.graph.initializer.append(numpy_helper.from_array(np.asarray(value), name))
    model.graph.node.extend(helper.make_node(*node[:3], **dict(node[3:])) for node in nodes)


def rename(model, old, new):
    for node in model.graph.node:
        node.output[:] = [new if name == old else name for name in node.output]


def add_ballast(model, doubles):
    """Make a matrix of this many doubles squared out of two vectors before the model answers."""
    rename(model, SCORES, 'raw')
    ones = np.ones(doubles)
    extend(
        model,
        {'column': ones[:, np.newaxis], 'row': ones[np.newaxis], 'both_axes': [0, 1]},
        ('MatMul', ['column', 'row'], ['ballast']),
        ('ReduceSum', ['ballast', 'both_axes'], ['total'], ('keepdims', 0)),
        ('Add', ['raw', 'total'], [SCORES]),
    )


def multiply(model):
    names = ['square', *(f'power_{i}' for i in range(5))]
    products = [('MatMul', [before, 'square'], [after]) for before, after in pairwise(names)]
    extend(model, {'square': np.ones((1500, 1500))}, *products)


def reshape(model):
    extend(
        model,
        {},
        ('Cast', ['features'], ['shape'], ('to', TensorProto.INT64)),
        ('Reshape', ['features', 'shape'], ['any']),
    )


def give_another_answer(model):
    rename(model, 'answer', 'raw_answer')
    extend(model, {'seven': [[7]]}, ('Add', ['raw_answer', 'seven'], ['answer']))


def replace_graph(model):
    info = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, [None, 91]) for n in 'ab']
    nodes = [helper.make_node('Identity', ['a'], ['b'])]
    model.graph.CopyFrom(helper.make_graph(nodes, 'g', info[:1], info[1:]))


@pytest.mark.parametrize(
    ('edit', 'message'),
    [
        (lambda model: add_ballast(model, 5000), r'values with .* multiplications for one window'),
        (multiply, r'16,875,0.* multiplications for one window'),
        (reshape, r'shapes in its graph|cannot be known'),
        (give_another_answer, 'answers with a label that it lacks'),
        (replace_graph, 'from features to answer, scores, novelty'),
    ],
)
def test_graphs_that_ask_for_too_much_or_have_another_form_are_refused(model_path, edit, message):
    with pytest.raises(ModelFileError, match=message):
        TactileModel(change(model_path, edit))


def test_a_graph_may_compute_up_to_the_limit(model_path):
    assert TactileModel(change(model_path, lambda model: add_ballast(model, 1000))).labels


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'labels': ('a', 'b')}, 'answers with a label that it lacks'),
        (
            {'spec': spec_for('texture', FeatureConfig(texture_samples=90))},
            'the feature set has 46 features',
        ),
        ({'stages': (FULL_WINDOW,)}, 'does not lead from features to answer, scores'),
    ],
)
def test_a_graph_under_the_manifest_of_another_is_refused(model_path, changes, message):
    manifest = dataclasses.replace(load_model(model_path).manifest, **changes)
    with pytest.raises(ModelFileError, match=message):
        TactileModel(change(model_path, manifest=manifest))


@pytest.fixture(scope='module')
def rocket_path(small_table, tmp_path_factory):
    rng = np.random.default_rng(2)
    spec = spec_for('texture', FeatureConfig(texture_features='glide_waveform'))
    level = np.unique(small_table.labels, return_inverse=True)[1]
    values = rng.normal(size=(len(small_table), len(spec.names))) + level[:, np.newaxis]
    path = tmp_path_factory.mktemp('rocket') / 'rocket.onnx'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(random_convolutions, 'FEATURES', 168)
        write_model(
            path, train(dataclasses.replace(small_table, values=values, spec=spec), 'rocket')
        )
    return path


def change_constants(path, kind, new):
    """Return the model file with other constants of one type."""

    def edit(model):
        for tensor in model.graph.initializer:
            if tensor.data_type == kind:
                array = numpy_helper.to_array(tensor)
                changed = np.asarray(new(array), array.dtype)
                tensor.CopyFrom(numpy_helper.from_array(changed, tensor.name))

    return change(path, edit)


def test_a_rocket_whose_kernels_reach_beyond_the_waveform_is_refused(rocket_path):
    assert load_model(rocket_path).manifest.classifier == 'rocket'

    def reach(array):
        return np.where(array == array.max(), 10**9, array) if array.size > 9 else array

    with pytest.raises(ModelFileError, match='its graph does not run'):
        TactileModel(change_constants(rocket_path, TensorProto.INT64, reach))


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_rocket_with_weights_that_are_not_finite_names_nothing(rocket_path, value, make_window):
    def spoil(array):
        return np.full_like(array, value) if array.ndim == 2 else array

    model = TactileModel(change_constants(rocket_path, TensorProto.DOUBLE, spoil))
    window = make_window(
        feature_set='glide_waveform',
        feature_set_version=model.spec.version,
        values=np.arange(float(len(model.spec.names))),
        specification_digest=model.spec.digest,
    )
    answer = model.classify_window(window)
    assert (answer.outcome, answer.label) == (Outcome.NO_FEATURES, '')
    assert 'no finite scores' in answer.reason
