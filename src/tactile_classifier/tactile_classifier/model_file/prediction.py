# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Prediction in NumPy. Each classifier is a set of arrays with a function to compute its scores.

Except for rounding, the scores equal those of the original scikit-learn estimators. Each window is
computed separately, so its result does not depend on the size of the batch.

``SHAPES`` of a class contains the dimensions of its arrays, which are checked when a model file is
read. ``k`` is the number of features, and ``labels`` the number of labels of the model. A number
is a fixed dimension. All dimensions with the same name must be equal. If the values of the arrays
are inconsistent, `check` raises ModelFileError.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
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
from tactile_classifier.types import NEIGHBOURS

MAX_COMPARISONS = 2**26
"""Maximum number of comparisons with a bias for the convolutions of one window. This is 40 times
the number that a model of this package needs for 180 samples, and needs 64 MiB of memory."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Single = npt.NDArray[np.float32]


class Predictions(NamedTuple):
    """Predictions for many windows of the same length.

    ``answer``, shape (windows,), is the index of the predicted label: the first one with the
    largest score before calibration. ``scores`` has shape (windows, labels); a higher score means
    a more likely label. ``score_kind`` of the manifest is the kind of the scores. If the features
    of a window are not finite, its scores are NaN. ``novelty`` has shape (windows,); it is empty
    if the model has no novelty measure.
    """

    answer: npt.NDArray[np.intp]
    scores: Matrix
    novelty: Matrix


class Classifier(Protocol):
    """Arrays of a fitted classifier."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]]

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError if values are inconsistent."""

    def compute(self, row: Matrix) -> Matrix:
        """Return the raw scores, shape (labels,), of one window of features, shape (k,)."""

    def find_margin(self, row: Matrix) -> float:
        """Return how far the prediction of one window is from a tie [1].

        This is the difference of the compared numbers, relative to their size.
        """


@dataclasses.dataclass(frozen=True, eq=False)
class Scaling:
    """Standardization of features; mean and scale are in the units of the features."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {'mean': ('k',), 'scale': ('k',)}

    mean: Matrix
    scale: Matrix

    def compute(self, row: Matrix) -> Matrix:
        """Return the scaled features."""
        return np.asarray((row - self.mean) / self.scale)

    def check(self, features: int, labels: int) -> None:
        """Raise ModelFileError if a scale is not positive."""
        _require(bool((self.scale > 0.0).all()), 'scale')


@dataclasses.dataclass(frozen=True, eq=False)
class Predictor:
    """Scaling, classifier, calibration and novelty measure of one model.

    If ``scaling`` is None, the classifier uses the unscaled features. If ``calibration`` is None,
    the scores are raw.
    """

    classifier: Classifier
    scaling: Scaling | None = None
    calibration: Calibration | None = None
    novelty: NoveltyMeasure | None = None

    def compute(self, values: Matrix) -> Predictions:
        """Return the predictions for windows of features, shape (windows, k)."""
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
        """Return the scaled features of one window, shape (k,)."""
        return row if self.scaling is None else self.scaling.compute(row)

    def _compute_one(self, row: Matrix) -> Matrix:
        scores = self.classifier.compute(self.scale(row))
        return scores if math.isfinite(row.sum()) else np.full_like(scores, np.nan)


@dataclasses.dataclass(frozen=True, eq=False)
class Neighbours:
    """Majority vote of the three nearest training trials, by Euclidean distance.

    Ties are broken in favour of the earlier trial. Each row of ``votes`` contains 1 for the label
    of the trial and 0 for the other labels.
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
            nearest = squares.argmin()  # first index in case of ties
            votes += self.votes[nearest]
            squares[nearest] = np.inf
        return np.asarray(votes / NEIGHBOURS)

    def compute_squares(self, row: Matrix) -> Matrix:
        """Return the squared distance of each trial from one row."""
        change = self.trials - row
        return np.asarray(np.einsum('ij,ij->i', change, change))

    def find_margin(self, row: Matrix) -> float:
        if len(self.trials) == NEIGHBOURS:
            return np.inf
        near, far = np.sqrt(np.sort(self.compute_squares(row))[NEIGHBOURS - 1 : NEIGHBOURS + 1])
        return _compare(near, far, far)


class _Machine(ABC):
    """Support vector machine: one decision value per pair of labels."""

    intercept: Matrix

    @abstractmethod
    def find_terms(self, row: Matrix) -> tuple[Matrix, Matrix]:
        """Return the weights, shape (pairs, n), and the n values that they weight."""

    def check(self, features: int, labels: int) -> None:
        _require(len(self.intercept) == labels * (labels - 1) // 2, 'intercept')

    def compute(self, row: Matrix) -> Matrix:
        return count_votes(self.compare_pairs(row))

    def compare_pairs(self, row: Matrix) -> Matrix:
        """Return the decision values of one window, shape (pairs,)."""
        weights, values = self.find_terms(row)
        return np.asarray(weights @ values + self.intercept)

    def find_margin(self, row: Matrix) -> float:
        weights, values = self.find_terms(row)
        sizes = np.abs(weights) @ np.abs(values) + np.abs(self.intercept)
        return _find_vote_margin(self.compare_pairs(row), sizes)


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMachine(_Machine):
    """Support vector machine with a linear kernel; one row of coefficients per pair of labels."""

    SHAPES: ClassVar[dict[str, tuple[str | int, ...]]] = {
        'coefficients': ('pairs', 'k'),
        'intercept': ('pairs',),
    }

    coefficients: Matrix
    intercept: Matrix

    def find_terms(self, row: Matrix) -> tuple[Matrix, Matrix]:
        return self.coefficients, row


@dataclasses.dataclass(frozen=True, eq=False)
class RadialMachine(_Machine):
    """Support vector machine with a Gaussian kernel: exp(-gamma * squared distance).

    ``weights`` contains the weight of each support vector for each pair of labels.
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

    def find_terms(self, row: Matrix) -> tuple[Matrix, Matrix]:
        # The square is not expanded: if features have a large offset, this would lose precision.
        change = self.vectors - row
        kernel = np.exp(-self.gamma * np.einsum('ij,ij->i', change, change))
        return self.weights, np.asarray(kernel)


def count_votes(pairs: Matrix) -> Matrix:
    """Compute the score of each label from the decision values of all pairs of labels.

    A value of 0 or more is a vote for the first label of the pair, a negative value for the
    second. As in scikit-learn's `_ovr_decision_function`, the score of a label is its number of
    votes plus a confidence of at most a third of a vote. If there are only two labels, the single
    value is the score of the second label.
    """
    if len(pairs) == 1:
        return np.concatenate([-pairs, pairs])
    for_first, ballots = _make_ballots(len(pairs))
    votes, sums = for_first - (pairs < 0.0) @ ballots, pairs @ ballots
    return np.asarray(votes + sums / (3.0 * (np.abs(sums) + 1.0)))


@lru_cache(maxsize=64)
def _make_ballots(pairs: int) -> tuple[Matrix, Matrix]:
    """Return arrays for counting votes.

    The first array contains, for each label, the number of pairs in which it is the first label.
    The second array, shape (pairs, labels), contains 1 for the first label of a pair and -1 for
    the second.
    """
    labels = round((1 + math.sqrt(1 + 8 * pairs)) / 2)
    first, second = np.triu_indices(labels, 1)
    names = np.eye(labels)
    return names[first].sum(axis=0), names[first] - names[second]


def _find_vote_margin(pairs: Matrix, sizes: Matrix) -> float:
    """Return the margin of decision values; see `Classifier.find_margin`.

    ``sizes`` contains the sum of the absolute terms of each decision value.
    """
    *_, second, first = np.sort(count_votes(pairs))
    of_pairs = (_compare(value, 0.0, size) for value, size in zip(pairs, sizes, strict=True))
    return min(*of_pairs, _compare(first, second, abs(first)), np.inf)


def _compare(first: float, second: float, size: float) -> float:
    """Return the difference of two numbers relative to a size."""
    return float(abs(first - second) / size) if size > 0.0 else 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Tree:
    """Decision tree. A node compares one feature in single precision, as in scikit-learn.

    ``below`` and ``above`` contain the child nodes of each node; both are -1 if the node is a
    leaf. ``shares`` contains the fraction of each label among the training trials of a node.
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
        # If child nodes have larger indices than their parent, every path ends at a leaf.
        for name, after in (('below', self.below), ('above', self.above)):
            _require(bool(((after > nodes) & (after < len(nodes)))[inner].all()), name)

    @cached_property
    def _nodes(self) -> list[tuple[int, float, int, int]]:
        arrays = self.feature, self.threshold, self.below, self.above
        return list(zip(*(array.tolist() for array in arrays), strict=True))

    def compute(self, row: Matrix) -> Matrix:
        return np.array(self.shares[self._find_leaf(row.astype(np.float32).tolist())])

    def find_margin(self, row: Matrix) -> float:
        return np.inf  # comparisons with thresholds have no rounding errors

    def _find_leaf(self, row: list[float]) -> int:
        nodes, at = self._nodes, 0
        while nodes[at][2] >= 0:
            feature, threshold, below, above = nodes[at]
            at = below if row[feature] <= threshold else above
        return at


@dataclasses.dataclass(frozen=True, eq=False)
class Convolutions:
    """Two sets of random convolutions with a linear classifier; see `RandomConvolutions`.

    Before each set is applied, the values in ``references``, one per channel, are subtracted from
    the waveforms [unit of the waveform]. ``biases`` are in the order of the features. ``counts``
    is the number of biases per kernel at each dilation. If there are two labels, ``coefficients``
    has one row, for the second label.
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
        shares = len(KERNELS) * sum(self.counts.tolist())  # integers of any size
        _require(self.biases.shape[1] == shares, 'biases')
        _require(self.coefficients.shape[1] == 2 * shares, 'coefficients')
        _require(len(self.intercept) == (1 if labels == 2 else labels), 'intercept')
        _require(bool(((self.sources >= -1) & (self.sources < channels)).all()), 'sources')
        _require(bool((self.sources[..., 0] >= 0).all()), 'sources')
        if 2 * shares * samples > MAX_COMPARISONS:
            raise ModelFileError(
                f'its convolutions need {2 * shares * samples:,} comparisons for one window; the '
                f'limit is {MAX_COMPARISONS:,}'
            )

    @cached_property
    def _sets(self) -> list[RandomConvolutions]:
        shared = int(self.samples), self.references.shape[1], self.dilations, self.counts
        return [
            RandomConvolutions(*shared, biases, sources)
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
        raise ModelFileError(f'values of its array "{name}" are inconsistent with other arrays')
