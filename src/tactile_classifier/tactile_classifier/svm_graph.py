# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A support vector machine as an ONNX graph of plain operators in double precision.

ONNX's own operator for it computes in single precision. On stiffness features, whose
intercept is hundreds of times its differences, that changed 6 of 60 labels between
the training trials while it kept all those of the trials themselves.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline
    from sklearn.svm import SVC

Matrix = npt.NDArray[np.float64]


class _Graph:
    """Nodes and constants of a graph under construction; tensors go by name."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: npt.ArrayLike) -> str:
        from onnx import numpy_helper

        name = f'c{len(self.constants)}'
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, op_type: str, *inputs: str, output: str = '', **attributes: Any) -> str:
        from onnx import helper

        output = output or f't{len(self.nodes)}'
        self.nodes.append(helper.make_node(op_type, list(inputs), [output], **attributes))
        return output


def build_svm_model(
    pipeline: Pipeline, input_name: str, output_name: str, opset: int, ir_version: int
) -> Any:
    """Return the ONNX model from features to one decision value a label.

    Parameters
    ----------
    pipeline : sklearn.pipeline.Pipeline
        Fitted `SVC` with a linear or RBF kernel, with or without a `StandardScaler`.
    input_name, output_name : str
        Tensors of shape (windows, k) and (windows, labels), doubles.
    """
    from onnx import TensorProto, helper

    graph = _Graph()
    x = input_name
    if 'scale' in pipeline.named_steps:
        scaler = pipeline.named_steps['scale']
        x = graph.add('Sub', x, graph.constant(scaler.mean_))
        x = graph.add('Div', x, graph.constant(scaler.scale_))
    svm = pipeline.named_steps['classify']
    kernel = _add_kernel(graph, svm, x)
    pairs = graph.add('MatMul', kernel, graph.constant(_pair_weights(svm)))
    pairs = graph.add('Add', pairs, graph.constant(svm.intercept_))
    _add_scores(graph, pairs, len(svm.classes_), output_name)

    def tensor(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.DOUBLE, [None, width])

    return helper.make_model(
        helper.make_graph(
            graph.nodes,
            'support_vector_machine',
            [tensor(input_name, svm.n_features_in_)],
            [tensor(output_name, len(svm.classes_))],
            initializer=graph.constants,
        ),
        opset_imports=[helper.make_opsetid('', opset)],
        ir_version=ir_version,
        producer_name='tactile_classifier',
    )


def _add_kernel(graph: _Graph, svm: SVC, x: str) -> str:
    """Add the kernel of each row with each support vector, shape (windows, vectors)."""
    vectors = svm.support_vectors_
    if svm.kernel == 'linear':
        return graph.add('MatMul', x, graph.constant(vectors.T))
    # Differences first: expanding the square would lose them under a large offset.
    rows = graph.add('Unsqueeze', x, graph.constant(np.array([1])))
    change = graph.add('Sub', rows, graph.constant(vectors))
    axes = graph.constant(np.array([2]))
    distance = graph.add('ReduceSumSquare', change, axes, keepdims=0)
    return graph.add('Exp', graph.add('Mul', distance, graph.constant(-svm._gamma)))


def _pair_weights(svm: SVC) -> Matrix:
    """Return the weight of each support vector in each pair of classes.

    libsvm keeps, for each vector of one class, its weights against the others;
    shape (vectors, pairs).
    """
    dual = svm.dual_coef_
    if len(svm.classes_) == 2:
        return np.asarray(dual.T)
    owner = np.repeat(np.arange(len(svm.classes_)), svm.n_support_)
    columns = [
        np.where(owner == i, dual[j - 1], 0.0) + np.where(owner == j, dual[i], 0.0)
        for i, j in itertools.combinations(range(len(svm.classes_)), 2)
    ]
    return np.stack(columns, axis=1)


def _add_scores(graph: _Graph, pairs: str, classes: int, output: str) -> None:
    """Add one value a class: its votes, and its confidence as a fraction of a vote.

    The same as scikit-learn's `_ovr_decision_function`: a pair's value is
    positive for its first class; confidences are squeezed below a third of a vote.
    """
    if classes == 2:
        # Of two classes, scikit-learn's value is positive for the second.
        graph.add('MatMul', pairs, graph.constant([[-1.0, 1.0]]), output=output)
        return
    first = np.zeros((classes * (classes - 1) // 2, classes))
    second = np.zeros_like(first)
    for pair, (i, j) in enumerate(itertools.combinations(range(classes), 2)):
        first[pair, i] = second[pair, j] = 1.0
    one, three, zero = (graph.constant(np.float64(value)) for value in (1, 3, 0))
    lost = graph.add('Less', pairs, zero)
    lost = graph.add('Where', lost, one, zero)
    votes = graph.add('MatMul', lost, graph.constant(second - first))
    votes = graph.add('Add', votes, graph.constant(first.sum(axis=0)))
    confidence = graph.add('MatMul', pairs, graph.constant(first - second))
    size = graph.add('Mul', graph.add('Add', graph.add('Abs', confidence), one), three)
    graph.add('Add', votes, graph.add('Div', confidence, size), output=output)
