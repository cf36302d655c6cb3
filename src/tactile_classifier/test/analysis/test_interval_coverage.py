# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coverage of the intervals over sessions, by simulation.

`docs/evaluation.md` states most of these numbers.
"""

import numpy as np
import pytest
from scipy.special import expit

from tactile_classifier.evaluation.intervals import accuracy_interval, difference_interval


def cover_sessions(sizes):
    """Return the coverage [%] of three kinds of intervals, for several spreads and accuracies.

    The columns are for accuracies of held-out sessions, for differences of two models, and for
    groups of repeated trials, which are weighted by their numbers of trials.
    """
    generator = np.random.default_rng(5)
    covered = []
    for spread in (0.0, 0.5, 1.0):
        for centre in (1.0, 2.5):
            effects = generator.standard_normal((2, 1500, len(sizes)))
            shares = expit(centre + spread * effects)
            population = expit(centre + spread * generator.standard_normal(200_000)).mean()
            a, b = generator.binomial(sizes, shares) / sizes
            sets = (
                (np.sort(a), population, lambda row: accuracy_interval(row, 'sessions')),
                (np.sort(b - a), 0.0, lambda row: difference_interval(row, 'sessions')),
                (a, population, lambda row: accuracy_interval(row, 'groups of repeats', sizes)),
            )
            for rows, true, interval in sets:
                rows, counts = np.unique(
                    rows[np.ptp(rows, axis=1) > 0], axis=0, return_counts=True
                )
                found = map(interval, rows)
                inside = [each.low <= true <= each.high for each in found]
                covered.append(np.average(inside, weights=counts))
    return 100.0 * np.reshape(covered, (-1, 3))


@pytest.mark.parametrize(
    ('sizes', 'accuracy', 'difference', 'repeats'),
    [
        ([20] * 5, (95, 98), (95, 97), (95, 98)),
        ([60, 60], (97, 100), (96, 98), (97, 100)),
        ([30] * 10, (93, 96), (94, 96), (93, 96)),
        ([100, 10, 10, 10, 10], (95, 98), (94, 98), (99, 100)),
        ([60, 40, 20, 10, 5], (95, 98), (94, 99), (98, 100)),
        ([100, 100, 10], (95, 98), (95, 100), (98, 100)),
    ],
)
def test_intervals_over_sessions_cover_whatever_their_sizes(sizes, accuracy, difference, repeats):
    covered = cover_sessions(sizes)
    for column, (least, most) in zip(covered.T, (accuracy, difference, repeats), strict=True):
        assert least - 0.5 <= column.min()
        assert column.max() <= most + 0.5
