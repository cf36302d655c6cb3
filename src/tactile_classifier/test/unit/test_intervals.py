# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Intervals of accuracies, and the comparison of two models, against SciPy and the literature.

Coverage is in `test/analysis/test_interval_coverage.py`.
"""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import xlogy
from scipy.stats import binom, chi2, ttest_1samp, ttest_rel

from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.intervals import accuracy_interval, difference_interval
from tactile_classifier.evaluation.model_comparison import compare_answers, paired_interval
from tactile_classifier.records import NO_ANSWER, UNKNOWN


def ends(interval):
    return interval.low, interval.high


def test_no_error_is_not_certainty_and_groups_without_spread_have_no_interval():
    interval = accuracy_interval(np.ones(60), 'trials')
    # The probability of no error in 60 trials at the lower limit is 2.5 %.
    assert interval.low**60 == pytest.approx(0.025)
    assert interval.high == 1.0
    nothing = accuracy_interval(np.zeros(60), 'trials')
    assert ends(nothing) == (0.0, pytest.approx(1 - interval.low))
    groups = accuracy_interval(np.ones(6), 'groups')
    assert groups.to_dict() == {'reason': 'all 6 groups have the same accuracy'}
    assert difference_interval(np.zeros(9), 'trials').reason


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
    # 81 of 263, Newcombe (1998), table I: 0.2553 to 0.3662 with the normal quantile.
    interval = accuracy_interval((np.arange(263) < 81).astype(float), 'trials')
    assert ends(interval) == pytest.approx((0.2553, 0.3662), abs=5e-4)


def test_paired_difference_is_student_s():
    differences = np.random.default_rng(3).normal(0.1, 0.2, 6)
    expected = ttest_1samp(differences, 0.0).confidence_interval()
    found = difference_interval(differences, 'groups')
    assert ends(found) == pytest.approx((expected.low, expected.high))
    turned = difference_interval(-differences, 'groups')
    assert ends(turned) == pytest.approx((-found.high, -found.low))


# -- two models ---------------------------------------------------------------------


def draw(sessions, each, shares, seed=3):
    """Return labels, answers of A and B, and sessions that differ in accuracy."""
    generator = np.random.default_rng(seed)
    session = np.repeat(np.arange(sessions), each)
    labels = np.tile(['a', 'b', 'c', 'd'], len(session))[: len(session)]
    wander = generator.normal(0.0, 0.1, sessions)[session]
    answers = [
        np.where(generator.random(len(labels)) < share + wander, labels, 'x') for share in shares
    ]
    return labels, *answers, session


def test_interval_over_sessions_is_that_of_the_paired_t_test():
    labels, a, b, session = draw(6, 40, (0.6, 0.8))
    found = compare_answers(labels, a, b, session)
    shares = [(says == labels).reshape(6, 40).mean(axis=1) for says in (b, a)]
    expected = ttest_rel(*shares).confidence_interval(0.95)
    assert ends(found.interval) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert found.difference == pytest.approx(np.mean(b == labels) - np.mean(a == labels))
    assert found.interval.method == 't over 6 sessions'
    assert (found.better, compare_answers(labels, b, a, session).better) == ('B', 'A')


def test_each_session_counts_once():
    # 30 trials of one session and 10 of another: half of the first is gained, none of the other.
    labels = np.full(40, 'a')
    a = np.where(np.arange(40) % 2 == 0, 'a', 'b')
    b = np.where(np.arange(40) < 30, 'a', a)
    found = compare_answers(labels, a, b, np.repeat([0, 1], [30, 10]))
    assert found.difference == pytest.approx((15 / 30 + 0) / 2)
    assert np.mean(ends(found.interval)) == pytest.approx(found.difference)
    assert found.a.accuracy == pytest.approx(0.5)
    assert found.b.accuracy == pytest.approx((1.0 + 0.5) / 2)
    assert found.agreement == pytest.approx((0.5 + 1.0) / 2)


def compare_counts(only_a, only_b, trials):
    """Return the comparison of two models on one session with so many one-sided trials."""
    kinds = np.repeat([0, 1, 2], [only_a, only_b, trials - only_a - only_b])
    a, b = (np.where(kinds == wrong, 'b', 'a') for wrong in (1, 0))
    return compare_answers(np.full(trials, 'a'), a, b, np.full(trials, 'monday'))


def score_statistic(only_a, only_b, trials, difference):
    """Return the score statistic of a difference, its likelihood maximised by SciPy."""

    def loss(share):  # of trials that only A names; only B: share + difference
        cells = np.array([share, share + difference, 1.0 - 2.0 * share - difference])
        return -xlogy([only_a, only_b, trials - only_a - only_b], np.maximum(cells, 1e-300)).sum()

    bounds = max(0.0, -difference), (1.0 - difference) / 2.0
    share = minimize_scalar(loss, bounds=bounds, method='bounded', options={'xatol': 1e-12}).x
    variance = trials * (2.0 * share + difference - difference**2)
    return (only_b - only_a - trials * difference) / np.sqrt(variance)


@pytest.mark.parametrize(('only_a', 'only_b'), [(0, 5), (0, 3), (40, 22), (1, 0), (7, 0), (9, 9)])
def test_one_session_takes_the_score_interval(only_a, only_b):
    found = compare_counts(only_a, only_b, 100)
    assert (found.only_a, found.only_b, found.groups) == (only_a, only_b, 0)
    for end in ends(found.interval):
        assert abs(score_statistic(only_a, only_b, 100, end)) == pytest.approx(1.96, abs=2e-3)
    assert found.interval.low < found.difference < found.interval.high
    # The test of the same kind: McNemar's, a chi-squared of one degree of freedom.
    p_value = chi2.sf((only_a - only_b) ** 2 / (only_a + only_b), 1)
    assert found.p_value == pytest.approx(p_value, rel=1e-9)
    assert bool(found.better) == (p_value < 0.05)


@pytest.mark.parametrize(
    ('counts', 'low', 'high'),
    [
        # Fagerland, Lydersen and Laake (2014), Statistics in Medicine 33, 2850: 21 children.
        ((7, 1, 21), -0.517, -0.026),
        # No discordant trial: z^2 / (n + z^2) on both sides.
        ((0, 0, 30), -3.8414588 / 33.8414588, 3.8414588 / 33.8414588),
    ],
)
def test_score_interval_is_that_of_the_literature(counts, low, high):
    assert ends(paired_interval(*counts)) == pytest.approx((low, high), abs=5e-4)


def test_score_interval_ends_at_the_estimate_only_where_nothing_lies_beyond():
    # Nothing says that seven of 17 trials are the most that ever differ.
    found = paired_interval(0, 7, 17)
    assert found.low < 7 / 17 < found.high < 1.0
    assert paired_interval(0, 17, 17).high == 1.0
    for only_a, only_b in ((0, 7), (3, 9), (17, 0), (0, 0)):
        there, back = paired_interval(only_a, only_b, 17), paired_interval(only_b, only_a, 17)
        assert ends(there) == pytest.approx((-back.high, -back.low), abs=1e-9)


def test_models_that_are_right_on_the_same_trials_are_not_told_apart():
    labels = np.array(['a', 'b', 'a', 'b'])
    found = compare_answers(labels, labels, labels)
    assert (found.better, found.p_value, found.agreement) == ('', 1.0, 1.0)
    assert found.interval.low == -found.interval.high < 0.0
    assert found.to_dict()['interval']['method'] == 'Tango score interval over 4 paired trials'


def test_sessions_with_one_difference_fall_back_on_the_trials():
    labels = np.full(40, 'a')
    a = np.where(np.arange(40) % 2 == 0, 'a', 'b')
    found = compare_answers(labels, a, labels, np.repeat([0, 1], 20))
    assert found.interval == paired_interval(0, 20, 40)
    assert (found.better, found.groups) == ('B', 2)


def test_a_rejected_trial_is_not_right_and_is_counted_apart():
    labels = np.array(['a', 'a', 'b', 'b'])
    found = compare_answers(labels, ['a', UNKNOWN, 'b', NO_ANSWER], ['a', 'b', 'b', 'b'])
    assert found.a.accuracy == 0.5
    assert (found.a.unknown_rate, found.a.no_answer_rate) == (0.25, 0.25)
    assert (found.a.answered_accuracy, found.b.answered_accuracy) == (1.0, 0.75)
    assert (found.only_a, found.only_b, found.agreement) == (0, 1, 0.5)
    wrong = {(c.label, c.answer): (c.count_a, c.count_b, c.trials) for c in found.confusions}
    assert wrong == {
        ('a', UNKNOWN): (1, 0, 2), ('a', 'b'): (0, 1, 2), ('b', NO_ANSWER): (1, 0, 2)
    }  # fmt: skip


def test_equal_models_are_called_better_no_more_often_than_once_in_twenty():
    generator = np.random.default_rng(11)
    named = 0
    for seed in generator.integers(1 << 30, size=200):
        named += bool(compare_answers(*draw(6, 30, (0.7, 0.7), seed)).better)
    assert named <= binom.ppf(0.999, 200, 0.05)


def test_what_does_not_belong_together_is_refused():
    with pytest.raises(EvaluationError, match='4 labels, 3 and 4 answers, 4 groups'):
        compare_answers(['a'] * 4, ['a'] * 3, ['a'] * 4, [0] * 4)
    with pytest.raises(EvaluationError, match='0 labels'):
        compare_answers([], [], [])
