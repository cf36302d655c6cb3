# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of rank sums against SciPy and exact fractions."""

from fractions import Fraction
import itertools
import math

from classifier_tables import make_table
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from scipy.stats import mannwhitneyu, norm

from tactile_classifier.datasets.conditions import find_mountings, find_strata
from tactile_classifier.errors import DatasetError
from tactile_classifier.evaluation.significance import (
    correct_holm,
    rank_features,
    rank_sum_p_values,
)


def peer_p_values(values, labels):
    """Return p-values of SciPy, one test for each pair and feature; 1 for equal values."""
    labels = np.asarray(labels)
    names = sorted(set(labels.tolist()))
    p = np.ones((values.shape[1], len(names), len(names)))
    for (i, a), (j, b) in itertools.combinations(enumerate(names), 2):
        for k in range(values.shape[1]):
            pair = values[labels == a, k], values[labels == b, k]
            if len(set(np.concatenate(pair).tolist())) > 1:
                p[k, i, j] = p[k, j, i] = mannwhitneyu(*pair, method='asymptotic').pvalue
    return p


@pytest.mark.parametrize('step', [0.0, 0.25, 1.0])
def test_p_is_that_of_scipy_with_and_without_ties(step):
    rng = np.random.default_rng(1)
    labels = np.repeat(['rubber', 'PLA', 'steel', 'foam'], [3, 40, 17, 60])
    values = rng.normal(size=(120, 6)) + 0.6 * np.arange(6) * (labels == 'PLA')[:, None]
    if step:
        values = np.round(values / step) * step
    order = rng.permutation(120)
    found = rank_sum_p_values(values[order], labels[order])
    expected = peer_p_values(values, labels)
    assert found.labels == ('PLA', 'foam', 'rubber', 'steel')
    np.testing.assert_allclose(found.p, expected, rtol=1e-15, atol=0)
    assert expected.min() < 1e-6  # so that tiny p-values are tested, too


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(2, 25), st.integers(1, 4)),
        elements=st.integers(-3, 3).map(float),
    ),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=20, deadline=None)
def test_p_is_that_of_scipy_on_any_table(values, seed):
    labels = np.random.default_rng(seed).choice(['a', 'b', 'c'], len(values))
    labels[:2] = 'a', 'b'
    found = rank_sum_p_values(values, labels)
    np.testing.assert_allclose(found.p, peer_p_values(values, labels), rtol=1e-15, atol=0)
    i, j = np.triu_indices(len(found.labels), 1)  # without the diagonal
    np.testing.assert_allclose(found.mean_p, found.p[:, i, j].mean(axis=1), rtol=1e-15)
    assert np.array_equal(rank_sum_p_values(values, labels, ['s'] * len(values)).p, found.p)


def test_many_features_go_in_blocks_with_the_same_result():
    rng = np.random.default_rng(2)
    labels = np.repeat([f'T{i}' for i in range(12)], 10)
    values = np.round(rng.normal(size=(120, 400)), 1)
    whole = rank_sum_p_values(values, labels)
    for k in (0, 138, 139, 399):
        assert np.array_equal(rank_sum_p_values(values[:, [k]], labels).p[0], whole.p[k])


def test_features_are_ranked_from_the_most_telling():
    labels = np.repeat(['a', 'b'], 40)
    values = np.random.default_rng(4).normal(size=(80, 4))
    values[:, 0] = 0.0  # the component at 0 Hz is constant
    values[40:, 2] += 3.0
    values[40:, 3] += 1.0
    order = rank_features(values, labels).tolist()
    assert order[:2] == [2, 3]
    assert order[-1] == 0
    assert rank_sum_p_values(values, labels).mean_p[0] == 1.0


@pytest.mark.parametrize(
    ('values', 'labels', 'message'),
    [
        (np.ones(4), ['a'] * 4, 'shapes'),
        (np.ones((4, 2)), ['a'] * 3, 'shapes'),
        (np.ones((4, 2)), ['a'] * 4, 'at least two classes, not 1'),
        (np.full((2, 1), np.nan), ['a', 'b'], 'not finite'),
    ],
)
def test_refuses_what_cannot_be_tested(values, labels, message):
    with pytest.raises(DatasetError, match=message):
        rank_sum_p_values(values, labels)


def compute_van_elteren(values, labels, strata):
    """Return statistic and variance of van Elteren's test for two classes, as fractions."""
    surplus, variance = Fraction(0), Fraction(0)
    for stratum in set(strata):
        inside = [
            (Fraction(value), label)
            for value, label, its in zip(values, labels, strata, strict=True)
            if its == stratum
        ]
        one, other = ([value for value, label in inside if label == name] for name in 'ab')
        n = len(one) + len(other)
        if not one or not other:
            continue
        u = sum(Fraction(int(a > b)) + Fraction(int(a == b), 2) for a in one for b in other)
        counts = [(one + other).count(v) for v in set(one + other)]
        ties = sum(t**3 - t for t in counts)
        spread = Fraction(len(one) * len(other), 12) * (n + 1 - Fraction(ties, n * (n - 1)))
        surplus += Fraction(1, n + 1) * (u - Fraction(len(one) * len(other), 2))
        variance += Fraction(1, n + 1) ** 2 * spread
    return surplus, variance


@pytest.mark.parametrize('step', [0.0, 0.5])
def test_stratified_p_is_van_elteren_s(step):
    rng = np.random.default_rng(8)
    labels = np.array([*'aaaabbb', *'aaabbbbbb', *'aabb', *'aaaa'])
    strata = np.repeat([3, 1, 2, 9], [7, 9, 4, 4])
    values = rng.normal(size=24) + 1e3 * strata + 0.8 * (labels == 'b')
    values = np.round(values / step) * step if step else values
    found = rank_sum_p_values(values[:, None], labels, strata)
    surplus, variance = compute_van_elteren(values.tolist(), labels.tolist(), strata.tolist())
    smallest = Fraction(1, 10)  # weight of the largest stratum with both labels
    z = (abs(surplus) - smallest / 2) / Fraction(math.sqrt(variance))
    assert found.strata == 4
    assert found.p[0, 0, 1] == pytest.approx(2 * norm.sf(float(z)), rel=1e-12)


def test_stratified_p_is_right_in_size_where_sessions_shift_all_trials():
    rng = np.random.default_rng(10)
    labels = np.tile(np.repeat(['a', 'b'], 10), 6)
    # Class "a" has fewer trials in the last three sessions. The session shifts both classes.
    keep = rng.random((120,)) < np.where(labels == 'a', np.repeat([1, 0.4], 60), 0.8)
    session = np.repeat(np.arange(6), 20)[keep]
    shift = 3.0 * (session < 3)
    values = rng.normal(size=(keep.sum(), 2000)) + shift[:, None]
    p = rank_sum_p_values(values, labels[keep], session).p[:, 0, 1]
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.015)
    assert (rank_sum_p_values(values, labels[keep]).p[:, 0, 1] < 0.05).mean() > 0.1


def test_classes_that_share_no_session_are_not_compared():
    labels = np.repeat(['a', 'b', 'c'], 8)
    session = np.r_[np.zeros(8), np.ones(8), np.tile([0, 1], 4)]
    values = np.random.default_rng(11).normal(size=(24, 3)) + 9.0 * (labels == 'b')[:, None]
    found = rank_sum_p_values(values, labels, session)
    assert (found.p[:, 0, 1] == 1.0).all()
    assert (found.p[:, 1, 2] < 0.05).all()


# -- mountings ----------------------------------------------------------------------


def draw_mountings(rng, sessions, spread, features, trials=10, effect=0.0):
    """Draw four labels, each mounted once per session; mountings differ by ``spread``."""
    code = np.repeat(np.arange(4), sessions * trials)
    session = np.tile(np.repeat(np.arange(sessions), trials), 4)
    mounting = code * sessions + session
    values = spread * rng.normal(size=(4 * sessions, features))[mounting]
    values += rng.normal(size=values.shape) + effect * code[:, None]
    columns = {'session': session.astype(str), 'mounting': mounting.astype(str)}
    return make_table(np.array([*'abcd'])[code], values, **columns)


@pytest.mark.parametrize('spread', [0.5, 2.0])
@pytest.mark.parametrize('sessions', [6, 10])
def test_mountings_that_differ_are_no_effect_of_the_label(sessions, spread):
    """Tests of single trials find p < 0.05 in 24 to 53 % of the pairs."""
    table = draw_mountings(np.random.default_rng(0), sessions, spread, 91)
    found = rank_sum_p_values(
        table.values, table.labels, find_strata(table), find_mountings(table)
    )
    one, other = np.triu_indices(4, 1)
    assert (found.p[:, one, other] <= 0.05).mean() <= 0.07
    assert found.counts == (sessions,) * 4
    assert found.strata == sessions
    trials = rank_sum_p_values(table.values, table.labels, find_strata(table))
    assert (trials.p[:, one, other] <= 0.05).mean() > 0.15
    assert trials.counts == (10 * sessions,) * 4


def test_an_effect_of_the_label_is_found_between_mountings():
    table = draw_mountings(np.random.default_rng(1), 10, 0.5, 91, effect=3.0)
    found = rank_sum_p_values(
        table.values, table.labels, find_strata(table), find_mountings(table)
    )
    one, other = np.triu_indices(4, 1)
    assert (found.p[:, one, other] <= 0.05).mean() > 0.9
    assert found.p[:, one, other].min() == pytest.approx(found.least_p)


@pytest.mark.parametrize(('sessions', 'least'), [(1, 1.0), (2, 0.480), (3, 0.248), (6, 0.0412)])
def test_few_mountings_state_the_smallest_p_that_they_allow(sessions, least):
    table = draw_mountings(np.random.default_rng(2), sessions, 0.0, 91, effect=1e3)
    found = rank_sum_p_values(
        table.values, table.labels, find_strata(table), find_mountings(table)
    )
    assert found.least_p == pytest.approx(least, abs=5e-4)
    assert found.mean_p == pytest.approx(found.least_p)


def test_a_mounting_of_each_trial_and_no_stated_mountings_test_trials():
    rng = np.random.default_rng(3)
    labels = np.repeat([*'ab'], 20)
    values = rng.normal(size=(40, 3))
    table = make_table(labels, values, mounting=np.arange(40).astype(str))
    found = rank_sum_p_values(values, labels, None, find_mountings(table))
    assert np.array_equal(found.p, rank_sum_p_values(values, labels).p)
    assert find_mountings(make_table(labels, values)) is None


def test_a_mounting_has_one_label_and_one_session():
    values = np.random.default_rng(4).normal(size=(8, 2))
    labels, units = [*'aabbaabb'], [0, 0, 0, 1, 2, 2, 3, 3]
    with pytest.raises(DatasetError, match='several classes or strata'):
        rank_sum_p_values(values, labels, None, units)
    with pytest.raises(DatasetError, match='several classes or strata'):
        rank_sum_p_values(values, labels, [0, 1] * 4, [0, 0, 1, 1, 2, 2, 3, 3])


@pytest.mark.parametrize('step', [0.0, 1.0])
def test_auc_is_the_share_of_pairs_of_trials(step):
    rng = np.random.default_rng(5)
    table = draw_mountings(rng, 3, 1.0, 91, trials=4, effect=0.5)
    values = np.round(table.values / step) * step if step else table.values
    strata = find_strata(table)
    found = rank_sum_p_values(values, table.labels, strata, find_mountings(table))
    for i, a in enumerate('abcd'):
        for j, b in enumerate('abcd'):
            if i == j:
                assert (found.auc[:, i, j] == 0.5).all()
                continue
            pairs = [
                np.sign(values[m] - values[n])
                for m in np.flatnonzero(table.labels == a)
                for n in np.flatnonzero((table.labels == b) & (strata == strata[m]))
            ]
            np.testing.assert_allclose(found.auc[:, i, j], 0.5 + np.mean(pairs, axis=0) / 2)
    one, other = np.triu_indices(4, 1)
    larger = np.maximum(found.auc, 1.0 - found.auc)[:, one, other]
    np.testing.assert_allclose(found.separation, larger.mean(axis=1))


def test_holm_is_that_of_the_textbook():
    # The smallest p-value is multiplied by 4, the next by 3, and so on; none is below its
    # predecessor (Holm 1979).
    found = correct_holm([0.04, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(found, [0.06, 0.04, 0.06, 0.06])
    np.testing.assert_allclose(correct_holm([0.9, 0.6]), 1.0)
    assert correct_holm([]).size == 0
