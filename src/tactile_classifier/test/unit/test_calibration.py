# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from itertools import combinations

from classifier_tables import make_repeats, make_table
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from scipy.stats import ttest_1samp

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.fit_calibration import (
    compute_calibration_error,
    fit_calibration,
    make_group_folds,
    measure_surplus,
)
from tactile_classifier.errors import DatasetError


def draw(probabilities, seed):
    """Return labels drawn with the stated probabilities."""
    rng = np.random.default_rng(seed)
    return (rng.random((len(probabilities), 1)) > probabilities.cumsum(axis=1)).sum(axis=1)


def test_fit_finds_the_map_that_the_labels_were_drawn_with():
    scores = np.random.default_rng(1).normal(size=(10_000, 4))
    true_map = Calibration(1.7, 0.6)
    found = fit_calibration(scores, draw(true_map.compute(scores), 2))
    assert found.slope == pytest.approx(1.7, rel=0.1)
    assert found.offset == pytest.approx(0.6, abs=0.1)
    fresh = np.random.default_rng(3).normal(size=(10_000, 4))
    true = draw(true_map.compute(fresh), 4)
    assert compute_calibration_error(found.compute(fresh), true) < 0.02
    assert compute_calibration_error(Calibration(8.0, 0.0).compute(fresh), true) > 0.1


@pytest.mark.parametrize('labels', [2, 5])
def test_the_unit_of_the_scores_does_not_count(labels):
    rng = np.random.default_rng(0)
    true = rng.integers(labels, size=200)
    scores = rng.normal(size=(200, labels))
    scores[np.arange(200), true] += 1.5
    probabilities = fit_calibration(scores, true).compute(scores)
    assert compute_calibration_error(probabilities, true) < 0.1
    for unit in (1e-6, 1e-2, 1e4, 1e9):
        found = fit_calibration(unit * scores, true).compute(unit * scores)
        np.testing.assert_allclose(found, probabilities, atol=1e-4)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(0, 2))
def test_no_other_map_makes_the_labels_likelier(seed, slope, offset):
    rng = np.random.default_rng(seed)
    true = rng.integers(3, size=60)
    scores = rng.normal(size=(60, 3)) + 1.5 * np.eye(3)[true]

    def loss(calibration):
        target = np.full(scores.shape, 1 / 62 / 2)
        target[np.arange(60), true] = 1 - 1 / 62
        return -(target * np.log(calibration.compute(scores))).sum()

    found = fit_calibration(scores, true)
    assert loss(found) <= loss(Calibration(found.slope * np.exp(slope), offset)) + 1e-6


@pytest.mark.parametrize('scores', [np.zeros((6, 2)), np.full((6, 2), 1e300)])
def test_equal_scores_have_equal_probabilities(scores):
    found = fit_calibration(scores, np.arange(6) % 2).compute(scores)
    np.testing.assert_allclose(found, 0.5, atol=0.02)


def test_surplus_is_over_sessions():
    # The stated probability is 0.9. Of ten trials per session, 9, 8 and 7 are correct.
    probabilities = np.tile([0.9, 0.1], (30, 1))
    true = np.concatenate([np.arange(10) >= right for right in (9, 8, 7)]).astype(int)
    session = np.repeat(np.arange(3), 10)
    found = measure_surplus(probabilities, true, session)
    interval = ttest_1samp([0.0, 0.1, 0.2], 0.0).confidence_interval()
    assert found.mean == pytest.approx(0.1)
    assert found.half_width == pytest.approx((interval.high - interval.low) / 2)
    assert measure_surplus(probabilities, true, None) is None
    assert measure_surplus(probabilities, true, np.zeros(30, dtype=int)) is None


@settings(max_examples=60, deadline=None)
@given(
    arrays(np.float64, (3, 5), elements=st.floats(-50, 50)),
    st.floats(1e-3, 1e3),
    st.floats(0, 20),
)
def test_order_is_kept_and_probabilities_add_up_to_one(scores, slope, offset):
    probabilities = Calibration(slope, offset).compute(scores)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1.0, atol=1e-12)
    answer = scores.argmax(axis=1)
    rows = np.arange(len(scores))
    assert (probabilities[rows, answer] >= probabilities.max(axis=1) * (1 - 1e-15)).all()


def test_calibration_error_of_known_numbers():
    # In the bin of 0.9, 3 of 4 predictions are correct; in the bin of 0.6, 2 of 2.
    stated = np.array([0.9] * 4 + [0.6] * 2)
    probabilities = np.stack([stated, 1 - stated], axis=1)
    true = np.array([0, 0, 0, 1, 0, 0])
    error = compute_calibration_error(probabilities, true)
    assert error == pytest.approx((4 * 0.15 + 2 * 0.4) / 6)


def check_whole(folds, groups):
    """Check that each group is in one fold."""
    assert len(set(zip(folds.fold, groups, strict=True))) == len(set(groups))


OWN = [f'{label}_{day}' for label in 'abcdef' for day in ('mon', 'tue') for _ in range(4)]
PAIRS = list(combinations(range(7), 2))


@pytest.mark.parametrize(
    ('labels', 'sessions', 'split', 'groups'),
    [
        (['a', 'b'] * 10, np.repeat(np.arange(5), 4), 'one session held out', 5),
        (['a', 'b'] * 20, np.repeat(np.arange(10), 4), 'session held out in 6 folds', 10),
        # Each of six objects has one session on each of two days. The order of names is arbitrary.
        ([name[0] for name in OWN], OWN, 'session held out in 6 folds', 12),
        ([name[0] for name in OWN], [name[::-1] for name in OWN], 'session held out in 6 fo', 12),
        # Each pair of seven sessions has a separate label, so no two may share a fold.
        ([str(p) for p in PAIRS for _ in p], np.ravel(PAIRS), 'one session held out', 7),
    ],
)
def test_sessions_are_held_out_whole(labels, sessions, split, groups):
    labels = np.array(labels)
    folds = make_group_folds(make_table(labels, session_id=sessions))
    assert folds.split.startswith(split)
    assert folds.groups == groups
    check_whole(folds, sessions)
    if groups == 12:  # each label is in two folds, and each fold has two labels
        assert all(len(set(folds.fold[labels == label])) == 2 for label in 'abcdef')
        assert all(len(set(labels[folds.fold == i])) == 2 for i in range(6))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.sets(st.integers(0, 13), min_size=2, max_size=4), min_size=2, max_size=25))
def test_no_label_is_held_out_whole(sessions_of_label):
    pairs = [(str(i), s) for i, sessions in enumerate(sessions_of_label) for s in sessions]
    labels, sessions = (np.array(column) for column in zip(*pairs, strict=True))
    folds = make_group_folds(make_table(labels, session_id=sessions))
    assert folds.groups == len(set(sessions))
    check_whole(folds, sessions)
    assert all(len(set(folds.fold[labels == label])) > 1 for label in set(labels))


def test_sessions_of_the_same_labels_are_folds_in_turn():
    sessions = np.repeat(np.arange(14), 6)
    folds = make_group_folds(make_table(['a', 'b', 'c'] * 28, session_id=sessions))
    np.testing.assert_array_equal(folds.fold, sessions % 6)


def test_trials_or_conditions_are_folds_where_sessions_do_not_allow_it():
    trials = make_group_folds(make_table(['a', 'b'] * 10))
    assert (trials.split, trials.groups) == ('stratified 6-fold over trials', 0)
    # Each label has only one session, so holding out a session would remove a label.
    apart = make_table(['a'] * 5 + ['b'] * 5, session_id=['s1'] * 5 + ['s2'] * 5)
    assert make_group_folds(apart).split == 'stratified 5-fold over trials'
    table = make_repeats(8, 0)
    folds = make_group_folds(table)
    assert (folds.split, folds.groups) == ('speed held out in 6 folds', 0)
    check_whole(folds, table.column('speed'))
    # A label with only one condition would be held out completely.
    once = table.take((table.labels == 'a') | (table.column('speed') == 0))
    assert make_group_folds(once).split == 'stratified 3-fold over trials'
    with pytest.raises(DatasetError, match='label "b" has only one trial'):
        make_group_folds(make_table(['a', 'a', 'b']))
