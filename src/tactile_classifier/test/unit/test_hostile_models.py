# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted models with a valid digest: refused, or limited in what they ask for."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

import onnx
from onnx import helper, numpy_helper, TensorProto

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.model_file.manifest import FULL_WINDOW
from tactile_classifier.model_file.model import load_model, read_manifest, SCORES, TactileModel
from tactile_classifier.records import Outcome
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.onnx_container import open_container, pack_container
from tactile_features.spec import spec_for


def change(path, edit=lambda model: None, manifest=None):
    """Return a model file with another graph or another manifest, as whole as the first."""
    data = path.read_bytes()
    model = onnx.load_model_from_string(data)
    del model.metadata_props[:]
    edit(model)
    old, card, _ = open_container(data)
    return pack_container(model.SerializeToString(), manifest.to_dict() if manifest else old, card)


def add_ballast(model, doubles):
    """Make a matrix of this many doubles squared out of two vectors before the model answers."""
    for node in model.graph.node:
        node.output[:] = ['raw' if name == SCORES else name for name in node.output]
    ones = np.ones(doubles)
    model.graph.initializer.append(numpy_helper.from_array(ones[:, np.newaxis], 'column'))
    model.graph.initializer.append(numpy_helper.from_array(ones[np.newaxis], 'row'))
    model.graph.initializer.append(numpy_helper.from_array(np.array([0, 1]), 'both_axes'))
    model.graph.node.extend(
        [
            helper.make_node('MatMul', ['column', 'row'], ['ballast']),
            helper.make_node('ReduceSum', ['ballast', 'both_axes'], ['total'], keepdims=0),
            helper.make_node('Add', ['raw', 'total'], [SCORES]),
        ]
    )


def test_a_graph_may_compute_up_to_the_limit(model_path):
    assert TactileModel(change(model_path, lambda model: add_ballast(model, 1000))).labels
    too_much = change(model_path, lambda model: add_ballast(model, 5000))
    with pytest.raises(ModelFileError, match=r'values with .* multiplications for one window'):
        TactileModel(too_much)


def test_large_products_of_matrices_are_refused_before_they_are_computed(model_path):
    def multiply(model):
        square = np.ones((1500, 1500))
        model.graph.initializer.append(numpy_helper.from_array(square, 'square'))
        names = ['square', *(f'power_{i}' for i in range(5))]
        model.graph.node.extend(
            helper.make_node('MatMul', [before, 'square'], [after])
            for before, after in pairwise(names)
        )

    with pytest.raises(ModelFileError, match=r'16,875,0.* multiplications for one window'):
        TactileModel(change(model_path, multiply))


def test_a_size_that_only_the_window_tells_is_refused(model_path):
    def reshape(model):
        model.graph.node.extend(
            [
                helper.make_node('Cast', ['features'], ['shape'], to=TensorProto.INT64),
                helper.make_node('Reshape', ['features', 'shape'], ['any']),
            ]
        )

    with pytest.raises(ModelFileError, match=r'shapes in its graph|cannot be known'):
        TactileModel(change(model_path, reshape))


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
    manifest = dataclasses.replace(read_manifest(model_path), **changes)
    data = change(model_path, manifest=manifest)
    with pytest.raises(ModelFileError, match=message):
        TactileModel(data)


def test_graph_of_another_form_is_refused(model_path):
    info = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, [None, 91]) for n in 'ab']
    graph = helper.make_graph(
        [helper.make_node('Identity', ['a'], ['b'])], 'g', info[:1], info[1:]
    )
    with pytest.raises(ModelFileError, match='from features to answer, scores, novelty'):
        TactileModel(change(model_path, lambda model: model.graph.CopyFrom(graph)))


def test_an_answer_that_is_no_label_is_none(model_path):
    def count_on(model):
        for node in model.graph.node:
            node.output[:] = ['raw_answer' if name == 'answer' else name for name in node.output]
        model.graph.initializer.append(numpy_helper.from_array(np.array([[7]]), 'seven'))
        model.graph.node.append(helper.make_node('Add', ['raw_answer', 'seven'], ['answer']))

    with pytest.raises(ModelFileError, match='answers with a label that it lacks'):
        TactileModel(change(model_path, count_on))


@pytest.fixture(scope='module')
def rocket_path(small_table, tmp_path_factory):
    rng = np.random.default_rng(2)
    spec = spec_for('texture', FeatureConfig(texture_features='glide_waveform'))
    level = np.searchsorted(np.unique(small_table.labels), small_table.labels)
    values = rng.normal(size=(len(small_table), len(spec.names))) + level[:, np.newaxis]
    table = FeatureTable(values, small_table.labels, spec, small_table.columns)
    path = tmp_path_factory.mktemp('rocket') / 'rocket.onnx'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(random_convolutions, 'FEATURES', 168)
        write_model(path, train(table, 'rocket'))
    return path


def change_constants(path, kind, new):
    """Return the model file with other constants of one type."""

    def edit(model):
        for tensor in model.graph.initializer:
            if tensor.data_type == kind:
                array = numpy_helper.to_array(tensor)
                tensor.CopyFrom(
                    numpy_helper.from_array(np.asarray(new(array), array.dtype), tensor.name)
                )

    data = change(path, edit)
    assert data != path.read_bytes()
    return data


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
