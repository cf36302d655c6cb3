# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted models with a valid digest: what they may ask of the process is limited."""

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

import onnx
from onnx import helper, numpy_helper, TensorProto

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import SCORES, TactileModel
from tactile_classifier.model_file.onnx_container import open_container, seal
from tactile_classifier.model_file.onnx_session import MAX_INFERENCE_BYTES
from tactile_classifier.records import Outcome
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def with_ballast(path, doubles):
    """Return the model with this many doubles made and added up before it answers."""
    data = path.read_bytes()
    manifest = open_container(data)
    model = onnx.load_model_from_string(data)
    del model.metadata_props[:]
    for node in model.graph.node:
        node.output[:] = ['raw' if name == SCORES else name for name in node.output]
    value = helper.make_tensor('v', TensorProto.DOUBLE, [1], [1.0])
    model.graph.initializer.append(helper.make_tensor('n', TensorProto.INT64, [1], [doubles]))
    model.graph.node.extend(
        [
            helper.make_node('ConstantOfShape', ['n'], ['ballast'], value=value),
            helper.make_node('ReduceSum', ['ballast'], ['total'], keepdims=1),
            helper.make_node('Add', ['raw', 'total'], [SCORES]),
        ]
    )
    return seal(model.SerializeToString(), manifest)


def test_a_graph_that_asks_for_too_much_memory_is_refused(model_path):
    """Two gigabytes from a few bytes, at the first try, which is when it is loaded."""
    with pytest.raises(ModelFileError, match='does not run'):
        TactileModel(with_ballast(model_path, 8 * MAX_INFERENCE_BYTES // 8))


def test_a_graph_within_the_limit_runs(model_path):
    assert TactileModel(with_ballast(model_path, 1000)).labels


def test_a_graph_that_need_not_end_is_refused(model_path):
    data = model_path.read_bytes()
    manifest = open_container(data)
    model = onnx.load_model_from_string(data)
    del model.metadata_props[:]
    body = helper.make_graph(
        [helper.make_node('Identity', ['go'], ['on'])],
        'body',
        [
            helper.make_tensor_value_info('i', TensorProto.INT64, []),
            helper.make_tensor_value_info('go', TensorProto.BOOL, []),
        ],
        [helper.make_tensor_value_info('on', TensorProto.BOOL, [])],
    )
    model.graph.node.append(helper.make_node('Loop', ['', ''], [], body=body))
    with pytest.raises(ModelFileError, match='need not end'):
        TactileModel(seal(model.SerializeToString(), manifest))


@pytest.fixture(scope='module')
def rocket_path(small_table, tmp_path_factory):
    rng = np.random.default_rng(2)
    config = FeatureConfig(texture_features='glide_waveform')
    spec = spec_for('texture', config)
    level = np.searchsorted(np.unique(small_table.labels), small_table.labels)
    values = rng.normal(size=(len(small_table), len(spec.names))) + level[:, np.newaxis]
    table = FeatureTable(values, small_table.labels, spec, small_table.columns)
    path = tmp_path_factory.mktemp('rocket') / 'rocket.onnx'
    write_model(path, train(table, 'rocket'))
    return path


def with_constants(path, kind, change):
    """Return a well sealed model whose constants of one type were changed."""
    data = path.read_bytes()
    manifest = open_container(data)
    model = onnx.load_model_from_string(data)
    del model.metadata_props[:]
    changed = 0
    for tensor in model.graph.initializer:
        if tensor.data_type == kind:
            array = numpy_helper.to_array(tensor)
            new = np.asarray(change(array.copy()), dtype=array.dtype)
            changed += new.tobytes() != array.tobytes()
            tensor.CopyFrom(numpy_helper.from_array(new, tensor.name))
    assert changed
    return seal(model.SerializeToString(), manifest)


def test_a_rocket_whose_kernels_reach_beyond_the_waveform_is_refused(rocket_path):
    assert TactileModel.load(rocket_path).manifest.classifier == 'rocket'

    def reach(array):
        return np.where(array == array.max(), 10**9, array) if array.size > 9 else array

    with pytest.raises(ModelFileError, match='its graph does not run'):
        TactileModel(with_constants(rocket_path, TensorProto.INT64, reach))


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_rocket_with_weights_that_are_not_finite_names_nothing(rocket_path, value, make_window):
    def spoil(array):
        return np.full_like(array, value) if array.ndim == 2 else array

    model = TactileModel(with_constants(rocket_path, TensorProto.DOUBLE, spoil))
    window = make_window(
        feature_set='glide_waveform',
        feature_set_version=model.spec.version,
        values=np.arange(float(len(model.spec.names))),
        specification_digest=model.spec.digest,
    )
    answer = model.classify(window)
    assert answer.outcome == Outcome.NO_FEATURES
    assert answer.label == ''
    assert 'no finite scores' in answer.reason


def test_a_rocket_of_other_waveforms_is_refused(rocket_path, model_path):
    """The graph of one model under the manifest of another, well sealed."""
    model = onnx.load_model_from_string(rocket_path.read_bytes())
    del model.metadata_props[:]
    manifest = open_container(model_path.read_bytes())
    with pytest.raises(ModelFileError, match='the feature set has 91 features'):
        TactileModel(seal(model.SerializeToString(), manifest))


@pytest.mark.parametrize('share', [0.001, 0.3, 0.7, 0.999])
def test_a_damaged_rocket_is_refused(rocket_path, share):
    data = bytearray(rocket_path.read_bytes())
    cut = bytes(data[: int(share * len(data))])
    data[int(share * len(data))] ^= 0x10
    for damaged in (bytes(data), cut):
        with pytest.raises(ModelFileError):
            TactileModel(damaged)
