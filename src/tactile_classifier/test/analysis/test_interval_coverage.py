# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coverage of the intervals: by enumeration for paired trials, by simulation for sessions.

`docs/evaluation.md` states most of these numbers.
"""

import numpy as np
import pytest
from scipy.special import expit, gammaln, xlogy
from scipy.stats import norm

from tactile_classifier.evaluation.intervals import accuracy_interval, difference_interval
from tactile_classifier.evaluation.model_comparison import paired_interval

SHARES = np.array([0.01, 0.02, *np.arange(0.05, 0.96, 0.05)])
"""Probability that only A, or only B, is right."""


def tango(only_a, only_b, trials):
    ends = np.empty((2, len(only_a)))
    for i in np.flatnonzero(only_a <= only_b):  # the others by exchange of A and B
        found = paired_interval(int(only_a[i]), int(only_b[i]), trials)
        ends[:, (only_a == only_b[i]) & (only_b == only_a[i])] = [[-found.high], [-found.low]]
        ends[:, i] = found.low, found.high
    return ends


def agresti_min(only_a, only_b, trials):
    """Wald's interval with half a trial added to each cell (Agresti and Min 2005)."""
    shares = (only_a + 0.5) / (trials + 2), (only_b + 0.5) / (trials + 2)
    middle = shares[1] - shares[0]
    half = norm.ppf(0.975) * np.sqrt((sum(shares) - middle**2) / (trials + 2))
    return middle - half, middle + half


def enumerate_coverage(interval, trials):
    """Return the coverage at each pair of `SHARES`, summed over all outcomes of the trials."""
    only_a, only_b = np.array([(a, b) for a in range(trials + 1) for b in range(trials + 1 - a)]).T
    counts = np.array([only_a, only_b, trials - only_a - only_b])
    ways = gammaln(trials + 1) - gammaln(counts + 1).sum(axis=0)
    low, high = interval(only_a, only_b, trials)
    covered = []
    for share_a in SHARES:
        for share_b in SHARES[share_a + SHARES <= 1.0 + 1e-9]:
            shares = np.array([share_a, share_b, max(0.0, 1.0 - share_a - share_b)])
            probability = np.exp(ways + xlogy(counts, shares[:, None]).sum(axis=0))
            true = share_b - share_a
            inside = (low <= true + 1e-9) & (true - 1e-9 <= high)
            assert probability.sum() == pytest.approx(1.0)
            covered.append(probability[inside].sum())
    return np.array(covered)


@pytest.mark.parametrize(
    ('trials', 'least', 'mean', 'least_agresti_min'),
    [
        (5, 89.6, 97.1, 83.2),
        (10, 91.4, 96.7, 89.1),
        (20, 92.5, 96.0, 87.6),
        (50, 93.5, 95.2, 92.1),
    ],
)
def test_score_interval_covers(trials, least, mean, least_agresti_min):
    covered = 100.0 * enumerate_coverage(tango, trials)
    assert covered.min() == pytest.approx(least, abs=0.05)
    assert covered.mean() == pytest.approx(mean, abs=0.05)
    # The interval of Agresti and Min covers 95 % on average, and less at its worst.
    rival = 100.0 * enumerate_coverage(agresti_min, trials)
    assert rival.min() == pytest.approx(least_agresti_min, abs=0.05)
    assert rival.mean() == pytest.approx(95.0, abs=0.1)


def cover_sessions(sizes):
    """Return the coverage [%] of the intervals over sessions, over several spreads and accuracies.

    For accuracies of held-out sessions, for differences of two models, and for groups of repeats,
    whose mean is over trials.
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
