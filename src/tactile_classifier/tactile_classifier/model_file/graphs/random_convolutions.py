# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random convolutions and their linear classifier as an ONNX graph.

Convolutions take the same additions in single precision as `RandomConvolutions`, each an operator
of its own: so counts are the same. Weights and scores are in double precision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.estimators.random_convolutions import (
    ADDED,
    KERNELS,
    RandomConvolutions,
    TAPS,
)
from tactile_classifier.model_file.graphs.graph import Graph

if TYPE_CHECKING:
    from tactile_classifier.estimators.random_convolution_classifier import (
        RandomConvolutionClassifier,
    )

Indices = npt.NDArray[np.intp]


def add_random_convolutions(graph: Graph, model: RandomConvolutionClassifier, x: str) -> str:
    """Add a fitted classifier to a graph; return the name of its scores, one a label.

    Parameters
    ----------
    graph : Graph
    model : RandomConvolutionClassifier
        Fitted.
    x : str
        Tensor of waveforms of shape (windows, channels * samples).
    """
    scores = graph.constant(model.intercept_)
    first = 0
    for reference, convolutions in zip(model.references_, model.convolutions_, strict=True):
        each = np.repeat(reference, convolutions.samples)
        rows = _add_single(graph, graph.add('Sub', x, graph.constant(each)))
        coefficients = model.coef_[:, first : first + convolutions.feature_count]
        first += convolutions.feature_count
        scores = _add_scores(graph, convolutions, coefficients, rows, scores)
    if len(model.classes_) == 2:
        return graph.add('MatMul', scores, graph.constant([[-1.0, 1.0]]))
    return scores


def _add_single(graph: Graph, rows: str) -> str:
    """Add the values in single precision with a zero behind them, shape (windows, 1 + values)."""
    from onnx import TensorProto

    single = graph.add('Cast', rows, to=TensorProto.FLOAT)
    zero = graph.constant(np.float32(0.0))
    none = graph.add('Mul', graph.add('Gather', single, graph.constant([0]), axis=1), zero)
    return graph.add('Concat', single, none, axis=1)


def _add_scores(
    graph: Graph,
    convolutions: RandomConvolutions,
    coefficients: npt.NDArray[np.float64],
    rows: str,
    scores: str,
) -> str:
    """Add what the shares of one set of convolutions contribute to the scores."""
    first = 0
    for i, (dilation, biases) in enumerate(
        zip(convolutions.dilations, convolutions.biases, strict=True)
    ):
        size = biases.size
        weights = coefficients[:, first : first + size].reshape(-1, *biases.shape)
        first += size
        edge = (TAPS // 2) * int(dilation)
        for kernels, low, high in (
            (slice(i % 2, None, 2), 0, convolutions.samples),
            (slice(1 - i % 2, None, 2), edge, convolutions.samples - edge),
        ):
            sums = _add_sums(
                graph,
                _places(convolutions, int(dilation), low, high),
                convolutions.sources[i][kernels],
                KERNELS[kernels],
                rows,
            )
            counts = _add_counts(graph, sums, biases[kernels])
            block = weights[:, kernels].reshape(len(weights), -1).T / (high - low)
            part = graph.add('MatMul', counts, graph.constant(block))
            scores = graph.add('Add', part, scores)
    return scores


def _places(convolutions: RandomConvolutions, dilation: int, low: int, high: int) -> Indices:
    """Return where the sample under each weight stands, shape (channels, 9, samples).

    The last place holds the zero that lies beyond the ends.
    """
    samples = convolutions.samples
    at = np.arange(low, high) + (np.arange(TAPS) - TAPS // 2)[:, None] * dilation
    inside = (at >= 0) & (at < samples)
    start = samples * np.arange(convolutions.channels)[:, None, None]
    return np.where(inside, start + at, samples * convolutions.channels)


def _add_sums(graph: Graph, places: Indices, sources: Indices, kernels: Indices, rows: str) -> str:
    """Add what `RandomConvolutions` sums up, shape (windows, kernels, samples)."""
    common = graph.add('Neg', _add_gather(graph, rows, places[:, TAPS // 2]))
    for tap in ADDED:
        common = graph.add('Sub', common, _add_gather(graph, rows, places[:, tap]))
    three = graph.constant(np.float32(3.0))
    extra = graph.add('Mul', _add_gather(graph, rows, places.reshape(-1, places.shape[2])), three)
    total = ''
    for source in sources.T:
        used = np.flatnonzero(source >= 0)
        if not len(used):
            break
        channel = source[used]
        term = _add_gather(graph, common, channel)
        for tap in kernels[used].T:
            term = graph.add('Add', term, _add_gather(graph, extra, channel * TAPS + tap))
        total = _add_terms(graph, total, term, used) if total else term
    return total


def _add_terms(graph: Graph, total: str, term: str, used: Indices) -> str:
    """Add the sums of further channels to those kernels that use them."""
    rows = _add_gather(graph, total, used)
    others = np.setdiff1d(np.arange(len(KERNELS) // 2), used)
    parts = [graph.add('Add', rows, term), _add_gather(graph, total, others)]
    back = np.argsort(np.concatenate([used, others]))
    return _add_gather(graph, graph.add('Concat', *parts, axis=1), back)


def _add_gather(graph: Graph, x: str, places: Indices) -> str:
    return graph.add('Gather', x, graph.constant(places), axis=1)


def _add_counts(graph: Graph, sums: str, biases: npt.NDArray[np.float32]) -> str:
    """Add how many samples of each sum exceed each bias, shape (windows, kernels * biases)."""
    from onnx import TensorProto

    each = graph.add('Unsqueeze', sums, graph.constant([2]))
    above = graph.add('Greater', each, graph.constant(biases[:, :, np.newaxis]))
    # Whole numbers below 2**24 are exact in single precision.
    shares = graph.add('Cast', above, to=TensorProto.FLOAT)
    counts = graph.add('ReduceSum', shares, graph.constant([3]), keepdims=0)
    counts = graph.add('Cast', counts, to=TensorProto.DOUBLE)
    return graph.add('Reshape', counts, graph.constant([0, biases.size]))
