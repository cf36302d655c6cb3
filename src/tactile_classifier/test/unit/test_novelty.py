# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from tactile_classifier.confidence.novelty import (
    choose_metric,
    compute_auroc,
    compute_session_threshold,
    compute_threshold,
    METRICS,
    NoveltyMeasure,
    rank_of_sessions,
    trials_needed,
)


def clouds(seed, each=40, width=4, apart=30.0):
    rng = np.random.default_rng(seed)
    centres = apart * np.eye(3, width)
    values = np.concatenate([centre + rng.normal(size=(each, width)) for centre in centres])
    return values, np.repeat(['a', 'b', 'c'], each), np.tile(np.arange(each) % 4, 3)


def test_known_trials_are_about_one_and_others_far_above():
    measure = NoveltyMeasure.fit(*clouds(1))
    known = measure.compute(clouds(2)[0])
    assert np.median(known) == pytest.approx(1.0, abs=0.3)
    between = np.full((1, 4), 10.0)  # as far from all three
    assert measure.compute(between)[0] > 5 * known.max()


def test_units_and_offsets_of_features_do_not_count():
    values, labels, fold = clouds(1)
    other = clouds(2)[0]
    scale, offset = np.array([1e-6, 1.0, 1e3, 1e9]), np.array([1e6, -5.0, 0.0, 1e9])
    one = NoveltyMeasure.fit(values, labels, fold).compute(other)
    two = NoveltyMeasure.fit(values * scale, labels, fold).compute(other * scale)
    np.testing.assert_allclose(one, two, rtol=1e-6)
    two = NoveltyMeasure.fit(values + offset, labels, fold).compute(other + offset)
    np.testing.assert_allclose(one, two, rtol=1e-5)  # 1e9 leaves seven digits of the last


def test_what_varies_much_within_a_label_counts_little():
    values, labels, fold = clouds(1)
    values[:, 3] *= 100.0
    measure = NoveltyMeasure.fit(values, labels, fold)
    step = np.array([[0.0, 0.0, 20.0, 0.0], [0.0, 0.0, 0.0, 20.0]])
    odd, ordinary = measure.compute(values[:1] + step)
    assert odd > 5 * ordinary


def test_a_quiet_label_is_left_by_a_small_step():
    values, labels, fold = clouds(1)
    values[labels == 'a'] = 0.1 * values[labels == 'a']
    measure = NoveltyMeasure.fit(values, labels, fold)
    step = np.array([0.0, 0.0, 0.0, 3.0])
    quiet, loud = (measure.compute(values[labels == x] + step).mean() for x in 'ab')
    assert quiet > 3 * loud


def test_feature_without_spread_does_not_count():
    values, labels, fold = clouds(1)
    values[:, 1] = 7.25
    measure = NoveltyMeasure.fit(values, labels, fold)
    moved = values + np.array([0.0, 5.0, 0.0, 0.0])
    np.testing.assert_array_equal(measure.compute(moved), measure.compute(values))


def test_trials_that_are_all_the_same_give_no_nan():
    values = np.repeat([[1.0, 2.0], [3.0, 4.0]], 3, axis=0)
    labels = np.repeat(['a', 'b'], 3)
    measure = NoveltyMeasure.fit(values, labels, np.arange(6))
    assert np.isfinite(measure.compute(np.array([[5.0, 6.0]]))).all()


def test_one_part_alone_still_has_a_usual_distance():
    values, labels, _ = clouds(1)
    measure = NoveltyMeasure.fit(values, labels, np.zeros(len(labels), dtype=int))
    assert np.median(measure.compute(clouds(2)[0])) == pytest.approx(1.0, abs=0.3)


def test_metric_is_chosen_by_what_tells_left_out_labels():
    values, labels, fold = clouds(1, apart=8.0)
    noisy = np.array([1.0, 1.0, 1.0, 1e4])  # one feature drowns the others unless scaled
    assert choose_metric(values * noisy, labels, fold) != 'plain'
    # Features of pure noise, tiny beside the others, count when scaled and not when plain.
    rng = np.random.default_rng(4)
    dust = 1e-3 * rng.normal(size=(len(values), 400))
    assert choose_metric(np.hstack([values, dust]), labels, fold) == 'plain'


@pytest.mark.parametrize('metric', METRICS)
def test_left_out_label_is_as_if_it_had_no_references(metric):
    values, labels, fold = clouds(1)
    measure = NoveltyMeasure.fit(values, labels, fold, metric)
    without = measure.compute_without(values, labels, 'a')
    np.testing.assert_array_equal(without[labels != 'a'], measure.compute(values)[labels != 'a'])
    assert without[labels == 'a'].min() > 5.0


@pytest.mark.parametrize(('rate', 'needed'), [(0.5, 1), (0.1, 9), (0.01, 99)])
def test_threshold_of_the_fewest_trials_is_their_largest(rate, needed):
    novelty = np.random.default_rng(0).permutation(needed) + 1.0
    assert trials_needed(rate) == needed
    assert compute_threshold(novelty, rate) == needed
    with pytest.raises(ValueError, match=f'{needed} are needed'):
        compute_threshold(novelty[:-1], rate)


def test_threshold_holds_its_rate_on_further_trials():
    # Exactly: of n + 1 exchangeable trials, the last lies above with probability
    # at most the rate, and at least the rate minus 1 / (n + 1).
    rng = np.random.default_rng(3)
    novelty = rng.exponential(size=(4000, 51))
    above = [row[-1] > compute_threshold(row[:-1], 0.1) for row in novelty]
    assert 0.1 - 1 / 51 - 0.015 < np.mean(above) < 0.1 + 0.015


@pytest.mark.parametrize(
    ('sessions', 'rank'), [(1, 1), (2, 2), (6, 6), (9, 9), (19, 18), (40, 37)]
)
def test_most_sessions_are_bounded_by_one_of_the_largest(sessions, rank):
    assert rank_of_sessions(sessions) == rank


def test_session_threshold_is_the_worst_session_s_quantile():
    session = np.repeat(np.arange(6), 40)
    novelty = np.tile(np.arange(40.0), 6) + 100.0 * (session == 3)
    # The 39th smallest of 40 bounds a 41st at 5 %.
    assert compute_session_threshold(novelty, session, 0.05) == 138.0
    with pytest.raises(ValueError, match='99 are needed'):
        compute_session_threshold(novelty[:90], session[:90], 0.01)


@pytest.mark.parametrize('sessions', [6, 19])
def test_session_threshold_holds_in_as_many_new_sessions_as_stated(sessions):
    rng = np.random.default_rng(12)
    session = np.repeat(np.arange(sessions), 60)

    def draw(count):
        return np.exp(rng.normal(size=(count, 1)) + 0.5 * rng.normal(size=(count, 60)))

    held, pooled = [], []
    for _ in range(300):
        novelty = draw(sessions).ravel()
        new = draw(20)
        for found, threshold in (
            (held, compute_session_threshold(novelty, session, 0.1)),
            (pooled, compute_threshold(novelty, 0.1)),
        ):
            found.append(np.mean((new > threshold).mean(axis=1) <= 0.1))
    stated = rank_of_sessions(sessions) / (sessions + 1)
    assert np.mean(held) == pytest.approx(stated, abs=0.03)
    # One threshold for the trials of all sessions fails in far more of them.
    assert np.mean(pooled) < stated - 0.05


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.integers(-3, 3)), min_size=2, max_size=30))
def test_area_under_the_curve_is_that_of_scikit_learn(trials):
    is_new, novelty = np.array([True, False] + [t[0] for t in trials]), [0, 1]
    novelty = np.array(novelty + [t[1] for t in trials]) / 3.0
    expected = roc_auc_score(is_new, novelty)
    assert compute_auroc(is_new, novelty) == pytest.approx(expected, abs=1e-12)
