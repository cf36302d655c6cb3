# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import ttest_1samp

from tactile_classifier.evaluation.intervals import accuracy_interval, difference_interval


def test_no_error_is_not_certainty():
    interval = accuracy_interval(np.ones(60), 'trials')
    # The probability of no error in 60 trials at the lower limit is 2.5 %.
    assert interval.low**60 == pytest.approx(0.025)
    assert interval.high == 1.0
    nothing = accuracy_interval(np.zeros(60), 'trials')
    assert (nothing.low, nothing.high) == (0.0, pytest.approx(1 - interval.low))


def test_groups_without_spread_have_no_interval():
    interval = accuracy_interval(np.ones(6), 'groups')
    assert interval.to_dict() == {'reason': 'all 6 groups have the same accuracy'}
    assert difference_interval(np.zeros(9), 'trials').reason


@pytest.mark.parametrize('groups', [2, 6])
@pytest.mark.parametrize('centre', [0.5, 2.0])
def test_intervals_of_few_groups_cover_a_new_group_s_accuracy(groups, centre):
    generator = np.random.default_rng(7)
    true = expit(centre + generator.standard_normal(200_000)).mean()
    means = generator.binomial(60, expit(centre + generator.standard_normal((500, groups)))) / 60
    intervals = [accuracy_interval(row, 'groups') for row in means if np.ptp(row) > 0]
    covered = np.mean([each.low <= true <= each.high for each in intervals])
    # A bootstrap of the same groups covers 50, 77, 81 and 88 %.
    assert covered > 0.91
    assert all(0.0 <= each.low < each.high <= 1.0 for each in intervals)


def test_equal_weights_change_nothing_and_a_part_without_weight_none():
    parts = np.array([0.5, 0.9, 0.8, 1.0])
    plain = accuracy_interval(parts, 'groups')
    assert accuracy_interval(parts, 'groups', np.full(4, 7)) == plain
    heavy = accuracy_interval(np.array([0.5, 1.0]), 'cells', np.array([1, 99]))
    assert heavy.high > 0.99


def test_tiny_spread_gives_a_narrow_interval_about_the_mean():
    parts = 0.9 + 1e-12 * np.array([-1.0, 0.0, 1.0])
    interval = accuracy_interval(parts, 'groups')
    half = 4.302652729911275 * 1e-12 / np.sqrt(3)
    assert interval.high - interval.low == pytest.approx(2 * half, rel=1e-3)


def test_wilson_is_that_of_the_textbook_for_many_trials():
    # 81 of 263, Newcombe (1998), table I: 0.2553 to 0.3662 with the normal quantile.
    interval = accuracy_interval((np.arange(263) < 81).astype(float), 'trials')
    assert interval.low == pytest.approx(0.2553, abs=5e-4)
    assert interval.high == pytest.approx(0.3662, abs=5e-4)


def test_paired_difference_is_student_s():
    differences = np.random.default_rng(3).normal(0.1, 0.2, 6)
    interval = difference_interval(differences, 'groups')
    expected = ttest_1samp(differences, 0.0).confidence_interval()
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))


def test_paired_difference_keeps_its_sign():
    gains = np.r_[np.ones(30), -np.ones(2), np.zeros(68)]
    interval = difference_interval(gains, 'trials')
    assert 0.15 < interval.low < 0.28 < interval.high < 0.42
    turned = difference_interval(-gains, 'trials')
    assert turned.low == pytest.approx(-interval.high)
