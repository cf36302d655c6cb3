# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scaling, answer, probabilities and novelty, as operators of an ONNX graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.novelty import (
    NEAREST_TO_ALL,
    NoveltyMeasure,
    RELATIVE,
)
from tactile_classifier.model_file.graphs.graph import Graph

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline


def add_scaling(graph: Graph, pipeline: Pipeline, x: str) -> str:
    """Add the pipeline's `StandardScaler`, if it has one; shape (windows, k) as before.

    The same bits as scikit-learn's: one difference and one quotient a value.
    """
    if 'scale' not in pipeline.named_steps:
        return x
    scaler = pipeline.named_steps['scale']
    x = graph.add('Sub', x, graph.constant(scaler.mean_))
    return graph.add('Div', x, graph.constant(scaler.scale_))


def add_answer(graph: Graph, scores: str) -> str:
    """Add the column of the first largest raw score, shape (windows, 1).

    From the raw scores, because equal ones need not give probabilities of equal bits.
    """
    return graph.add('ArgMax', scores, axis=1, keepdims=1)


def add_probabilities(
    graph: Graph, scores: str, answer: str, labels: int, calibration: Calibration
) -> str:
    """Add what `Calibration.compute` gives for the raw scores, shape (windows, labels)."""
    size = graph.add('Mul', scores, graph.constant(np.float64(calibration.slope)))
    offset = graph.constant(np.float64(calibration.offset))
    is_answer = graph.add('Equal', answer, graph.constant(np.arange(labels)))
    zero = graph.constant(np.float64(0.0))
    raised = graph.add('Add', size, graph.add('Where', is_answer, offset, zero))
    return graph.add('Softmax', raised, axis=1)


def add_novelty(graph: Graph, x: str, measure: NoveltyMeasure) -> str:
    """Add what `NoveltyMeasure.compute` gives for features, shape (windows, 1)."""
    rows = graph.add('Sub', x, graph.constant(measure.centre))
    whitened = graph.add('MatMul', rows, graph.constant(measure.within))
    to_label = _add_least(graph, _add_squares(graph, whitened, measure.means))
    of_all = graph.add('MatMul', rows, graph.constant(measure.total))
    to_all = graph.add('ReduceSumSquare', of_all, graph.constant(np.array([1])), keepdims=1)
    if measure.metric == RELATIVE:
        width = graph.constant(np.float64(2 * len(measure.centre)))
        excess = graph.add('Div', graph.add('Sub', to_label, to_all), width)
        square = graph.add('Mul', excess, excess)
        root = graph.add('Sqrt', graph.add('Add', square, graph.constant(np.float64(1.0))))
        return graph.add('Add', excess, root)
    if measure.transform is measure.within:
        near = whitened
    else:
        near = graph.add('Mul', rows, graph.constant(measure.transform))
    squares = _add_squares(graph, near, measure.references)
    nearest = graph.add('ArgMin', squares, axis=1, keepdims=1)
    scale = graph.add('Gather', graph.constant(measure.scale), nearest, axis=0)
    distance = graph.add('Div', graph.add('Sqrt', _add_least(graph, squares)), scale)
    to_all = graph.add('Max', to_all, graph.constant(np.float64(NEAREST_TO_ALL)))
    return graph.add('Mul', distance, graph.add('Sqrt', graph.add('Div', to_label, to_all)))


def _add_squares(graph: Graph, rows: str, references: npt.NDArray[np.float64]) -> str:
    """Add the squared distances of rows to references, not yet bounded by 0."""
    squares = graph.add('ReduceSumSquare', rows, graph.constant(np.array([1])), keepdims=1)
    squares = graph.add('Add', squares, graph.constant((references**2).sum(axis=1)))
    return graph.add(
        'Add', squares, graph.add('MatMul', rows, graph.constant(-2.0 * references.T))
    )


def _add_least(graph: Graph, squares: str) -> str:
    least = graph.add('ReduceMin', squares, graph.constant(np.array([1])), keepdims=1)
    return graph.add('Max', least, graph.constant(np.float64(0.0)))
