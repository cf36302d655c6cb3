# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis
from sklearn.covariance import LedoitWolf
from sklearn.metrics import roc_auc_score

from tactile_classifier.confidence.fit_novelty import fit_measure


def clouds(seed, each=40, width=4, apart=30.0):
    rng = np.random.default_rng(seed)
    centres = apart * np.eye(3, width)
    values = np.concatenate([centre + rng.normal(size=(each, width)) for centre in centres])
    return values, np.repeat(['a', 'b', 'c'], each), np.tile(np.arange(each) % 4, 3)


def test_one_unit_and_offsets_of_features_do_not_count():
    values, labels, fold = clouds(1)
    other = clouds(2)[0]
    offset = np.array([1e6, -5.0, 0.0, 1e9])
    one = fit_measure(values, labels, fold).compute(other)
    for unit in (1e-6, 1e9):
        two = fit_measure(unit * values, labels, fold).compute(unit * other)
        np.testing.assert_allclose(one, two, rtol=1e-6)
    two = fit_measure(values + offset, labels, fold).compute(other + offset)
    np.testing.assert_allclose(one, two, rtol=1e-5)  # the offset of 1e9 costs precision


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


@pytest.mark.parametrize('folds', [4, 1])
def test_novelty_is_its_formula(folds):
    values, labels, fold = clouds(1, apart=4.0)
    fold %= folds  # with one fold, the nearest other trial is used
    windows = clouds(2, apart=4.0)[0]
    means = np.stack([values[labels == x].mean(axis=0) for x in 'abc'])
    owner = np.searchsorted(['a', 'b', 'c'], labels)
    residuals = (values - means[owner]) * np.sqrt(40 / 39)  # unbiased for 40 trials per label
    spread = residuals.std(axis=0)

    def inverse(deviations):
        covariance = LedoitWolf(assume_centered=True).fit(deviations / spread).covariance_
        return np.linalg.inv(covariance * np.outer(spread, spread))

    within, total = inverse(residuals), inverse(values - values.mean(axis=0))

    def far(row, others, by):
        return np.array([mahalanobis(row, other, by) for other in others])

    def is_other(i):
        return fold != fold[i] if folds > 1 else np.arange(len(fold)) != i

    expected = np.ones(len(windows))
    for by in (np.eye(4), within):
        usual = []
        for x in 'abc':
            nearest = [
                far(values[i], values[(labels == x) & is_other(i)], by).min()
                for i in np.flatnonzero(labels == x)
            ]
            usual.append(np.median(nearest))
        for k, row in enumerate(windows):
            distance = far(row, values, by)
            expected[k] *= distance.min() / usual[owner[distance.argmin()]]
    to_label = [far(row, means, within).min() for row in windows]
    to_all = [far(row, [values.mean(axis=0)], total)[0] for row in windows]
    found = fit_measure(values, labels, fold).compute(windows)
    np.testing.assert_allclose(found, np.sqrt(expected) * to_label / to_all, rtol=1e-9)


def find_area(values, labels, fold, left_out):
    """Return the AUROC [%] of the novelty for a label that is left out of the training."""
    is_known = (labels != left_out) & (fold > 0)
    measure = fit_measure(values[is_known], labels[is_known], fold[is_known])
    tested = fold == 0
    return 100 * roc_auc_score(labels[tested] == left_out, measure.compute(values[tested]))


@pytest.mark.parametrize('case', ['one large feature', 'weak features', 'common change'])
def test_left_out_labels_are_found_among_unlike_features(case):
    # One feature may be much larger than the others, many weak features may be noise, and changes
    # common to all labels may be larger than the differences between labels.
    rng = np.random.default_rng(1)
    labels, fold = np.repeat([f'{i:02d}' for i in range(8)], 16), np.tile(np.arange(4), 32)
    centres = np.repeat(rng.normal(size=(8, 20)), 16, axis=0)
    values = 2.0 * centres + rng.normal(size=(128, 20))
    if case == 'one large feature':
        values[:, 0] = 100.0 * rng.normal(size=128)
    elif case == 'weak features':
        values = np.hstack([values, 1e-3 * rng.normal(size=(128, 80))])
    else:
        values = centres + rng.normal(size=(128, 3)) @ (2.0 * rng.normal(size=(3, 20)))
        values += 0.2 * rng.normal(size=values.shape)
    areas = [find_area(values, labels, fold, label) for label in np.unique(labels)]
    assert np.mean(areas) > 90


def test_trials_of_the_training_have_no_novelty():
    values, labels, fold = clouds(1)
    assert fit_measure(values, labels, fold).compute(values).max() < 1e-6


def test_labels_of_one_trial_each_are_measured_by_the_spread_of_all():
    values = np.random.default_rng(2).normal(size=(20, 3))
    measure = fit_measure(values, np.arange(20).astype(str), np.tile([0, 1], 10))
    assert (measure.compute(values + 1.0) > 0.0).all()
