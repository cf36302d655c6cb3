# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three nearest neighbours as an ONNX graph of plain operators in double precision."""

from __future__ import annotations

import numpy as np

from tactile_classifier.estimators.neighbours import halve, NearestNeighbours, NEIGHBOURS
from tactile_classifier.model_file.graphs.graph import Graph


def add_neighbours(graph: Graph, neighbours: NearestNeighbours, x: str) -> str:
    """Add the neighbours to a graph; return the name of their shares of votes.

    The same bits as `NearestNeighbours.predict_proba`: no operator adds more than two
    numbers that rounding could change, as a reduction would, in an order of its own.

    Parameters
    ----------
    graph : Graph
    neighbours : NearestNeighbours
        Fitted.
    x : str
        Tensor of features of shape (windows, k), scaled if they are to be.
    """
    # Features before trials: what is folded lies in one piece.
    rows = graph.add('Unsqueeze', x, graph.constant(np.array([2])))
    change = graph.add('Sub', rows, graph.constant(neighbours.values_.T))
    terms = graph.add('Mul', change, change)
    for half, size in halve(neighbours.n_features_in_):
        rest = _add_slice(graph, terms, half, size)
        first = graph.add('Add', _add_slice(graph, terms, 0, size - half), rest)
        if size < 2 * half:
            between = _add_slice(graph, terms, size - half, half)
            first = graph.add('Concat', first, between, axis=1)
        terms = first
    squares = graph.add('Squeeze', terms, graph.constant(np.array([1])))
    nearest = graph.name('nearest')
    # Of equal values, ONNX defines that the one of the lower index comes first.
    graph.add_many(
        'TopK',
        [squares, graph.constant(np.array([NEIGHBOURS]))],
        [graph.name('squares'), nearest],
        axis=1,
        largest=0,
    )
    ballots = np.eye(len(neighbours.classes_))[neighbours.codes_]
    votes = graph.add('Gather', graph.constant(ballots), nearest, axis=0)
    votes = graph.add('ReduceSum', votes, graph.constant(np.array([1])), keepdims=0)
    return graph.add('Div', votes, graph.constant(np.float64(NEIGHBOURS)))


def _add_slice(graph: Graph, x: str, start: int, stop: int) -> str:
    """Add the features from ``start`` to before ``stop``."""
    limits = (graph.constant(np.array([at])) for at in (start, stop, 1))
    return graph.add('Slice', x, *limits)
