# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random convolutions of a waveform with a ridge classifier on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.linear_model import RidgeClassifierCV
from sklearn.utils.validation import check_array

from tactile_classifier.estimators.random_convolutions import RandomConvolutions

__all__ = ['RandomConvolutionClassifier']

ALPHAS = np.logspace(-3, 3, 10)
"""Strengths of the ridge penalty, of which leave-one-out on the training trials chooses one."""

FEATURES = 4998
"""Features against each of the two references."""

Matrix = npt.NDArray[np.float64]


class RandomConvolutionClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Two sets of random convolutions, and a linear classifier of their features.

    Beyond the ends of a waveform a kernel meets zeros, and so the level of the waveform counts.
    Zero is no tension for one half of the kernels, and the mean of the training trials for the
    other half: that one keeps its digits under any offset, and tells levels apart that differ
    little against their mean.

    Parameters
    ----------
    channels : int
        The features of a trial are so many waveforms of equal length, one after another.
    random_state : int

    Attributes
    ----------
    classes_ : ndarray of str, shape (labels,)
    references_ : ndarray of shape (2, channels)
        What is subtracted from the waveforms, for each half of the kernels.
    convolutions_ : list of RandomConvolutions
        One for each reference.
    coef_ : ndarray of shape (labels, features)
        Weight of each feature; one row, for the second label, where there are two.
    intercept_ : ndarray of shape (labels,)
    """

    def __init__(self, channels: int = 1, random_state: int = 0) -> None:
        self.channels = channels
        self.random_state = random_state

    def fit(self, values: npt.ArrayLike, labels: npt.ArrayLike) -> RandomConvolutionClassifier:
        """Fit to waveforms of shape (trials, channels * samples), and one label a trial.

        Raises
        ------
        DatasetError
            When a waveform is too short.
        ValueError
            When a value is not finite.
        """
        rows = self._check(values)
        self.n_features_in_ = rows.shape[1] * rows.shape[2]
        mean = rows.mean(axis=(0, 2))
        self.references_ = np.stack([np.zeros_like(mean), mean])
        self.convolutions_ = [
            RandomConvolutions.fit(rows - reference[:, None], FEATURES, self.random_state + i)
            for i, reference in enumerate(self.references_)
        ]
        ridge, spread = _fit_ridge(self._transform(rows), labels)
        self.classes_ = ridge.classes_
        self.coef_ = np.atleast_2d(ridge.coef_) / spread
        self.intercept_ = np.atleast_1d(ridge.intercept_)
        return self

    def decision_function(self, values: npt.ArrayLike) -> Matrix:
        """Return one score a label; of two labels one alone, positive for the second."""
        scores = self._transform(self._check(values)) @ self.coef_.T + self.intercept_
        return np.asarray(scores[:, 0] if len(self.classes_) == 2 else scores)

    def predict(self, values: npt.ArrayLike) -> npt.NDArray[np.str_]:
        """Return one label a window of ``values``, shape (windows, channels * samples)."""
        scores = self.decision_function(values)
        chosen = (scores > 0).astype(int) if scores.ndim == 1 else scores.argmax(axis=1)
        return np.asarray(self.classes_[chosen])

    def check_folds(
        self,
        values: npt.NDArray[np.float64],
        labels: npt.NDArray[np.str_],
        folds: Sequence[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]],
    ) -> list[npt.NDArray[np.bool_]]:
        """Return which tests of each fold are named correctly by a linear classifier of its own.

        The convolutions stay those of this classifier, whose training had the waveforms of the
        tests, too, but not their labels.
        """
        shares = self._transform(self._check(values))
        answers = []
        for train, test in folds:
            ridge, spread = _fit_ridge(shares[train], labels[train])
            answers.append(np.asarray(ridge.predict(shares[test] / spread) == labels[test]))
        return answers

    def _check(self, values: npt.ArrayLike) -> Matrix:
        rows = check_array(values, dtype=np.float64)
        if rows.shape[1] % self.channels:
            raise ValueError(f'{rows.shape[1]} values are not {self.channels} waveforms')
        return np.asarray(rows.reshape(len(rows), self.channels, -1))

    def _transform(self, rows: Matrix) -> Matrix:
        parts: Sequence[Matrix] = [
            convolutions.transform(rows - reference[:, None])
            for convolutions, reference in zip(self.convolutions_, self.references_, strict=True)
        ]
        return np.hstack(parts)


def _fit_ridge(shares: Matrix, labels: npt.ArrayLike) -> tuple[RidgeClassifierCV, Matrix]:
    """Return the linear classifier of features, and what each of them is divided by."""
    # Divided by the spread alone: without its mean a feature gives the same classifier.
    spread = shares.std(axis=0)
    spread[spread == 0.0] = 1.0
    return RidgeClassifierCV(alphas=ALPHAS).fit(shares / spread, labels), spread
