# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
from itertools import combinations

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from tactile_classifier.confidence.calibration import (
    calibrate_stage,
    Calibration,
    compute_calibration_error,
    hold_out_novelty,
    hold_out_scores,
    leave_labels_out,
    make_group_folds,
)
from tactile_classifier.confidence.novelty import compute_session_threshold, NoveltyMeasure
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def draw(probabilities, seed):
    """Return labels drawn with the stated probabilities."""
    rng = np.random.default_rng(seed)
    return (rng.random((len(probabilities), 1)) > probabilities.cumsum(axis=1)).sum(axis=1)


def test_fit_finds_the_map_that_the_labels_were_drawn_with():
    scores = np.random.default_rng(1).normal(size=(10_000, 4))
    true_map = Calibration(1.7, 0.6)
    found = Calibration.fit(scores, draw(true_map.compute(scores), 2))
    assert found.slope == pytest.approx(1.7, rel=0.1)
    assert found.offset == pytest.approx(0.6, abs=0.1)
    fresh = np.random.default_rng(3).normal(size=(10_000, 4))
    true = draw(true_map.compute(fresh), 4)
    assert compute_calibration_error(found.compute(fresh), true) < 0.02
    assert compute_calibration_error(Calibration(8.0, 0.0).compute(fresh), true) > 0.1


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
    # Two bins: 0.9 stated and 3 of 4 right, 0.6 stated and 2 of 2 right.
    stated = np.array([0.9] * 4 + [0.6] * 2)
    probabilities = np.stack([stated, 1 - stated], axis=1)
    true = np.array([0, 0, 0, 1, 0, 0])
    error = compute_calibration_error(probabilities, true)
    assert error == pytest.approx((4 * 0.15 + 2 * 0.4) / 6)


def small(labels, sessions=None):
    columns = {} if sessions is None else {'session_id': np.array(sessions)}
    values = np.random.default_rng(0).normal(size=(len(labels), 3))
    return FeatureTable(values, np.array(labels), spec_for('stiffness', FeatureConfig()), columns)


def test_sessions_are_held_out_whole():
    table = small(['a', 'b'] * 10, np.repeat(['s1', 's2', 's3', 's4', 's5'], 4))
    folds = make_group_folds(table)
    assert (folds.split, folds.groups) == ('one session held out', 5)
    assert len(set(zip(folds.fold, table.column('session_id'), strict=True))) == 5
    many = small(['a', 'b'] * 20, np.repeat([f's{i}' for i in range(10)], 4))
    assert make_group_folds(many).split == 'session held out in 6 folds'
    assert len(set(zip(make_group_folds(many).fold, many.column('session_id'), strict=True))) == 10


def test_trials_are_folds_where_sessions_do_not_allow_it():
    assert make_group_folds(small(['a', 'b'] * 10)).split == 'stratified 6-fold over trials'
    # Each label in one session only: with that held out, no model could know it.
    apart = small(['a'] * 5 + ['b'] * 5, ['s1'] * 5 + ['s2'] * 5)
    folds = make_group_folds(apart)
    assert (folds.split, folds.groups) == ('stratified 5-fold over trials', 0)
    with pytest.raises(DatasetError, match='label "b" has one trial only'):
        make_group_folds(small(['a', 'a', 'b']))


def repeats(conditions, seed):
    """Return six trials of two labels under each condition: near copies far from the others."""
    rng = np.random.default_rng(seed)
    labels = np.tile(np.repeat(['a', 'b'], 3), conditions)
    values = np.repeat(rng.normal(size=(2 * conditions, 3)), 3, axis=0)
    values[labels == 'b', 0] += 1.5
    values += 1e-3 * rng.normal(size=values.shape)
    columns = {'speed': np.repeat(np.arange(conditions), 6)}
    return FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), columns)


def test_repeats_of_a_condition_are_held_out_together():
    folds = make_group_folds(repeats(8, 0))
    assert (folds.split, folds.groups) == ('speed held out in 6 folds', 0)
    assert len(set(zip(folds.fold, repeats(8, 0).column('speed'), strict=True))) == 8
    # A label with one condition alone would be held out whole.
    table = repeats(8, 0)
    once = table.take((table.labels == 'a') | (table.column('speed') == 0))
    assert make_group_folds(once).split == 'stratified 3-fold over trials'


def test_stated_calibration_error_is_that_of_new_conditions():
    table, new = repeats(60, 0), repeats(600, 1)
    estimator = build_estimator('knn', 'none').fit(table.values, table.labels)
    scores = compute_raw_scores(estimator, new.values)
    answers = np.unique(new.labels, return_inverse=True)[1]

    def state(known):
        part = calibrate_stage(known, 'knn', 'none', make_group_folds(known), 0.1)
        return part.error_after, compute_calibration_error(
            part.calibration.compute(scores), answers
        )

    stated, true = state(table)
    assert stated == pytest.approx(true, abs=0.03)
    # Folds of single trials judge by near copies of the trials that are held out.
    stated, true = state(dataclasses.replace(table, columns={}))
    assert stated < true / 2
    assert true > 0.1


@pytest.mark.parametrize('name', ['{day}_{label}', '{label}_{day}'])
def test_sessions_of_one_label_are_spread_over_the_parts(name):
    # Six objects on two days, a session each: wherever the names put them, the model that
    # is tested on one day of an object has seen the other day.
    trials = [(label, day) for label in 'abcdef' for day in ('mon', 'tue') for _ in range(4)]
    sessions = [name.format(label=label, day=day) for label, day in trials]
    labels = np.array([label for label, _ in trials])
    folds = make_group_folds(small(labels, sessions))
    assert (folds.split, folds.groups) == ('session held out in 6 folds', 12)
    assert len(set(zip(folds.fold, sessions, strict=True))) == 12
    for label in 'abcdef':
        assert len(set(folds.fold[labels == label])) == 2
    assert all(len(set(labels[folds.fold == i])) == 2 for i in range(6))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.sets(st.integers(0, 13), min_size=2, max_size=4), min_size=2, max_size=25))
def test_no_label_is_held_out_whole(sessions_of_label):
    pairs = [(str(i), s) for i, sessions in enumerate(sessions_of_label) for s in sessions]
    labels, sessions = (np.array(column) for column in zip(*pairs, strict=True))
    folds = make_group_folds(small(labels, sessions))
    assert folds.groups == len(set(sessions))
    assert len(set(zip(folds.fold, sessions, strict=True))) == folds.groups
    for label in set(labels):
        assert len(set(folds.fold[labels == label])) > 1


def test_labels_too_interwoven_for_six_parts():
    # Each pair of seven sessions has a label of its own: no two may share a part.
    pairs = list(combinations(range(7), 2))
    labels = [f'{i}{j}' for i, j in pairs for _ in (i, j)]
    sessions = [session for pair in pairs for session in pair]
    folds = make_group_folds(small(labels, sessions))
    assert (folds.split, folds.groups) == ('one session held out', 7)
    np.testing.assert_array_equal(folds.fold, sessions)


def test_sessions_of_the_same_labels_are_folds_in_turn():
    sessions = np.repeat(np.arange(14), 6)
    folds = make_group_folds(small(['a', 'b', 'c'] * 28, sessions))
    np.testing.assert_array_equal(folds.fold, sessions % 6)


def test_no_trial_is_judged_by_a_model_that_knew_it():
    # Labels drawn at random: whoever is judged by its own neighbours looks right.
    rng = np.random.default_rng(5)
    table = small(rng.choice(['a', 'b'], 200))
    fold = make_group_folds(table).fold
    scores, true = hold_out_scores(table, 'tree', 'none', fold)
    assert np.mean(scores.argmax(axis=1) == true) < 0.65
    assert hold_out_novelty(table, fold, 'whitened').min() > 0.0


def test_held_out_part_states_its_own_error(texture_table):
    part = calibrate_stage(texture_table, 'knn', 'none', make_group_folds(texture_table), 0.1)
    assert part.error_after < part.error_before + 0.02
    folds = make_group_folds(texture_table)
    shares = [np.mean(part.confidence[folds.session == i] < 0.0) for i in range(3)]
    # The threshold is the quantile of the worst session; the others reject less.
    assert max(shares) == pytest.approx(0.1, abs=0.01)
    assert folds.session_share == 0.75
    assert part.wrong.shape == part.confidence.shape == (480,)


def test_unlearned_labels_are_those_of_models_without_them(texture_table):
    table = texture_table.take(texture_table.labels < 'plate 4')
    folds = make_group_folds(table)
    found = leave_labels_out(table, folds, 'plain', 0.1)
    missed, areas = [], []
    for label in np.unique(table.labels):
        others = table.take(table.labels != label)
        known = hold_out_novelty(others, folds.fold[table.labels != label], 'plain')
        threshold = compute_session_threshold(known, folds.session[table.labels != label], 0.1)
        for i in np.unique(folds.fold):
            inside, outside = others.take(folds.fold[table.labels != label] != i), folds.fold == i
            part = folds.fold[(table.labels != label) & ~outside]
            measure = NoveltyMeasure.fit(inside.values, inside.labels, part, 'plain')
            novelty, is_new = (
                measure.compute(table.values[outside]),
                table.labels[outside] == label,
            )
            missed.append(np.mean(novelty[is_new] <= threshold))
            areas.append(roc_auc_score(is_new, novelty))
    assert found.labels == 4
    assert found.miss_rate == pytest.approx(np.mean(missed))
    assert found.auroc == pytest.approx(np.mean(areas))


def test_too_few_labels_or_trials_leave_nothing_out(texture_table):
    two = texture_table.take(texture_table.labels < 'plate 2')
    assert leave_labels_out(two, make_group_folds(two), 'plain', 0.1) is None
    few = texture_table.take(np.arange(480) % 20 == 0)
    assert leave_labels_out(few, make_group_folds(few), 'plain', 0.04) is None
