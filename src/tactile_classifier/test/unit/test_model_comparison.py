# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The comparison of two models against SciPy's tests and distributions."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest, ttest_rel

from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.model_comparison import compare_answers, discordant_interval
from tactile_classifier.records import NO_ANSWER, UNKNOWN


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
    shares = [
        [np.mean(says[session == i] == labels[session == i]) for i in range(6)] for says in (b, a)
    ]
    expected = ttest_rel(*shares).confidence_interval(0.95)
    assert (found.interval.low, found.interval.high) == pytest.approx(
        (expected.low, expected.high), rel=1e-12
    )
    assert found.difference == pytest.approx(np.mean(b == labels) - np.mean(a == labels))
    assert found.interval.method == 't over 6 sessions'
    assert found.better == 'B'
    assert compare_answers(labels, b, a, session).better == 'A'


def test_sessions_weigh_by_their_trials():
    # 30 trials of one session and 10 of another: the difference is over trials.
    labels = np.full(40, 'a')
    a = np.where(np.arange(40) % 2 == 0, 'a', 'b')
    b = np.where(np.arange(40) < 30, 'a', a)
    found = compare_answers(labels, a, b, np.repeat([0, 1], [30, 10]))
    assert found.difference == pytest.approx(15 / 40)
    assert (found.interval.low + found.interval.high) / 2 == pytest.approx(15 / 40)


@pytest.mark.parametrize(('only_a', 'only_b'), [(0, 5), (0, 6), (40, 22), (1, 0)])
def test_one_session_takes_mcnemar_exactly(only_a, only_b):
    trials = 100
    kinds = np.repeat([0, 1, 2], [only_a, only_b, trials - only_a - only_b])
    labels = np.full(trials, 'a')
    a, b = np.where(kinds == 1, 'b', 'a'), np.where(kinds == 0, 'b', 'a')
    found = compare_answers(labels, a, b, np.full(trials, 'monday'))
    assert (found.only_a, found.only_b, found.groups) == (only_a, only_b, 0)
    # Independently: twice the tail of the binomial distribution with one half.
    n, fewer = only_a + only_b, min(only_a, only_b)
    p_value = min(1.0, 2.0 * binom.cdf(fewer, n, 0.5))
    assert found.p_value == pytest.approx(p_value, rel=1e-9)
    assert found.p_value == pytest.approx(binomtest(only_b, n).pvalue)
    assert bool(found.better) == (p_value < 0.05)
    # At each end, the tail beyond what was seen has 2.5 %.
    low, high = ((end * trials / n + 1) / 2 for end in (found.interval.low, found.interval.high))
    if only_b:
        assert binom.sf(only_b - 1, n, low) == pytest.approx(0.025, rel=1e-6)
    if only_a:
        assert binom.cdf(only_b, n, high) == pytest.approx(0.025, rel=1e-6)
    assert found.interval.low <= found.difference <= found.interval.high


def test_models_that_are_right_on_the_same_trials_are_not_told_apart():
    labels = np.array(['a', 'b', 'a', 'b'])
    found = compare_answers(labels, labels, labels)
    assert found.better == ''
    assert found.interval.reason == 'both are right on the same of the 4 trials'
    assert found.p_value == 1.0
    assert found.agreement == 1.0
    assert found.to_dict()['interval'] == {'reason': found.interval.reason}


def test_sessions_with_one_difference_fall_back_on_the_trials():
    labels = np.full(40, 'a')
    a = np.where(np.arange(40) % 2 == 0, 'a', 'b')
    found = compare_answers(labels, a, labels, np.repeat([0, 1], 20))
    assert found.interval == discordant_interval(0, 20, 40)
    assert found.better == 'B'
    assert found.groups == 2


def test_a_rejected_trial_is_not_right_and_is_counted_apart():
    labels = np.array(['a', 'a', 'b', 'b'])
    found = compare_answers(labels, ['a', UNKNOWN, 'b', NO_ANSWER], ['a', 'b', 'b', 'b'])
    assert found.a.accuracy == 0.5
    assert (found.a.unknown_rate, found.a.no_answer_rate) == (0.25, 0.25)
    assert found.a.answered_accuracy == 1.0
    assert found.b.answered_accuracy == 0.75
    assert (found.only_a, found.only_b) == (0, 1)
    assert found.agreement == 0.5
    wrong = {(c.label, c.answer): (c.count_a, c.count_b, c.trials) for c in found.confusions}
    assert wrong == {
        ('a', UNKNOWN): (1, 0, 2), ('a', 'b'): (0, 1, 2), ('b', NO_ANSWER): (1, 0, 2)
    }  # fmt: skip


def test_equal_models_are_called_better_no_more_often_than_once_in_twenty():
    generator = np.random.default_rng(11)
    named = 0
    for seed in generator.integers(1 << 30, size=200):
        labels, a, b, session = draw(6, 30, (0.7, 0.7), seed)
        named += bool(compare_answers(labels, a, b, session).better)
    assert named <= binom.ppf(0.999, 200, 0.05)


def test_what_does_not_belong_together_is_refused():
    with pytest.raises(EvaluationError, match='4 labels, 3 and 4 answers, 4 groups'):
        compare_answers(['a'] * 4, ['a'] * 3, ['a'] * 4, [0] * 4)
    with pytest.raises(EvaluationError, match='0 labels'):
        compare_answers([], [], [])
