# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rank sums against SciPy and exact fractions, and the selection of features by them."""

from fractions import Fraction
import itertools
import json
import math

from classifier_tables import make_table
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from scipy.stats import mannwhitneyu, norm

from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.errors import DatasetError
from tactile_classifier.evaluation.cross_validation import predict_folds
from tactile_classifier.evaluation.feature_selection import choose_counts, SelectionPlan
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.evaluation.significance import rank_features, rank_sum_p_values


def peer_p_values(values, labels):
    """One test by SciPy for each pair and feature; 1 where all values of both are equal."""
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
    assert expected.min() < 1e-6  # else tiny p-values were not looked at


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
    i, j = np.triu_indices(len(found.labels), 1)  # the diagonal is no test
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
    values[:, 0] = 0.0  # the component at 0 Hz tells nothing
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
        (np.ones((4, 2)), ['a'] * 4, 'there are 1'),
        (np.full((2, 1), np.nan), ['a', 'b'], 'not finite'),
    ],
)
def test_refuses_what_cannot_be_tested(values, labels, message):
    with pytest.raises(DatasetError, match=message):
        rank_sum_p_values(values, labels)


def compute_van_elteren(values, labels, strata):
    """Return statistic and variance of two classes in exact fractions."""
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
    smallest = Fraction(1, 10)  # weight of the largest stratum that has both
    z = (abs(surplus) - smallest / 2) / Fraction(math.sqrt(variance))
    assert found.strata == 4
    assert found.p[0, 0, 1] == pytest.approx(2 * norm.sf(float(z)), rel=1e-12)


def test_stratified_p_is_right_in_size_where_sessions_shift_all_trials():
    rng = np.random.default_rng(10)
    labels = np.tile(np.repeat(['a', 'b'], 10), 6)
    # One of two classes is tried more often in some sessions: the session is no difference.
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


# -- selection of features by their p -----------------------------------------------


def test_selection_finds_the_two_features_that_tell_among_noise():
    generator = np.random.default_rng(2)
    code = np.repeat([0, 1, 2], 24)
    values = generator.normal(0.0, 1.0, (72, 50))
    values[:, [7, 31]] += 2.0 * code[:, None]
    table = make_table(np.array(['a', 'b', 'c'])[code], values)
    split = stratified_split(table, 4, 1)
    (results,) = run_plans([SelectionPlan(table, split, ['knn'], ['standard', 'none'])])
    for result in results:
        assert result.selected_mean > result.all_mean + 0.05
        assert (result.verdict, result.split) == ('helps', 'stratified 4-fold, once')
        assert max(result.chosen_counts) <= 10
    json.dumps([result.to_dict() for result in results], allow_nan=False)


def test_selection_on_nothing_but_noise_invents_no_accuracy():
    """Ranked on all trials, some features look telling; inside the folds it is chance."""
    generator = np.random.default_rng(11)
    values, day = generator.normal(0.0, 1.0, (160, 300)), np.arange(160) % 4
    table = make_table(np.repeat(['a', 'b'], 80), values, day=day)
    seen = rank_features(table.values, table.labels)[:20]
    folds = stratified_split(table).repeats[0]
    answers = predict_folds('svm_linear', 'none', table.values[:, seen], table.labels, folds)
    tested = [table.labels[test] for _, test in folds]
    assert np.mean(np.concatenate(answers) == np.concatenate(tested)) > 0.65
    for split in (stratified_split(table, 5, 1), grouped_split(table, ['day'])):
        ((result,),) = run_plans([SelectionPlan(table, split, ['svm_linear'], ['none'])])
        assert result.selected_mean == pytest.approx(0.5, abs=0.12)
        assert result.verdict != 'helps'


def test_counts_end_with_all_features():
    assert choose_counts(3) == (1, 2, 3)
    assert choose_counts(91) == (5, 10, 20, 40, 91)
    assert choose_counts(1) == (1,)
