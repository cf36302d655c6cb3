# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copies: trials whose features are equal, or closer than independent repetitions can be.

If the test part of a fold contains a copy of a training trial, the accuracy is too high, because a
classifier that memorizes its training trials knows the label of the copy. Copies arise if a file
is read twice, if a recording is exported again with fewer digits, or if trials are multiplied by
adding noise (data augmentation).

Two trials are copies if their features are equal. Two trials with the same label are also copies
if their features are nearly equal. To decide this, each feature is divided by its standard
deviation within the label. The distance of two trials is the root mean square of the differences
of these features. Trials are copies if their distance is less than a tenth of the smallest
distance that independent repetitions are likely to have.

The smallest likely distance is estimated from the variation of the trials. Let the features of one
label be normally distributed, and let ``l_1 >= ... >= l_k`` be the eigenvalues of their
correlation matrix. For every ``j``, the squared distance of two trials is then at least
``2 l_j / k`` times a chi-squared variable with ``j`` degrees of freedom. The smallest likely
distance follows from the chi-squared quantile at the probability 1e-6 / p, where p is the number
of pairs of trials with equal labels. At most one table in a million then contains an independent
pair that is closer. The factors of a tenth and a millionth allow for features that are not normal,
for example if repetitions within a mounting are much closer than repetitions in different
mountings.

With many independent features (the spectrum of noise), the limit is about 0.05. With three
features (those of a regression), it is about 1e-5 to 1e-4, because two of many trials may agree in
three numbers by accident. Repetitions on a smooth plate are not copies: they differ by the noise
of the sensor, and the features are divided by this noise.
"""

from __future__ import annotations

import hashlib

import numpy as np
import numpy.typing as npt

IndexArray = npt.NDArray[np.intp]
Matrix = npt.NDArray[np.float64]

DIGEST_BITS = 20
"""Resolution of a digest: number of bits to which the largest feature of a trial is rounded. The
other features of the trial are rounded to the same step."""

CHANCE = 1e-6
"""Expected number of independent pairs in a table that are closer than the smallest likely
distance."""

FRACTION = 0.1
"""Maximum distance of copies, as a fraction of the smallest likely distance of repetitions."""

LEAST_DEVIATION = 1e-3
"""Lower limit of the deviation of a feature within a label, relative to its mean over the labels.

Without this limit, the deviation would be too small if all trials of a label are copies.
"""

SAMPLED = 500
"""Maximum number of trials that are used to estimate the eigenvalues."""


def digest_rows(values: Matrix) -> list[str]:
    """Return a digest of each row, 16 hex digits; see `FeatureTable.digest_trials`."""
    exponent = np.frexp(np.abs(values).max(axis=1, keepdims=True))[1]
    rounded = np.rint(np.ldexp(values, DIGEST_BITS - exponent)).astype('<i8')
    return [hashlib.sha256(row.tobytes()).hexdigest()[:16] for row in rounded]


def find_copies(values: Matrix, labels: npt.NDArray[np.str_]) -> IndexArray:
    """Return the index of the original of each trial; if it is not a copy, its own index.

    Trials that are copies of the same trial are also copies of each other. The original is the
    first of all trials that are copies of each other.

    Parameters
    ----------
    values : ndarray of shape (trials, k)
        Features.
    labels : ndarray of str, shape (trials,)

    Returns
    -------
    ndarray of int, shape (trials,)
    """
    from sklearn.cluster import DBSCAN  # not needed for reading a model file

    seen: dict[bytes, int] = {}
    rows_in_order = enumerate(values + 0.0)  # replaces -0.0 by 0.0
    first = np.array([seen.setdefault(row.tobytes(), i) for i, row in rows_in_order], np.intp)
    code = np.unique(labels, return_inverse=True)[1]
    scaled = _scale_within_labels(values, code)
    counts = np.bincount(code)
    limit = _compute_limit(scaled, len(counts), float(counts @ (counts - 1)) / 2)
    for label in range(len(counts)):
        (rows,) = np.nonzero((code == label) & (first == np.arange(len(first))))
        if limit > 0.0 and len(rows) > 1:
            # With min_samples=1, a trial belongs to a cluster if it is near any of its trials.
            group = DBSCAN(eps=np.sqrt(limit), min_samples=1).fit_predict(scaled[rows])
            earliest = np.unique(group, return_index=True)[1]
            first[rows] = rows[earliest[group]]
    return first[first]


def _scale_within_labels(values: Matrix, code: IndexArray) -> Matrix:
    """Standardize the features within each label."""
    counts = np.bincount(code)
    scaled = np.empty_like(values)
    deviations = np.empty((len(counts), values.shape[1]))
    for label, count in enumerate(counts):
        of_label = code == label
        scaled[of_label] = values[of_label] - values[of_label].mean(axis=0)
        square = np.square(scaled[of_label]).sum(axis=0)
        deviations[label] = np.sqrt(square / max(1, count - 1))
    least = LEAST_DEVIATION * deviations.mean(axis=0)
    deviations = np.maximum(deviations, least)
    deviations[deviations == 0.0] = np.inf  # ignore constant features
    scaled /= deviations[code]
    return scaled


def _compute_limit(scaled: Matrix, labels: int, pairs: float) -> float:
    """Return the squared distance, summed over the features, below which trials are copies."""
    from scipy.special import gammaincinv

    trials = len(scaled)
    freedom = trials - labels
    if freedom < 1 or not pairs:
        return 0.0
    sample = scaled[np.linspace(0, trials - 1, min(trials, SAMPLED)).astype(int)]
    squares = np.linalg.svd(sample, compute_uv=False) ** 2
    # At most as many eigenvalues can be estimated as there are degrees of freedom.
    largest = squares[: min(freedom, len(squares))] / (len(sample) * freedom / trials)
    freedoms = np.arange(1, len(largest) + 1)
    quantiles = 2.0 * gammaincinv(freedoms / 2.0, CHANCE / pairs)  # chi-squared distribution
    return float(FRACTION**2 * np.max(2.0 * largest * quantiles))
