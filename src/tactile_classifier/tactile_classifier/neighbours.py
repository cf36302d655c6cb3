# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cross-validated nearest neighbours without a search tree in every fold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist
from sklearn.preprocessing import StandardScaler

from tactile_classifier.splits import Fold

NEIGHBOURS = 3


def predict_neighbours(
    values: npt.NDArray[np.float64],
    labels: npt.NDArray[np.str_],
    folds: Sequence[Fold],
    scaling: str,
) -> list[npt.NDArray[np.str_]]:
    """Return what the three nearest training trials vote for, for the tests of each fold.

    The answers are those of `build_estimator` ``('knn', scaling)``. Unscaled features need
    one matrix of distances for all folds. Distances are sums of squared differences: the
    expanded square would lose the digits of near copies. Of trials at the same distance the
    first one counts, and of labels with as many votes the first in the order of the alphabet.

    Parameters
    ----------
    values : ndarray of shape (trials, k)
    labels : ndarray of str, shape (trials,)
    folds : sequence of (ndarray, ndarray)
    scaling : str
        ``standard``, fitted to the training trials of each fold, or ``none``.
    """
    classes, codes = np.unique(labels, return_inverse=True)
    distances = cdist(values, values, 'sqeuclidean') if scaling == 'none' else None
    answers = []
    for train, test in folds:
        if distances is None:
            scaler = StandardScaler().fit(values[train])
            near = cdist(
                scaler.transform(values[test]), scaler.transform(values[train]), 'sqeuclidean'
            )
        else:
            near = distances[np.ix_(test, train)]
        answers.append(classes[_vote(near, codes[train], len(classes))])
    return answers


def _vote(
    near: npt.NDArray[np.float64], codes: npt.NDArray[np.intp], classes: int
) -> npt.NDArray[np.intp]:
    """Return the winning class of each row of distances; changes ``near``."""
    rows = np.arange(len(near))
    votes = np.zeros((len(near), classes), dtype=np.int8)
    for _ in range(NEIGHBOURS):
        nearest = np.argmin(near, axis=1)
        votes[rows, codes[nearest]] += 1
        near[rows, nearest] = np.inf
    return np.asarray(np.argmax(votes, axis=1))
