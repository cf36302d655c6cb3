# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A support vector machine as an ONNX graph of plain operators in double precision.

ONNX's own operator for it computes in single precision. On stiffness features, whose
intercept is hundreds of times its differences, that changed 6 of 60 labels between
the training trials while it kept all those of the trials themselves.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.model_file.graphs.graph import Graph

if TYPE_CHECKING:
    from sklearn.svm import SVC

Matrix = npt.NDArray[np.float64]


def add_svm(graph: Graph, svm: SVC, x: str) -> str:
    """Add an SVM to a graph; return the name of its decision values, one a label.

    Parameters
    ----------
    graph : Graph
    svm : sklearn.svm.SVC
        Fitted, with a linear or RBF kernel.
    x : str
        Tensor of features of shape (windows, k), scaled if they are to be.
    """
    kernel = _add_kernel(graph, svm, x)
    pairs = graph.add('MatMul', kernel, graph.constant(_pair_weights(svm)))
    pairs = graph.add('Add', pairs, graph.constant(svm.intercept_))
    return _add_scores(graph, pairs, len(svm.classes_))


def _add_kernel(graph: Graph, svm: SVC, x: str) -> str:
    """Add the kernel of each row with each support vector, shape (windows, vectors)."""
    vectors = svm.support_vectors_
    if svm.kernel == 'linear':
        return graph.add('MatMul', x, graph.constant(vectors.T))
    # Differences first: expanding the square would lose them under a large offset.
    rows = graph.add('Unsqueeze', x, graph.constant(np.array([1])))
    change = graph.add('Sub', rows, graph.constant(vectors))
    axes = graph.constant(np.array([2]))
    distance = graph.add('ReduceSumSquare', change, axes, keepdims=0)
    return graph.add('Exp', graph.add('Mul', distance, graph.constant(-svm._gamma)))  # noqa: SLF001


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


def _add_scores(graph: Graph, pairs: str, classes: int) -> str:
    """Add one value a class: its votes, and its confidence as a fraction of a vote.

    The same as scikit-learn's `_ovr_decision_function`: a pair's value is
    positive for its first class; confidences are squeezed below a third of a vote.
    """
    if classes == 2:
        # Of two classes, scikit-learn's value is positive for the second.
        return graph.add('MatMul', pairs, graph.constant([[-1.0, 1.0]]))
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
    return graph.add('Add', votes, graph.add('Div', confidence, size))
