# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parts of a model as ONNX graphs of plain operators in double precision.

A support vector machine is made of these, too: ONNX's own operator for it computes in single
precision, which changes labels between training trials (decision 0004). Convolutions take the
additions of `RandomConvolutions` in single precision, each an operator of its own: so counts are
the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import itertools
from typing import Any, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.novelty import (
    NEAREST_TO_ALL,
    NoveltyMeasure,
    RELATIVE,
)
from tactile_classifier.estimators.neighbours import halve, NearestNeighbours, NEIGHBOURS
from tactile_classifier.estimators.random_convolutions import (
    ADDED,
    KERNELS,
    RandomConvolutions,
    TAPS,
)

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline
    from sklearn.svm import SVC

    from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier


Shape = tuple[type, Sequence[int | None]]
"""Type of a tensor, ``float`` (double) or ``int`` (int64), and its shape; None: any."""


class Graph:
    """Nodes and constants; tensors go by name.

    All names begin with the prefix: those of a branch must not be those of the graph around it.
    """

    def __init__(self, prefix: str = '') -> None:
        self._prefix = prefix
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def name(self, stem: str) -> str:
        """Return a name of this graph."""
        return f'{self._prefix}{stem}'

    def constant(self, value: npt.ArrayLike) -> str:
        """Add a constant; return its name."""
        from onnx import numpy_helper

        name = self.name(f'c{len(self._constants)}')
        self._constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, op_type: str, *inputs: str, output: str = '', **attributes: Any) -> str:
        """Add an operator; return the name of its output."""
        output = output or self.name(f't{len(self._nodes)}')
        self.add_many(op_type, inputs, [output], **attributes)
        return output

    def add_many(
        self, op_type: str, inputs: Sequence[str], outputs: Sequence[str], **attributes: Any
    ) -> None:
        """Add an operator of several outputs."""
        from onnx import helper

        self._nodes.append(helper.make_node(op_type, inputs, outputs, **attributes))

    def embed(self, model: Any, x: str) -> str:
        """Add another model with ``x`` for its one input; return its output, as doubles."""
        from onnx import TensorProto
        from onnx.compose import add_prefix_graph

        inner = add_prefix_graph(model.graph, self.name(f'e{len(self._nodes)}_'))
        self.add('Identity', x, output=inner.input[0].name)
        self._nodes.extend(inner.node)
        self._constants.extend(inner.initializer)
        return self.add('Cast', inner.output[0].name, to=TensorProto.DOUBLE)

    def to_proto(self, inputs: Mapping[str, Shape], outputs: Mapping[str, Shape]) -> Any:
        """Return the graph alone, as a model holds it or a branch is."""
        from onnx import helper, TensorProto

        types = {float: TensorProto.DOUBLE, int: TensorProto.INT64}

        def tensors(shapes: Mapping[str, Shape]) -> list[Any]:
            return [
                helper.make_tensor_value_info(name, types[kind], shape)
                for name, (kind, shape) in shapes.items()
            ]

        return helper.make_graph(
            self._nodes,
            self.name('graph'),
            tensors(inputs),
            tensors(outputs),
            initializer=self._constants,
        )


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


def add_neighbours(graph: Graph, neighbours: NearestNeighbours, x: str) -> str:
    """Add fitted neighbours; return the name of their shares of votes, shape (windows, labels).

    ``x`` are features of shape (windows, k), scaled if they are to be. The same bits as
    `NearestNeighbours.predict_proba`: no operator adds more than two numbers that rounding could
    change, as a reduction would, in an order of its own.
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


Matrix = npt.NDArray[np.float64]


def add_svm(graph: Graph, svm: SVC, x: str) -> str:
    """Add a fitted SVM with a linear or RBF kernel; return the name of its decision values.

    ``x`` are features of shape (windows, k), scaled if they are to be; the values have shape
    (windows, labels).
    """
    kernel = _add_kernel(graph, svm, x)
    pairs = graph.add('MatMul', kernel, graph.constant(_pair_weights(svm)))
    pairs = graph.add('Add', pairs, graph.constant(svm.intercept_))
    return _add_votes(graph, pairs, len(svm.classes_))


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
    """Return the weight of each support vector in each pair of classes, shape (vectors, pairs).

    libsvm keeps, for each vector of one class, its weights against the others.
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


def _add_votes(graph: Graph, pairs: str, classes: int) -> str:
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


Indices = npt.NDArray[np.intp]


def add_random_convolutions(graph: Graph, model: RandomConvolutionClassifier, x: str) -> str:
    """Add a fitted classifier; return the name of its scores, shape (windows, labels).

    ``x`` are waveforms of shape (windows, channels * samples).
    """
    scores = graph.constant(model.intercept_)
    first = 0
    for reference, convolutions in zip(model.references_, model.convolutions_, strict=True):
        each = np.repeat(reference, convolutions.samples)
        rows = _add_single(graph, graph.add('Sub', x, graph.constant(each)))
        coefficients = model.coef_[:, first : first + convolutions.feature_count]
        first += convolutions.feature_count
        scores = _add_shares(graph, convolutions, coefficients, rows, scores)
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


def _add_shares(
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
