# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three nearest neighbours by a rule that leaves no label to rounding.

Between two training trials, at a midpoint or beside duplicates, distances agree but for their
last digits, and these depend on the order of additions: a search tree, a matrix routine and
an ONNX runtime each have their own, and so other labels. Here the order is defined: squared
differences are summed by halves (`halve`), each addition an operation of its own, which IEEE 754
rounds in one way everywhere. Of trials at the same distance the earlier one is nearer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_array

from tactile_classifier.errors import TooFewTrialsError

NEIGHBOURS = 3

Matrix = npt.NDArray[np.float64]


class NearestNeighbours(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """The three nearest training trials vote; Euclidean distance.

    Of trials at the same distance the earlier one is nearer; of labels with as many votes
    the first in the order of the alphabet wins. ``values_`` are the training trials, shape
    (trials, k); ``codes_`` their labels, as positions in ``classes_``.
    """

    def fit(self, values: npt.ArrayLike, labels: npt.ArrayLike) -> NearestNeighbours:
        """Keep the training trials, shape (trials, k), and one label a trial.

        Raises TooFewTrialsError when there are fewer than three, ValueError when one is not
        finite.
        """
        self.values_ = check_array(values, dtype=np.float64, copy=True)
        self.classes_, self.codes_ = np.unique(labels, return_inverse=True)
        self.n_features_in_ = self.values_.shape[1]
        if len(self.values_) < NEIGHBOURS:
            raise TooFewTrialsError(
                f'{NEIGHBOURS} neighbours are asked of {len(self.values_)} training trials: '
                'record more'
            )
        return self

    def predict_proba(self, values: npt.ArrayLike) -> Matrix:
        """Return the share of votes of each label, shape (windows, labels)."""
        rows = check_array(values, dtype=np.float64)
        nearest = _find_nearest(cdist(rows, self.values_, 'sqeuclidean'), rows, self.values_)
        votes = self.codes_[nearest][:, :, np.newaxis] == np.arange(len(self.classes_))
        return np.asarray(votes.sum(axis=1) / NEIGHBOURS)

    def predict(self, values: npt.ArrayLike) -> npt.NDArray[np.str_]:
        """Return one label a window of ``values``, shape (windows, k)."""
        return np.asarray(self.classes_[self.predict_proba(values).argmax(axis=1)])


def halve(size: int) -> Iterator[tuple[int, int]]:
    """Yield where a sum of ``size`` terms is folded, until one term is left.

    Of each pair ``(half, size)``, the terms from ``half`` on are added to the first ones: the
    largest power of two below ``size``, then halves of it.
    """
    while size > 1:
        half = 1 << (size - 1).bit_length() - 1
        yield half, size
        size = half


def _sum_squares(known: Matrix, row: Matrix) -> Matrix:
    """Return the squared distance of each trial to one row, shape (trials,), as defined."""
    terms = (known - row).T
    terms = terms * terms
    for half, size in halve(len(terms)):
        terms[: size - half] += terms[half:size]
    return np.asarray(terms[0])


def _find_nearest(near: Matrix, rows: Matrix, known: Matrix) -> npt.NDArray[np.intp]:
    """Return the three nearest trials of each row, shape (windows, 3), in the order of trials.

    ``near`` are squared distances of the rows to the known trials, shape (windows, trials), summed
    in any order. Where their rounding errors could decide who is nearest, the distances are
    computed again as defined; there are few such rows.
    """
    third = np.partition(near, NEIGHBOURS - 1, axis=1)[:, NEIGHBOURS - 1]
    # k + 2 roundings of half an epsilon each, in both sums and both trials of a pair, are
    # 2 (k + 2) epsilon; twice that. The second term: below it squares lose digits.
    k = rows.shape[1]
    limits = np.finfo(np.float64)
    third += third * (4 * (k + 2) * limits.eps) + 4 * k * limits.tiny
    # Not ``near <= third``: of distances that overflow to infinity each is a candidate.
    is_candidate = ~(near > third[:, np.newaxis])
    for i in np.flatnonzero(is_candidate.sum(axis=1) > NEIGHBOURS):
        candidates = np.flatnonzero(is_candidate[i])
        order = np.argsort(_sum_squares(known[candidates], rows[i]), kind='stable')
        is_candidate[i, candidates[order[NEIGHBOURS:]]] = False
    return np.nonzero(is_candidate)[1].reshape(len(rows), NEIGHBOURS)
