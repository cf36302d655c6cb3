# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fitting of random convolutions, and a ridge classifier on their features.

The biases are identical to those of aeon's `MiniRocket` with the same seed. The features equal the
features of `MiniRocket` in double precision. docs/decisions/0007-random-convolutions.md explains
why aeon is not used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted

from tactile_classifier.estimators.convolutions import (
    Indices,
    KERNELS,
    Matrix,
    MAX_CHANNELS,
    RandomConvolutions,
    Single,
    TAPS,
    to_single,
)
from tactile_features.estimators import validate_data

MAX_DILATIONS = 32


def fit_convolutions(
    signals: npt.ArrayLike, features: int = 10_000, random_state: int = 0
) -> RandomConvolutions:
    """Fit random convolutions: channels are random, biases are quantiles of convolved signals.

    The training signals have shape (trials, channels, samples). The number of ``features`` is
    rounded down to a multiple of 84. Raises DatasetError if a signal is too short, or not finite
    in single precision.
    """
    x = to_single(signals)
    trials, channels, samples = x.shape
    dilations, counts = _choose_dilations(samples, features // len(KERNELS))
    quantiles = _golden(len(KERNELS) * int(counts.sum()))
    sources = _choose_channels(channels, len(dilations), random_state)
    # As in aeon, the signals that determine the biases are drawn by a new generator with the same
    # seed.
    chosen = np.random.RandomState(random_state).randint(
        trials, size=(len(dilations), len(KERNELS))
    )
    none = np.empty(0, np.float32)
    kernels = RandomConvolutions(samples, channels, dilations, counts, none, sources)
    biases, first = [], 0
    for i, count in enumerate(counts):
        size = len(KERNELS) * count
        share = quantiles[first : first + size].reshape(-1, count)
        first += size
        biases.append(_quantiles(kernels.sum_chosen(x, chosen[i], i), share).ravel())
    return dataclasses.replace(kernels, biases=np.concatenate(biases))


def _choose_dilations(samples: int, count: int) -> tuple[Indices, Indices]:
    """Return the dilations, and the number of biases per kernel at each dilation.

    The numbers of biases add up to ``count``.
    """
    exponents = np.logspace(
        0, np.log2((samples - 1) / (TAPS - 1)), min(count, MAX_DILATIONS), base=2
    )
    dilations, counts = np.unique(exponents.astype(np.intp), return_counts=True)
    counts = (counts * (count / min(count, MAX_DILATIONS))).astype(np.intp)
    rest = count - int(counts.sum())
    counts += rest // len(counts)
    counts[: rest % len(counts)] += 1
    return dilations, counts


@lru_cache(maxsize=16)
def _choose_channels(channels: int, dilations: int, random_state: int) -> Indices:
    """Return the channels of each kernel, shape (dilations, 84, 9), padded with -1."""
    random = np.random.RandomState(random_state)
    size = dilations * len(KERNELS)
    counts = 2 ** random.uniform(0, np.log2(min(channels, MAX_CHANNELS) + 1), size)
    sources = np.full((size, MAX_CHANNELS), -1)
    for row, count in zip(sources, counts.astype(np.intp), strict=True):
        row[:count] = random.choice(channels, count, replace=False)
    return sources.reshape(dilations, len(KERNELS), MAX_CHANNELS)


def _golden(count: int) -> Single:
    """Return a low-discrepancy sequence between 0 and 1, made with the golden ratio."""
    golden = (np.sqrt(5) + 1) / 2
    return np.asarray(np.arange(1, count + 1) * golden % 1, dtype=np.float32)


def _quantiles(values: Single, share: Single) -> Single:
    """Return the quantiles of each row, shape (rows, quantiles), with linear interpolation."""
    ordered = np.sort(values, axis=1).astype(np.float64)
    rank = (values.shape[1] - 1) * share.astype(np.float64)
    low = rank.astype(np.intp)
    rest = rank - low
    high = np.minimum(low + 1, values.shape[1] - 1)
    below, above = (np.take_along_axis(ordered, at, axis=1) for at in (low, high))
    return (below * (1 - rest) + above * rest).astype(np.float32)


ALPHAS = np.logspace(-3, 3, 10)
"""Candidate strengths of the ridge penalty. Leave-one-out on the training trials selects one."""

FEATURES = 4998
"""Number of features of each of the two sets of convolutions."""


class RandomConvolutionClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Two sets of random convolutions, and a linear classifier of their features.

    A row of ``X`` contains the concatenated waveforms of the channels of a trial, which have equal
    length. Beyond the ends of a waveform, a kernel uses zeros, so the level of the waveform
    affects the features. The first set is applied to the waveform itself. The second set is
    applied to the waveform minus the mean of the training trials. It keeps its precision with any
    offset, and distinguishes levels whose differences are small compared with their mean.

    ``references_``, shape (2, channels), contains the level that is subtracted for each set in
    ``convolutions_``. ``coef_`` has shape (labels, features). If there are two labels, it has only
    one row, for the second label.
    """

    def __init__(self, channels: int = 1, random_state: int = 0) -> None:
        self.channels = channels
        self.random_state = random_state

    def fit(
        self,
        X: npt.ArrayLike,  # noqa: N803
        y: npt.ArrayLike,
    ) -> RandomConvolutionClassifier:
        """Fit to waveforms.

        Parameters
        ----------
        X : array_like of shape (trials, channels * samples)
            Concatenated waveforms of the channels, each with nine samples or more.
        y : array_like of shape (trials,)
            Labels.

        Raises
        ------
        ValueError
            When a waveform is too short, or a value is not finite.
        """
        values, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        rows = self._divide(values)
        self._fit_convolutions(rows)
        ridge = LeaveOneOutRidge(self._transform(rows))
        self.classes_, dual, offset = ridge.solve(labels)
        self.coef_ = dual.T @ ridge.scaled / ridge.spread
        self.intercept_ = offset - self.coef_ @ ridge.mean
        return self

    def decision_function(self, X: npt.ArrayLike) -> Matrix:  # noqa: N803
        """Return one score per label, shape (windows, labels).

        If there are two labels, the result has shape (windows,): positive for the second label.
        """
        scores = self._transform(self._check(X)) @ self.coef_.T + self.intercept_
        return np.asarray(scores[:, 0] if len(self.classes_) == 2 else scores)

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:  # noqa: N803
        """Return one label for each row of ``X``, shape (windows, channels * samples)."""
        scores = self.decision_function(X)
        chosen = (scores > 0).astype(int) if scores.ndim == 1 else scores.argmax(axis=1)
        return np.asarray(self.classes_[chosen])

    def _check(self, values: npt.ArrayLike) -> Matrix:
        check_is_fitted(self)
        return self._divide(validate_data(self, values, dtype=np.float64, reset=False))

    def _divide(self, rows: Matrix) -> Matrix:
        """Return waveforms of shape (trials, channels, samples)."""
        if rows.shape[1] % self.channels:
            raise ValueError(
                f'{rows.shape[1]} values are not divisible by {self.channels} channels'
            )
        return np.asarray(rows.reshape(len(rows), self.channels, -1))

    def _fit_convolutions(self, rows: Matrix) -> None:
        mean = rows.mean(axis=(0, 2))
        self.references_ = np.stack([np.zeros_like(mean), mean])
        self.convolutions_ = [
            fit_convolutions(rows - reference[:, None], FEATURES, self.random_state + i)
            for i, reference in enumerate(self.references_)
        ]

    def _transform(self, rows: Matrix) -> Matrix:
        parts: Sequence[Matrix] = [
            convolutions.transform(rows - reference[:, None])
            for convolutions, reference in zip(self.convolutions_, self.references_, strict=True)
        ]
        return np.hstack(parts)

    def predict_folds(
        self,
        values: Matrix,
        labelings: Sequence[npt.NDArray[np.str_]],
        folds: Sequence[tuple[Indices, Indices]],
        known: Indices | slice = slice(None),
    ) -> Iterator[list[npt.NDArray[np.str_]]]:
        """Fit the convolutions once, and a linear classifier for each fold and labeling.

        Yields, for each fold, the predictions for its test trials: one array for each labeling.
        Trials in ``known`` are used to fit the convolutions, but not their labels. By default,
        these are all trials, so the waveforms of the test trials are used, too.

        Parameters
        ----------
        values : ndarray of shape (trials, channels * samples)
            Waveforms, as for `fit`.
        labelings : sequence of ndarray of str, shape (trials,)
            Labels of the trials; several if they are permuted, for example.
        folds : sequence of (ndarray, ndarray)
            Indices of training and of test trials.
        known : ndarray of int or slice
            Indices of the trials that the convolutions are fitted to.
        """
        if not folds:
            return
        rows = self._divide(values)
        self._fit_convolutions(rows[known])
        used = np.unique(np.concatenate([trials for fold in folds for trials in fold]))
        shares = self._transform(rows[used])
        for train, test in folds:
            ridge = LeaveOneOutRidge(shares[np.searchsorted(used, train)])
            likeness = ridge.compare(shares[np.searchsorted(used, test)])
            yield [ridge.predict(likeness, labels[train]) for labels in labelings]


class LeaveOneOutRidge:
    """Ridge classifier whose penalty has the smallest leave-one-out error on the training trials.

    This is `RidgeClassifierCV` of scikit-learn on standardized features, with the same result
    except for rounding. The decomposition of the trials does not depend on the labels, so it is
    computed once for many labelings.

    ``mean`` and ``spread``, shape (k,), are those of the training trials; the spread is 1 for
    features with equal values. ``scaled``, shape (trials, k), contains the standardized features.
    """

    def __init__(self, shares: Matrix) -> None:
        """Decompose the features of the training trials, shape (trials, k)."""
        self.mean = shares.mean(axis=0)
        self.scaled = shares - self.mean
        self.spread = np.sqrt(np.einsum('ij,ij->j', self.scaled, self.scaled) / len(shares))
        # For equal values, the computed spread is a rounding error such as 5e-17 instead of 0.
        self.spread[(shares == shares[0]).all(axis=0)] = 1.0
        self.scaled /= self.spread
        # The addition of 1 makes the constant vector an eigenvector with a separate eigenvalue. It
        # belongs to the intercept, which `solve` does not penalise.
        self._values, self._vectors = np.linalg.eigh(self.scaled @ self.scaled.T + 1.0)
        self._intercept = np.abs(self._vectors.sum(axis=0)).argmax()

    def solve(self, labels: npt.NDArray[np.str_]) -> tuple[npt.NDArray[np.str_], Matrix, Matrix]:
        """Return the classes, the weights of the training trials, and the intercepts.

        The weights have shape (trials, classes), the intercepts (classes,). If there are two
        classes, there is only one column, for the second class.
        """
        classes, codes = np.unique(labels, return_inverse=True)
        targets = np.where(codes[:, np.newaxis] == np.arange(len(classes)), 1.0, -1.0)
        if len(classes) == 2:
            targets = targets[:, 1:]
        offset = targets.mean(axis=0)
        projected = self._vectors.T @ (targets - offset)
        # A single trial cannot be left out, so all weights remain zero.
        least, best = np.inf, np.zeros_like(targets)
        for alpha in ALPHAS if len(labels) > 1 else ():
            weights = 1.0 / (self._values + alpha)
            weights[self._intercept] = 0.0  # the intercept has no penalty
            dual = self._vectors @ (weights[:, np.newaxis] * projected)
            left_out = dual / (self._vectors**2 @ weights)[:, np.newaxis]
            error = float((left_out**2).mean())
            if error < least:
                least, best = error, dual
        return classes, best, offset

    def compare(self, shares: Matrix) -> Matrix:
        """Return the inner products of other trials with the training trials."""
        return np.asarray((shares - self.mean) / self.spread @ self.scaled.T)

    def predict(self, likeness: Matrix, labels: npt.NDArray[np.str_]) -> npt.NDArray[np.str_]:
        """Predict labels from the result of `compare` and the labels of the training trials."""
        classes, dual, offset = self.solve(labels)
        scores = likeness @ dual + offset
        chosen = scores[:, 0] > 0 if len(classes) == 2 else scores.argmax(axis=1)
        return np.asarray(classes[chosen.astype(np.intp)])
