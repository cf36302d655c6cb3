# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of AUROC intervals: variance of DeLong, and coverage on simulated novelties."""

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.metrics import roc_auc_score

from tactile_classifier.evaluation.auroc import auroc_interval, rank_novelty
from tactile_classifier.evaluation.intervals import wilson_interval


def draw_fold(generator, new, known, distance, label='new'):
    """Return the rankings of one fold; the true AUROC is ``norm.cdf(distance / sqrt(2))``."""
    novelty = np.r_[generator.normal(distance, 1.0, new), generator.normal(0.0, 1.0, known)]
    return [rank_novelty(label, np.arange(new + known) < new, novelty)]


def test_area_is_that_of_pairs_and_variance_is_the_one_of_delong():
    generator = np.random.default_rng(1)
    is_new = np.arange(40) < 15
    novelty = np.round(generator.normal(size=40) + 1.3 * is_new, 1)
    (ranking,) = [rank_novelty('a', is_new, novelty)]
    pairs = novelty[is_new][:, None] - novelty[~is_new]
    wins = (pairs > 0) + 0.5 * (pairs == 0)
    assert ranking.auroc == pytest.approx(wins.mean())
    assert ranking.auroc == pytest.approx(roc_auc_score(is_new, novelty))
    variance = wins.mean(axis=1).var(ddof=1) / 15 + wins.mean(axis=0).var(ddof=1) / 25
    expected = wilson_interval(wins.mean(), variance, 14, 'DeLong over 15 trials')
    found = auroc_interval([[ranking]])
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert found.method == expected.method


@pytest.mark.parametrize(
    ('new', 'known', 'folds', 'distance'), [(20, 100, 1, 1.2), (4, 24, 6, 1.2), (20, 60, 1, 0.3)]
)
def test_intervals_over_trials_cover_at_their_level(new, known, folds, distance):
    generator = np.random.default_rng(2)
    true = norm.cdf(distance / np.sqrt(2.0))
    found = [
        auroc_interval([draw_fold(generator, new, known, distance) for _ in range(folds)])
        for _ in range(600)
    ]
    assert 0.93 <= np.mean([each.low <= true <= each.high for each in found]) <= 0.985


@pytest.mark.parametrize(('groups', 'deviation'), [(3, 0.4), (5, 0.0), (5, 0.8), (10, 0.4)])
def test_intervals_over_groups_cover_although_groups_differ(groups, deviation):
    generator = np.random.default_rng(3)
    many = generator.normal(1.2, deviation, 100_000)
    true = norm.cdf(many / np.sqrt(2.0)).mean()
    covered = []
    for _ in range(600):
        distances = generator.normal(1.2, deviation, groups)
        folds = [draw_fold(generator, 10, 40, each) for each in distances]
        found = auroc_interval(folds, 'held-out folds')
        covered.append(found.low <= true <= found.high)
    assert found.method.endswith(f'over {groups} held-out folds')
    assert np.mean(covered) >= 0.93


def test_complete_separation_has_an_exact_bound():
    is_new = np.arange(12) < 5
    ranking = rank_novelty('a', is_new, is_new * 1.0)
    assert ranking.auroc == 1.0
    found = auroc_interval([[ranking]])
    assert (found.low, found.high) == (pytest.approx(0.025 ** (1 / 5)), 1.0)
    by_group = auroc_interval([[ranking]] * 3, 'held-out folds')
    assert (by_group.low, by_group.high) == (pytest.approx(0.025 ** (1 / 3)), 1.0)
    assert by_group.method.endswith('over 3 held-out folds')
