# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis
from sklearn.covariance import LedoitWolf
from sklearn.metrics import roc_auc_score

from tactile_classifier.confidence.fit_novelty import (
    choose_metric,
    compute_auroc,
    fit_measure,
    Spaces,
)
from tactile_classifier.confidence.novelty import METRICS


def clouds(seed, each=40, width=4, apart=30.0):
    rng = np.random.default_rng(seed)
    centres = apart * np.eye(3, width)
    values = np.concatenate([centre + rng.normal(size=(each, width)) for centre in centres])
    return values, np.repeat(['a', 'b', 'c'], each), np.tile(np.arange(each) % 4, 3)


@pytest.mark.parametrize('metric', ['scaled', 'whitened', 'relative'])
def test_units_and_offsets_of_features_do_not_count(metric):
    values, labels, fold = clouds(1)
    other = clouds(2)[0]
    scale, offset = np.array([1e-6, 1.0, 1e3, 1e9]), np.array([1e6, -5.0, 0.0, 1e9])
    one = fit_measure(values, labels, fold, metric).compute(other)
    two = fit_measure(values * scale, labels, fold, metric).compute(other * scale)
    np.testing.assert_allclose(one, two, rtol=1e-6)
    two = fit_measure(values + offset, labels, fold, metric).compute(other + offset)
    np.testing.assert_allclose(one, two, rtol=1e-5)  # 1e9 leaves seven digits of the last


def test_feature_without_spread_does_not_count():
    values, labels, fold = clouds(1)
    values[:, 1] = 7.25
    measure = fit_measure(values, labels, fold)
    moved = values + np.array([0.0, 5.0, 0.0, 0.0])
    np.testing.assert_array_equal(measure.compute(moved), measure.compute(values))


def test_equal_trials_and_a_window_in_the_middle_of_all_have_a_finite_novelty():
    values = np.repeat([[1.0, 2.0], [3.0, 4.0]], 3, axis=0)
    measure = fit_measure(values, np.repeat(['a', 'b'], 3), np.arange(6))
    assert np.isfinite(measure.compute(np.array([[5.0, 6.0]]))).all()
    measure = fit_measure(*clouds(1))
    assert np.isfinite(measure.compute(measure.centre[np.newaxis])).all()


def test_metric_is_chosen_by_what_tells_left_out_labels():
    values, labels, fold = clouds(1, apart=8.0)
    noisy = np.array([1.0, 1.0, 1.0, 1e4])  # one feature drowns the others unless scaled
    assert choose_metric(values * noisy, labels, fold) != 'plain'
    # Features of pure noise, tiny beside the others, count when scaled and not when plain.
    rng = np.random.default_rng(4)
    dust = 1e-3 * rng.normal(size=(len(values), 400))
    assert choose_metric(np.hstack([values, dust]), labels, fold) == 'plain'


@pytest.mark.parametrize('folds', [4, 1])
@pytest.mark.parametrize('metric', METRICS)
def test_novelty_is_its_formula(metric, folds):
    values, labels, fold = clouds(1, apart=4.0)
    fold %= folds  # one alone: the nearest other trial counts
    windows = clouds(2, apart=4.0)[0]
    means = np.stack([values[labels == x].mean(axis=0) for x in 'abc'])
    owner = np.searchsorted(['a', 'b', 'c'], labels)
    residuals = (values - means[owner]) * np.sqrt(40 / 39)  # 40 trials a label, without bias
    spread = residuals.std(axis=0)

    def inverse(deviations):
        covariance = LedoitWolf(assume_centered=True).fit(deviations / spread).covariance_
        return np.linalg.inv(covariance * np.outer(spread, spread))

    within, total = inverse(residuals), inverse(values - values.mean(axis=0))
    metrics = {'plain': np.eye(4), 'scaled': np.diag(spread**-2.0)}
    by = metrics.get(metric, within)

    def far(row, others, by=by):
        return np.array([mahalanobis(row, other, by) for other in others])

    def is_other(i):
        return fold != fold[i] if folds > 1 else np.arange(len(fold)) != i

    usual = []
    for x in 'abc':
        nearest = [
            far(values[i], values[(labels == x) & is_other(i)]).min()
            for i in np.flatnonzero(labels == x)
        ]
        usual.append(np.median(nearest))
    expected = []
    for row in windows:
        distance = far(row, values)
        nearest = distance.argmin()
        to_label, to_all = far(row, means, within).min(), far(row, [values.mean(axis=0)], total)[0]
        excess = (to_label**2 - to_all**2) / 8
        expected.append(
            excess + np.hypot(1.0, excess)
            if metric == 'relative'
            else distance[nearest] / usual[owner[nearest]] * to_label / to_all
        )
    found = fit_measure(values, labels, fold, metric).compute(windows)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_relative_distance_is_chosen_where_labels_are_far_from_round():
    # What differs within a label is large, the same for all, and not what tells labels apart.
    rng = np.random.default_rng(1)
    labels, fold = np.repeat([f'{i:02d}' for i in range(12)], 12), np.tile(np.arange(4), 36)
    fade = np.exp(-np.arange(40) / 15)
    centres = np.repeat(rng.normal(size=(12, 40)) * fade, 12, axis=0)
    common = rng.normal(size=(144, 4)) @ (2.0 * rng.normal(size=(4, 40)))
    values = centres + common + 0.5 * rng.normal(size=(144, 40))
    assert choose_metric(values, labels, fold) == 'relative'


def test_another_metric_needs_more_than_chance():
    # Three metrics on noise: each is the best on some labels, none clearly.
    rng = np.random.default_rng(3)
    labels, fold = np.repeat(list('abcdef'), 20), np.tile(np.arange(4), 30)
    chosen = [choose_metric(rng.normal(size=(120, 5)), labels, fold) for _ in range(10)]
    assert chosen.count('plain') >= 6


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.integers(-3, 3)), min_size=2, max_size=30))
def test_area_under_the_curve_is_that_of_scikit_learn(trials):
    is_new, novelty = np.array([True, False] + [t[0] for t in trials]), [0, 1]
    novelty = np.array(novelty + [t[1] for t in trials]) / 3.0
    expected = roc_auc_score(is_new, novelty)
    assert compute_auroc(is_new, novelty) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize('metric', METRICS)
def test_left_out_label_is_as_if_it_had_no_references(metric):
    values, labels, fold = clouds(1)
    spaces = Spaces.fit(values, labels, fold)
    known = labels != 'a'
    measure = fit_measure(values, labels, fold, metric, spaces)
    without = fit_measure(values[known], labels[known], fold[known], metric, spaces)
    novelty = without.compute(values)
    np.testing.assert_array_equal(novelty[known], measure.compute(values)[known])
    assert novelty[~known].min() > 5.0 * np.median(novelty[known])
