# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Significance of single features: rank-sum tests of all pairs of classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from tactile_classifier.errors import DatasetError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

# Maximum number of values in a block of features. The tables of such a block fit in the cache.
_BLOCK_NUMBERS = 200_000


@dataclass(frozen=True)
class RankSum:
    """P-values of the rank-sum tests of all pairs of classes, and effect sizes.

    Attributes
    ----------
    labels : tuple of str
        Sorted classes, in the order of the rows and columns of ``p``.
    p : ndarray of shape (k, classes, classes)
        Two-sided p-value of each feature and pair; symmetric, with 1 on the diagonal.
    mean_p : ndarray of shape (k,)
        Mean p-value over the pairs of different classes: the significance measure of the paper. It
        is low if the feature distinguishes most pairs.
    auc : ndarray of shape (k, classes, classes)
        Effect size: probability that a trial of the row's class has a larger value than a trial of
        the column's class in the same stratum [1]. A tie counts half. The value is 0.5 on the
        diagonal, and for classes that have no common stratum. Cliff's delta is ``2 * auc - 1``.
    strata : int
        Number of sessions within which trials were compared; 1 if there are no sessions.
    counts : tuple of int
        Number of tested values of each class: number of units, or of trials if there are no units.
    least_p : float
        Smallest p-value that is possible with these numbers of values; maximum over the pairs.
    """

    labels: tuple[str, ...]
    p: FloatArray
    mean_p: FloatArray
    auc: FloatArray
    strata: int
    counts: tuple[int, ...]
    least_p: float

    @property
    def separation(self) -> FloatArray:
        """Mean of max(AUC, 1 - AUC) over the pairs of classes, shape (k,) [1]."""
        pairs = np.triu_indices(len(self.labels), 1)
        auc = self.auc[:, pairs[0], pairs[1]]
        return np.asarray(np.maximum(auc, 1.0 - auc).mean(axis=1))


def rank_sum_p_values(
    values: ArrayLike,
    labels: ArrayLike,
    strata: ArrayLike | None = None,
    units: ArrayLike | None = None,
) -> RankSum:
    """Return the p-values of Wilcoxon's rank-sum test for all pairs of classes and all features.

    The test assumes independent values, but trials of one mounting are not independent. If
    ``units`` are given, the means of units are tested instead of single trials. For example, let
    plates be mounted once per session, with ten trials per mounting, and let the label have no
    effect. If the standard deviation between mountings is 0.5 to 2 times that between trials,
    tests of single trials then find p < 0.05 in 24 to 53 % of the pairs.

    The normal approximation is used, with corrections for ties and continuity, as in
    ``scipy.stats.mannwhitneyu(a, b, method='asymptotic')`` for each pair.
    (``scipy.stats.ranksums`` uses neither correction, so its p-values are slightly smaller.) If
    all values of two classes are equal, as for the component at 0 Hz, p is 1.

    The paper (section IV) does not state the variant of the test, and averages "elements of" the
    matrix. The averages in the paper are below 0.05 for most components. If the ones on the
    diagonal were included, no average could be below 1 / number of classes. The mean is therefore
    computed over the pairs of different classes.

    If ``strata`` are given, the test of van Elteren (1960) is used: trials are compared only
    within their stratum, and a stratum with n trials of the two classes has the weight 1 / (n +
    1). Differences between sessions then neither hide nor cause a difference between classes. The
    correction for continuity is half of the smallest weight. If two classes have no common
    stratum, p is 1.

    One sort per feature and stratum is sufficient for all pairs: ``c_b(x)`` is the number of
    values of class b below x plus half the number of equal values. ``U_ab`` is the sum of ``c_b``
    over the values of class a.

    Parameters
    ----------
    values : array_like of shape (trials, k)
        Features.
    labels : array_like of str, shape (trials,)
    strata : array_like of shape (trials,), optional
        Stratum of each trial, such as its session.
    units : array_like of shape (trials,), optional
        Unit of each trial, such as its mounting. A unit contains trials of one class and one
        stratum.

    Raises
    ------
    DatasetError
        If shapes are inconsistent, a value is not finite, there are fewer than two classes, or a
        unit contains trials of several classes or strata.
    """
    table = np.asarray(values, dtype=np.float64)
    names = np.asarray(labels)
    strata = np.zeros(len(names)) if strata is None else np.asarray(strata)
    unit = np.arange(len(names)) if units is None else np.asarray(units)
    if table.ndim != 2 or not names.shape == strata.shape == unit.shape == table.shape[:1]:
        raise DatasetError(
            'rank sums need a table of trials by features, and one label, stratum and unit per '
            f'trial; the shapes are {table.shape}, {names.shape}, {strata.shape} and {unit.shape}'
        )
    if not np.isfinite(table).all():
        raise DatasetError('some features are not finite; exclude the trials that have them')
    found, index = np.unique(names, return_inverse=True)
    stratum = np.unique(strata, return_inverse=True)[1]
    if len(found) < 2:
        raise DatasetError(f'rank sums compare at least two classes, not {len(found)}')
    tested, tested_index, tested_stratum = _average(table, index, stratum, unit)
    p, auc = np.empty((2, table.shape[1], len(found), len(found)))
    step = max(1, _BLOCK_NUMBERS // (len(table) * len(found)))
    for at in range(0, table.shape[1], step):
        block = slice(at, at + step)
        p[block], auc[block] = _test_pairs(tested[:, block].T, tested_index, tested_stratum)
        if len(tested) < len(table):
            _, auc[block] = _test_pairs(table[:, block].T, index, stratum)
    pairs = np.triu_indices(len(found), 1)
    return RankSum(
        labels=tuple(str(name) for name in found),
        p=p,
        mean_p=p[:, pairs[0], pairs[1]].mean(1),
        auc=auc,
        strata=int(stratum.max()) + 1,
        counts=tuple(np.bincount(tested_index, minlength=len(found)).tolist()),
        least_p=_find_least_p(tested_index, tested_stratum),
    )


def rank_features(
    values: ArrayLike, labels: ArrayLike, strata: ArrayLike | None = None
) -> IntArray:
    """Return the columns of ``values`` from the lowest to the highest mean p of single trials.

    Columns with the same mean keep their order. In cross-validation, rank the features on the
    training trials of each fold, because a ranking on all trials uses the test trials. Raises the
    same errors as `rank_sum_p_values`.
    """
    return np.argsort(rank_sum_p_values(values, labels, strata).mean_p, kind='stable')


def correct_holm(p_values: ArrayLike) -> FloatArray:
    """Return p-values with Holm's (1979) correction for multiple tests, shape (n,).

    The probability of any false positive among corrected values up to 0.05 is at most 5 %, for any
    dependence between the tests.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def _average(
    table: FloatArray, index: IntArray, stratum: IntArray, unit: NDArray[np.generic]
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the mean of each unit with its class and stratum."""
    _, first, code = np.unique(unit, return_index=True, return_inverse=True)
    if len(first) == len(table):
        return table, index, stratum
    if (index != index[first][code]).any() or (stratum != stratum[first][code]).any():
        raise DatasetError(
            'a unit, such as a mounting, contains trials of several classes or strata; give each '
            'unit a unique name'
        )
    sums = np.zeros((len(first), table.shape[1]))
    np.add.at(sums, code, table)
    return sums / np.bincount(code)[:, None], index[first], stratum[first]


def _count_classes(index: IntArray, stratum: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the size of each class in each stratum, and the weight of each pair there."""
    classes = index.max() + 1
    sizes = np.array(
        [np.bincount(index[stratum == h], minlength=classes) for h in range(stratum.max() + 1)]
    )
    pooled = sizes[:, :, None] + sizes[:, None, :]
    weights = np.where(sizes[:, :, None] * sizes[:, None, :] > 0, 1.0 / (pooled + 1.0), 0.0)
    # If there is only one stratum, its weight is 1, and the result is identical to that of SciPy.
    return sizes, weights / np.maximum(weights.max(axis=0), 1e-300)


def _find_least_p(index: IntArray, stratum: IntArray) -> float:
    """Return the p-value of completely separated classes; maximum over the pairs of classes."""
    sizes, weights = _count_classes(index, stratum)
    product = sizes[:, :, None] * sizes[:, None, :]
    pooled = sizes[:, :, None] + sizes[:, None, :]
    surplus = (weights * product / 2).sum(axis=0)
    variance = (weights**2 * product / 12 * (pooled + 1)).sum(axis=0)
    p = _compute_p(surplus, variance, weights)
    return float(p[np.triu_indices(len(p), 1)].max())


def _test_pairs(
    values: FloatArray, index: IntArray, stratum: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return p and AUC, both (k, classes, classes), for values of shape (k, trials)."""
    values = np.ascontiguousarray(values)
    sizes, weights = _count_classes(index, stratum)
    classes = sizes.shape[1]
    surplus = np.zeros((len(values), classes, classes))
    variance, larger = np.zeros_like(surplus), np.zeros_like(surplus)
    for h, weight in enumerate(weights):
        inside = stratum == h
        u, ties = _count_pairs(values[:, inside], index[inside], classes)
        product, n = np.multiply.outer(sizes[h], sizes[h]), np.add.outer(sizes[h], sizes[h])
        surplus += weight * (u - product / 2)
        # The order of operations is that of SciPy, so that results are identical.
        variance += weight**2 * (product / 12 * ((n + 1) - ties / np.maximum(n * (n - 1), 1)))
        larger += u
    p = _compute_p(surplus, variance, weights)
    compared = (sizes[:, :, None] * sizes[:, None, :]).sum(axis=0)
    auc = np.where(compared > 0, larger / np.maximum(compared, 1), 0.5)
    diagonal = np.arange(classes)
    p[:, diagonal, diagonal], auc[:, diagonal, diagonal] = 1.0, 0.5
    return p, auc


def _compute_p(surplus: FloatArray, variance: FloatArray, weights: FloatArray) -> FloatArray:
    """Return two-sided p-values of shape (..., classes, classes); 1 without variance."""
    smallest = np.where(weights > 0.0, weights, np.inf).min(axis=0)
    step = np.where(np.isfinite(smallest), smallest, 1.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        z = (np.abs(surplus) - 0.5 * step) / np.sqrt(variance)
    return np.asarray(np.minimum(2.0 * ndtr(-z), 1.0))


def _count_pairs(
    values: FloatArray, index: IntArray, classes: int
) -> tuple[FloatArray, FloatArray]:
    """Return U and the sums over ties, both (k, classes, classes), of (k, trials) values."""
    k, n = values.shape
    order = np.argsort(values, axis=1)
    ordered = np.take_along_axis(values, order, axis=1)
    member = (index[order][:, :, None] == np.arange(classes)).astype(np.float64)
    below = np.zeros((k, n + 1, classes))
    np.cumsum(member, axis=1, out=below[:, 1:])

    counts = below[:, :-1]
    ties = np.zeros((k, classes, classes))
    new = ordered[:, 1:] != ordered[:, :-1]
    tied = np.flatnonzero(~new.all(axis=1))
    if len(tied):
        counts[tied], ties[tied] = _count_ties(below[tied], new[tied])
    return member.transpose(0, 2, 1) @ counts, ties


def _count_ties(below: FloatArray, new: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return the counts below each value plus half of the equal values, and the ties of the pairs.

    Ties are the sum of t^3 - t over the groups of t = a + b equal values, with a and b values of
    the two classes. All numbers are integers or halves, so the results are exact. ``below`` holds
    cumulative counts in the order of the values, shape (k, trials + 1, classes). ``new`` is true
    for each value, except the first, that differs from the previous value.
    """
    k, n = below.shape[0], below.shape[1] - 1
    begins, ends = np.ones((k, n), dtype=bool), np.ones((k, n), dtype=bool)
    begins[:, 1:] = ends[:, :-1] = new
    # Each group of equal values of a feature has a number; numbers continue over all features.
    group = np.cumsum(begins.ravel()) - 1
    low, high = below[:, :-1][begins], below[:, 1:][ends]
    counts = (0.5 * (low + high))[group].reshape(k, n, -1)

    equal = high - low
    shared = equal.sum(axis=1) > 1.0
    equal, owner = equal[shared], np.nonzero(begins)[0][shared]
    cubes = equal**3 - equal
    mixed = equal[:, :, None] ** 2 * equal[:, None, :]
    terms = cubes[:, :, None] + cubes[:, None, :] + 3.0 * (mixed + mixed.transpose(0, 2, 1))
    starts = np.searchsorted(owner, np.arange(k))
    return counts, np.add.reduceat(terms, starts, axis=0)
