# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Models from strangers, well sealed: what they may ask of the process is limited."""

import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

import onnx
from onnx import helper, TensorProto

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import SCORES, TactileModel
from tactile_classifier.model_file.onnx_container import open_container, seal
from tactile_classifier.model_file.onnx_session import MAX_INFERENCE_BYTES


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
