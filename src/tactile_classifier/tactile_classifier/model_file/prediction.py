# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Prediction in NumPy: each classifier as a few arrays and a function of them.

The scores are those of the scikit-learn estimators that the arrays come from, apart from rounding.
Each window is computed by itself, so it gets the same bits alone and among others.

``SHAPES`` of a class names the dimensions of each of its arrays, for the model file: ``k``
features and ``labels`` are those of the model, a number is itself, and other names are free.
`check` of a class raises ModelFileError when values of its arrays do not fit together.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property, lru_cache
import math
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators.convolutions import (
    KERNELS,
    LARGEST,
    MAX_CHANNELS,
    RandomConvolutions,
    TAPS,
)

NEIGHBOURS = 3

MAX_COMPARISONS = 2**26
"""Most comparisons of the convolutions of one window with a bias: 40 times those of 180 samples
by our own models, and 64 MiB of memory."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Single = npt.NDArray[np.float32]


class Predictions(NamedTuple):
    """Predictions on many windows of one length.

    ``answer``, shape (windows,), is the position of the first largest score before calibration. Of
    ``scores``, shape (windows, labels), the larger is likelier; ``score_kind`` of the manifest
    names them. They are not a number where features are not finite. ``novelty``, shape (windows,),
    is empty when the model has none.
    """

    answer: npt.NDArray[np.intp]
    scores: Matrix
    novelty: Matrix


class Classifier(Protocol):
    """Arrays of a fitted classifier."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]]

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError when values do not fit together."""

    def compute(self, row: Matrix) -> Matrix:
        """Return the raw scores of one window of features, shape (k,), shape (labels,)."""

    def find_margin(self, row: Matrix) -> float:
        """Return how far one window is from a tie, relative to the numbers that are compared."""


@dataclasses.dataclass(frozen=True, eq=False)
class Scaling:
    """Division of each feature's difference to its mean by its scale, both in its unit."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {'mean': ('k',), 'scale': ('k',)}

    mean: Matrix
    scale: Matrix

    def compute(self, row: Matrix) -> Matrix:
        """Return the scaled features."""
        return np.asarray((row - self.mean) / self.scale)

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError when a scale is not positive."""
        _require(bool((self.scale > 0.0).all()), 'scale')


@dataclasses.dataclass(frozen=True, eq=False)
class Predictor:
    """Scaling, classifier, calibration and novelty measure of one model.

    Without a scaling, the classifier takes the features themselves. Without a calibration, the
    scores are the raw ones.
    """

    classifier: Classifier
    scaling: Scaling | None = None
    calibration: Calibration | None = None
    novelty: NoveltyMeasure | None = None

    def compute(self, values: Matrix) -> Predictions:
        """Return the predictions on windows of features, shape (windows, k)."""
        raw = self.compute_raw_scores(values)
        answer = raw.argmax(axis=1)
        with np.errstate(all='ignore'):
            scores = raw if self.calibration is None else self.calibration.compute(raw)
            novelty = np.empty(0) if self.novelty is None else self.novelty.compute(values)
        return Predictions(answer, scores, novelty)

    def compute_raw_scores(self, values: Matrix) -> Matrix:
        """Return the scores before calibration, shape (windows, labels)."""
        with np.errstate(all='ignore'):
            return np.array([self._compute_one(row) for row in values])

    def scale(self, row: Matrix) -> Matrix:
        """Return the features of one window as the classifier takes them, shape (k,)."""
        return row if self.scaling is None else self.scaling.compute(row)

    def _compute_one(self, row: Matrix) -> Matrix:
        scores = self.classifier.compute(self.scale(row))
        return scores if math.isfinite(row.sum()) else np.full_like(scores, np.nan)


@dataclasses.dataclass(frozen=True, eq=False)
class Neighbours:
    """The three nearest training trials vote; Euclidean distance.

    Ties are broken in favour of the earlier trial. ``votes`` has 1 for the label of each
    trial and 0 for the others.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'trials': ('trials', 'k'),
        'votes': ('trials', 'labels'),
    }

    trials: Matrix
    votes: Matrix

    def check(self, features: int, labels: int) -> None:
        _require(len(self.trials) >= NEIGHBOURS, 'trials')

    def compute(self, row: Matrix) -> Matrix:
        squares = self.compute_squares(row)
        votes = np.zeros(self.votes.shape[1])
        for _ in range(NEIGHBOURS):
            nearest = squares.argmin()  # the earlier one of equals
            votes += self.votes[nearest]
            squares[nearest] = np.inf
        return np.asarray(votes / NEIGHBOURS)

    def compute_squares(self, row: Matrix) -> Matrix:
        """Return the squared distance of each trial to one row."""
        change = self.trials - row
        return np.asarray(np.einsum('ij,ij->i', change, change))

    def find_margin(self, row: Matrix) -> float:
        if len(self.trials) == NEIGHBOURS:
            return np.inf
        near, far = np.sqrt(np.sort(self.compute_squares(row))[NEIGHBOURS - 1 : NEIGHBOURS + 1])
        return _compare(near, far, far)


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMachine:
    """Support vector machine with a linear kernel, one row of coefficients a pair of labels."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'coefficients': ('pairs', 'k'),
        'intercept': ('pairs',),
    }

    coefficients: Matrix
    intercept: Matrix

    def check(self, features: int, labels: int) -> None:
        _check_pairs(self.intercept, labels)

    def compute(self, row: Matrix) -> Matrix:
        return count_votes(self.compare_pairs(row))

    def compare_pairs(self, row: Matrix) -> Matrix:
        """Return the decision values of one window, shape (pairs,)."""
        return np.asarray(self.coefficients @ row + self.intercept)

    def find_margin(self, row: Matrix) -> float:
        sizes = np.abs(self.coefficients) @ np.abs(row) + np.abs(self.intercept)
        return _find_vote_margin(self.compare_pairs(row), sizes)


@dataclasses.dataclass(frozen=True, eq=False)
class RadialMachine:
    """Support vector machine with a Gaussian kernel: exp(-gamma * squared distance).

    ``weights`` are those of each support vector in each pair of labels.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'vectors': ('vectors', 'k'),
        'weights': ('pairs', 'vectors'),
        'intercept': ('pairs',),
        'gamma': (),
    }

    vectors: Matrix
    weights: Matrix
    intercept: Matrix
    gamma: Matrix

    def check(self, features: int, labels: int) -> None:
        _check_pairs(self.intercept, labels)

    def compute(self, row: Matrix) -> Matrix:
        return count_votes(self.compare_pairs(row))

    def compare_pairs(self, row: Matrix) -> Matrix:
        """Return the decision values of one window, shape (pairs,)."""
        return np.asarray(self.weights @ self.compute_kernel(row) + self.intercept)

    def find_margin(self, row: Matrix) -> float:
        sizes = np.abs(self.weights) @ self.compute_kernel(row) + np.abs(self.intercept)
        return _find_vote_margin(self.compare_pairs(row), sizes)

    def compute_kernel(self, row: Matrix) -> Matrix:
        """Return the kernel of one window with each support vector."""
        # Differences first: expanding the square would lose them under a large offset.
        change = self.vectors - row
        return np.asarray(np.exp(-self.gamma * np.einsum('ij,ij->i', change, change)))


def count_votes(pairs: Matrix) -> Matrix:
    """Return the score of each label from the decision values of the pairs of labels.

    A label's votes, and its confidence as a fraction of a vote, as in scikit-learn's
    `_ovr_decision_function`: a value of 0 or more is a vote for the first of a pair, and
    confidences are bounded by a third of a vote. The value of two labels alone is positive for
    the second, and is its score.
    """
    if len(pairs) == 1:
        return np.concatenate([-pairs, pairs])
    for_first, ballots = _make_ballots(len(pairs))
    votes, sums = for_first - (pairs < 0.0) @ ballots, pairs @ ballots
    return np.asarray(votes + sums / (3.0 * (np.abs(sums) + 1.0)))


@lru_cache(maxsize=64)
def _make_ballots(pairs: int) -> tuple[Matrix, Matrix]:
    """Return the votes of each label if it won all pairs that it is the first of, and a matrix.

    The matrix, shape (pairs, labels), has 1 for the first label of a pair and -1 for the second.
    """
    labels = round((1 + math.sqrt(1 + 8 * pairs)) / 2)
    first, second = np.triu_indices(labels, 1)
    names = np.eye(labels)
    return names[first].sum(axis=0), names[first] - names[second]


def _find_vote_margin(pairs: Matrix, sizes: Matrix) -> float:
    """Return the margin of decision values that are sums of terms of the given sizes."""
    *_, second, first = np.sort(count_votes(pairs))
    of_pairs = (_compare(value, 0.0, size) for value, size in zip(pairs, sizes, strict=True))
    return min(*of_pairs, _compare(first, second, abs(first)), np.inf)


def _compare(first: float, second: float, size: float) -> float:
    """Return the difference of two numbers relative to a size."""
    return float(abs(first - second) / size) if size > 0.0 else 0.0


def _check_pairs(intercept: Matrix, labels: int) -> None:
    _require(len(intercept) == labels * (labels - 1) // 2, 'intercept')


@dataclasses.dataclass(frozen=True, eq=False)
class Tree:
    """Decision tree; each node compares one feature, in single precision as in scikit-learn.

    ``below`` and ``above`` are the next nodes of a node, both -1 at a leaf; ``shares`` are those
    of the labels among the training trials of a node.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'feature': ('nodes',),
        'threshold': ('nodes',),
        'below': ('nodes',),
        'above': ('nodes',),
        'shares': ('nodes', 'labels'),
    }

    feature: Indices
    threshold: Matrix
    below: Indices
    above: Indices
    shares: Matrix

    def check(self, features: int, labels: int) -> None:
        nodes = np.arange(len(self.feature))
        inner = self.below >= 0
        _require(len(nodes) > 0, 'feature')
        _require(bool((self.feature[inner] >= 0).all()), 'feature')
        _require(bool((self.feature[inner] < features).all()), 'feature')
        # Next nodes have larger numbers: no path is endless.
        for name, after in (('below', self.below), ('above', self.above)):
            _require(bool(((after > nodes) & (after < len(nodes)))[inner].all()), name)

    @cached_property
    def _nodes(self) -> list[tuple[int, float, int, int]]:
        arrays = self.feature, self.threshold, self.below, self.above
        return list(zip(*(array.tolist() for array in arrays), strict=True))

    def compute(self, row: Matrix) -> Matrix:
        return np.array(self.shares[self._find_leaf(row.astype(np.float32).tolist())])

    def find_margin(self, row: Matrix) -> float:
        return np.inf  # thresholds are compared without rounding

    def _find_leaf(self, row: list[float]) -> int:
        nodes, at = self._nodes, 0
        while nodes[at][2] >= 0:
            feature, threshold, below, above = nodes[at]
            at = below if row[feature] <= threshold else above
        return at


@dataclasses.dataclass(frozen=True, eq=False)
class Convolutions:
    """Two sets of random convolutions with a linear classifier; see `RandomConvolutions`.

    A set takes the waveforms minus ``references``, one number a channel [unit of the waveform].
    ``biases`` are in the order of the features; ``counts`` is how many a kernel has at each
    dilation. Of two labels ``coefficients`` has one row, positive for the second.
    """

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'references': (2, 'channels'),
        'dilations': ('dilations',),
        'counts': ('dilations',),
        'biases': (2, 'shares'),
        'sources': (2, 'dilations', len(KERNELS), MAX_CHANNELS),
        'coefficients': ('rows', 'all shares'),
        'intercept': ('rows',),
        'samples': (),
    }

    references: Matrix
    dilations: Indices
    counts: Indices
    biases: Single
    sources: Indices
    coefficients: Matrix
    intercept: Matrix
    samples: Indices

    def check(self, features: int, labels: int) -> None:
        channels, samples = self.references.shape[1], int(self.samples)
        reach = (TAPS - 1) * self.dilations
        _require(channels * samples == features, 'samples')
        _require(bool(((self.dilations > 0) & (reach < samples)).all()), 'dilations')
        _require(bool((self.counts > 0).all()), 'counts')
        shares = len(KERNELS) * int(self.counts.sum())
        _require(self.biases.shape[1] == shares, 'biases')
        _require(self.coefficients.shape[1] == 2 * shares, 'coefficients')
        _require(len(self.intercept) == (1 if labels == 2 else labels), 'intercept')
        _require(bool(((self.sources >= -1) & (self.sources < channels)).all()), 'sources')
        _require(bool((self.sources[..., 0] >= 0).all()), 'sources')
        if 2 * shares * samples > MAX_COMPARISONS:
            raise ModelFileError(
                f'its convolutions compare {2 * shares * samples:,} values for one window; the '
                f'limit is {MAX_COMPARISONS:,}'
            )

    @cached_property
    def _sets(self) -> list[RandomConvolutions]:
        size = len(KERNELS) * np.cumsum(self.counts)[:-1]
        channels = self.references.shape[1]
        return [
            RandomConvolutions(
                int(self.samples),
                channels,
                self.dilations,
                tuple(part.reshape(len(KERNELS), -1) for part in np.split(biases, size)),
                tuple(sources),
            )
            for biases, sources in zip(self.biases, self.sources, strict=True)
        ]

    def compute(self, row: Matrix) -> Matrix:
        scores = self.coefficients @ self._compute_shares(row) + self.intercept
        return np.concatenate([-scores, scores]) if len(scores) == 1 else np.asarray(scores)

    def find_margin(self, row: Matrix) -> float:
        sizes = np.abs(self.coefficients) @ self._compute_shares(row) + np.abs(self.intercept)
        *_, second, first = np.sort(self.compute(row))
        return _compare(first, second, sizes.max())

    def _compute_shares(self, row: Matrix) -> Matrix:
        signals = row.reshape(1, self.references.shape[1], int(self.samples))
        shares = []
        for each, reference in zip(self._sets, self.references, strict=True):
            x = (signals - reference[:, np.newaxis]).astype(np.float32)
            found = each.compute(x)[0]
            shares.append(found if np.abs(x).max() < LARGEST else np.full_like(found, np.nan))
        return np.concatenate(shares)


def _require(is_fitting: bool, name: str) -> None:
    if not is_fitting:
        raise ModelFileError(f'values of its array "{name}" do not fit its other arrays')
