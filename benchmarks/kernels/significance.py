# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed and error of the rank-sum tests of all pairs of classes, for all features.

The reference is SciPy, which needs one call per pair and feature.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import mannwhitneyu

from benchmarks.measuring import measure_ratio, Report, Row
from tactile_classifier.evaluation.significance import rank_sum_p_values

Array = NDArray[np.float64]


def run_significance(quick: bool) -> Report:
    """Compare `rank_sum_p_values` with SciPy.

    There are 12 classes of 40 random trials with 91 features; fewer if ``quick``.
    """
    classes, features = (6, 12) if quick else (12, 91)
    rng = np.random.default_rng(4)
    labels = np.repeat([f'T{index:02}' for index in range(classes)], 40)
    shift = 0.3 * np.repeat(np.arange(classes), 40)[:, None] * rng.uniform(size=features)
    smooth = rng.normal(size=(len(labels), features)) + shift
    rows = []
    for name, values in (('no ties', smooth), ('rounded to quarters', np.round(4 * smooth) / 4)):
        ratio = measure_ratio(
            lambda values=values: rank_sum_p_values(values, labels),
            lambda values=values: _test_each(values, labels),
            rounds=3 if quick else 5,
        )
        expected = _test_each(values, labels)
        pairs = np.triu_indices(classes, 1)
        found = rank_sum_p_values(values, labels).p[:, pairs[0], pairs[1]]
        error = float((np.abs(found - expected) / expected).max())
        more: dict[str, Any] = {'times as fast': 1.0 / ratio.median, 'tests': expected.size}
        rows.append(Row(name, ratio, error, 1e-15, more=more))
    return Report(
        'significance: rank_sum_p_values',
        "a loop of scipy.stats.mannwhitneyu(a, b, method='asymptotic') over pairs and features",
        'largest relative difference of a p-value',
        rows,
    )


def _test_each(values: Array, labels: NDArray[np.str_]) -> Array:
    groups = [values[labels == name] for name in np.unique(labels)]
    return np.array(
        [
            [
                mannwhitneyu(a[:, k], b[:, k], method='asymptotic').pvalue
                for a, b in itertools.combinations(groups, 2)
            ]
            for k in range(values.shape[1])
        ]
    )
