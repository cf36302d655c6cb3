# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of intervals of accuracies and differences with SciPy and the literature.

`test/analysis/test_interval_coverage.py` tests the coverage of the intervals.
"""

import numpy as np
import pytest
from scipy.stats import binom, binomtest, ttest_1samp, ttest_rel

from tactile_classifier.coverage import format_coverage
from tactile_classifier.evaluation.intervals import (
    accuracy_interval,
    difference_interval,
    difference_p_value,
)
from tactile_classifier.evaluation.model_accuracy import compare_predictions, score_predictions
from tactile_classifier.types import NO_ANSWER, UNKNOWN


def ends(interval):
    return interval.low, interval.high


def test_no_error_is_not_certainty_and_equal_groups_with_errors_have_no_interval():
    interval = accuracy_interval(np.ones(60), 'trials')
    # If the accuracy is the lower limit, 60 correct trials have a probability of 2.5 %.
    assert interval.low**60 == pytest.approx(0.025)
    assert interval.high == 1.0
    nothing = accuracy_interval(np.zeros(60), 'trials')
    assert ends(nothing) == (0.0, pytest.approx(1 - interval.low))
    groups = accuracy_interval(np.full(6, 0.9), 'groups')
    assert groups.to_dict() == {'reason': 'all 6 groups have the same accuracy'}
    assert difference_interval(np.zeros(9), 'trials').reason


@pytest.mark.parametrize(('groups', 'low'), [(2, 0.158), (3, 0.292), (6, 0.541), (20, 0.832)])
def test_groups_that_are_all_right_have_the_exact_binomial_bound(groups, low):
    found = accuracy_interval(np.ones(groups), 'groups')
    # Each group counts as a single trial.
    expected = binomtest(groups, groups).proportion_ci(0.95, 'exact')
    assert ends(found) == pytest.approx((expected.low, expected.high))
    assert found.low == pytest.approx(low, abs=5e-4)
    assert found.method == f'exact binomial over {groups} groups'
    nothing = accuracy_interval(np.zeros(groups), 'groups')
    assert ends(nothing) == pytest.approx((0.0, 1.0 - found.low))
    # If one group contains most of the trials, the interval is wider.
    heavy = accuracy_interval(np.ones(groups), 'cells', np.r_[100, np.ones(groups - 1)])
    assert heavy.low < found.low


def test_equal_weights_change_nothing_and_a_part_without_weight_none():
    parts = np.array([0.5, 0.9, 0.8, 1.0])
    assert accuracy_interval(parts, 'groups', np.full(4, 7)) == accuracy_interval(parts, 'groups')
    heavy = accuracy_interval(np.array([0.5, 1.0]), 'cells', np.array([1, 99]))
    assert heavy.high > 0.99


def test_tiny_spread_gives_a_narrow_interval_about_the_mean():
    interval = accuracy_interval(0.9 + 1e-12 * np.array([-1.0, 0.0, 1.0]), 'groups')
    half = 4.302652729911275 * 1e-12 / np.sqrt(3)
    assert interval.high - interval.low == pytest.approx(2 * half, rel=1e-3)


def test_wilson_is_that_of_the_textbook_for_many_trials():
    # For 81 of 263 trials, table I of Newcombe (1998) has 0.2553 to 0.3662.
    interval = accuracy_interval((np.arange(263) < 81).astype(float), 'trials')
    assert ends(interval) == pytest.approx((0.2553, 0.3662), abs=5e-4)


def test_paired_difference_is_student_s():
    differences = np.random.default_rng(3).normal(0.1, 0.2, 6)
    expected = ttest_1samp(differences, 0.0).confidence_interval()
    found = difference_interval(differences, 'groups')
    assert ends(found) == pytest.approx((expected.low, expected.high))
    turned = difference_interval(-differences, 'groups')
    assert ends(turned) == pytest.approx((-found.high, -found.low))
    p = ttest_1samp(differences, 0.0).pvalue
    assert difference_p_value(differences, 'groups') == pytest.approx(p)
    assert difference_p_value(-differences, 'groups') == pytest.approx(p)
    assert difference_p_value(np.full(6, 0.1), 'groups') == 1.0


# -- models on labelled trials -------------------------------------------------------


def draw(sessions, each, shares, seed=3):
    """Return labels, predictions of each model, and sessions; accuracy differs by session."""
    generator = np.random.default_rng(seed)
    session = np.repeat(np.arange(sessions), each)
    labels = np.tile(['a', 'b', 'c', 'd'], len(session))[: len(session)]
    wander = generator.normal(0.0, 0.1, sessions)[session]
    predicted = [
        np.where(generator.random(len(labels)) < share + wander, labels, 'x') for share in shares
    ]
    return labels, *predicted, session


def test_interval_over_sessions_is_that_of_the_paired_t_test():
    labels, a, b, session = draw(6, 40, (0.6, 0.8))
    found = compare_predictions(labels, a, b, session)
    shares = [(each == labels).reshape(6, 40).mean(axis=1) for each in (b, a)]
    expected = ttest_rel(*shares).confidence_interval(0.95)
    assert ends(found.interval) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert found.difference == pytest.approx(np.mean(b == labels) - np.mean(a == labels))
    assert found.interval.method == 't over 6 sessions'


def test_mcnemar_is_the_exact_test_of_the_discordant_trials():
    kinds = np.repeat([0, 1, 2], [2, 9, 30])
    labels = np.full(41, 'a')
    a, b = (np.where(kinds == wrong, 'b', 'a') for wrong in (1, 0))
    found = compare_predictions(labels, a, b, None)
    assert (found.only_a, found.only_b) == (2, 9)
    # The p-value is twice the probability of at most two heads in 11 tosses of a fair coin.
    assert found.p_value == pytest.approx(2 * (1 + 11 + 55) / 2**11)
    assert found.interval.reason == 'all trials are of one session'
    same = compare_predictions(labels, a, a, None)
    assert (same.p_value, same.difference) == (1.0, 0.0)


def test_accuracy_is_over_trials_and_a_rejected_trial_is_wrong():
    labels = np.array(['a', 'a', 'b', 'b'])
    found = score_predictions(labels, np.array(['a', UNKNOWN, 'b', NO_ANSWER]), None)
    assert (found.accuracy, found.unknown_rate, found.no_answer_rate) == (0.5, 0.25, 0.25)
    assert found.answered_accuracy == 1.0
    assert found.interval == accuracy_interval([1, 0, 1, 0], 'trials')
    nothing = score_predictions(labels, np.full(4, UNKNOWN), labels)
    assert nothing.answered_accuracy is None
    labels, a, _, session = draw(5, 20, (0.7, 0.7))
    keep = np.arange(100) > 7  # sessions of different sizes
    found = score_predictions(labels[keep], a[keep], session[keep])
    assert found.accuracy == pytest.approx(np.mean(a[keep] == labels[keep]))
    assert found.interval.method == 'Wilson with t over 5 sessions'


def test_intervals_of_equal_models_hold_zero_in_nineteen_of_twenty():
    generator = np.random.default_rng(11)
    missed = 0
    for seed in generator.integers(1 << 30, size=200):
        interval = compare_predictions(*draw(6, 30, (0.7, 0.7), seed)).interval
        missed += not interval.reason and not interval.low <= 0.0 <= interval.high
    assert missed <= binom.ppf(0.999, 200, 0.05)


def test_the_measured_coverage_is_stated_for_held_out_groups():
    """No coverage is stated if each group is completely right or wrong (exact binomial)."""
    assert format_coverage('groups', [1.0, 0.9]) == (
        '; such intervals contained the true accuracy in 84 to 95 % of simulated experiments'
    )
    assert 'in 87 to 88 %' in format_coverage('groups', [0.9], chosen=True)
    assert format_coverage('groups', [1.0, 0.0]) == format_coverage('repetitions', [0.9]) == ''
