# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of finding copies of trials, and of keeping copies in the same fold."""

import tracemalloc

from classifier_tables import make_table
import numpy as np
import pytest

from tactile_classifier.confidence.fit_calibration import make_group_folds
from tactile_classifier.datasets.copies import find_copies
from tactile_classifier.datasets.splits import grouped_split, stated_split, stratified_split
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.cross_validation import evaluate

NOISE_N = 0.004
"""Noise of a tension sensor [N]."""


def spectra(trials, samples=180, seed=0):
    """Return the spectra of trials of noise, shape (trials, 91)."""
    noise = np.random.default_rng(seed).normal(size=(trials, samples))
    return np.abs(np.fft.rfft(noise)) / samples


def name_labels(trials, labels=3):
    return np.array([f'label {i % labels}' for i in range(trials)])


def double(values, labels, jitter=0.0, **columns):
    """Return a table with each trial twice; ``jitter`` scales noise that is added to the copy."""
    noise = np.random.default_rng(9).normal(size=values.shape) * values.std()
    return make_table(
        np.tile(labels, 2), np.concatenate([values, values + jitter * noise]), **columns
    )


def test_each_trial_twice_leaves_noise_at_chance_and_is_named():
    values, labels = spectra(60), name_labels(60)
    once = evaluate(make_table(labels, values), ['knn'], ['none'], repetitions=3)
    twice = evaluate(double(values, labels), ['knn'], ['none'], repetitions=3)
    assert once.score('knn', 'none').mean < 0.5
    assert twice.score('knn', 'none').mean < 0.5  # 0.94 if copies were in different folds
    (warning,) = twice.warnings
    assert warning.startswith('60 of 120 trials are copies of other trials: 60 of 0, 61 of 1, ')
    assert twice.score('knn', 'none').interval.method.endswith('over 60 groups of repeats')
    assert not once.warnings


@pytest.mark.parametrize('jitter', [0.0, 1e-9, 1e-6, 1e-4, 5e-3])
def test_trials_with_a_little_noise_are_copies(jitter):
    table = double(spectra(60), name_labels(60), jitter)
    np.testing.assert_array_equal(table.copies, np.tile(np.arange(60), 2))


def test_other_digits_scales_and_units_change_nothing():
    values, labels = spectra(40), name_labels(40, 2)
    values[:, 5] *= 1e6  # as if one feature had another unit
    rounded = values.astype(np.float32).astype(float)
    found = find_copies(np.concatenate([values, rounded]) * 1e-3, np.tile(labels, 2))
    np.testing.assert_array_equal(found, np.tile(np.arange(40), 2))


def test_a_trial_with_two_labels_and_a_chain_of_copies_are_one_group():
    values, labels = spectra(30), name_labels(30)
    values[29] = values[0]
    labels[29] = 'label 1'
    values[12] = values[3] + 3e-3 * values.std()
    values[21] = values[12] + 3e-3 * values.std()
    found = find_copies(values, labels)
    assert (found[29], found[12], found[21]) == (0, 3, 3)
    assert np.count_nonzero(found != np.arange(30)) == 3


def make_holds(repetitions, mountings=6, seed=1):
    """Return holds of a smooth and of a rough plate; the level differs between mountings."""
    rng = np.random.default_rng(seed)
    rows, labels = [], []
    for plate, roughness_n in (('smooth', 0.0), ('rough', 0.4)):
        for level_n in rng.normal(3.0, 0.3, mountings):
            for _ in range(repetitions):
                wave = (
                    roughness_n * rng.normal() * np.sin(0.9 * np.arange(180) + rng.uniform(0, 6))
                )
                signal_n = level_n + wave + rng.normal(0.0, NOISE_N, 180)
                rows.append(np.round(signal_n / 1e-3) * 1e-3)  # resolution of the sensor
                labels.append(plate)
    return np.array(rows), np.array(labels)


@pytest.mark.parametrize('repetitions', [2, 20])
def test_repetitions_on_a_smooth_plate_are_no_copies(repetitions):
    signals, labels = make_holds(repetitions)
    time_s = np.arange(180) / 60.0
    slopes = np.polyfit(time_s, signals.T, 1).T
    residuals = (signals - slopes @ np.array([time_s, np.ones(180)])).std(axis=1)
    waveforms = signals.reshape(-1, 20, 9).mean(axis=2)
    regressions = np.column_stack([slopes, residuals])
    spectra_n = np.abs(np.fft.rfft(signals - signals.mean(axis=1, keepdims=True)))
    for values in (signals, waveforms, spectra_n, regressions):
        own = np.arange(len(labels))
        np.testing.assert_array_equal(find_copies(values, labels), own)
        found = find_copies(np.concatenate([values, values]), np.tile(labels, 2))
        np.testing.assert_array_equal(found, np.tile(own, 2))


def test_simulated_repetitions_are_no_copies(texture_table, small_table, stiffness_table):
    for table in (texture_table, small_table, stiffness_table):
        np.testing.assert_array_equal(table.copies, np.arange(len(table)))


def test_many_trials_take_little_memory():
    values, labels = spectra(2500), name_labels(2500, 2)
    values = np.concatenate([values, values + 1e-3 * values.std()])
    tracemalloc.start()
    found = find_copies(values, np.tile(labels, 2))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(found, np.tile(np.arange(2500), 2))
    assert peak < 100e6  # a matrix of all distances within a label has 50 MB
    assert len(np.unique(find_copies(np.ones((5000, 91)), np.full(5000, 'a')))) == 1


def hold_together(folds, copies):
    """Return True if no fold has copies of its test trials, and each trial is tested once."""
    tested = np.sort(np.concatenate([test for _, test in folds]))
    leaks = [np.isin(copies[train], copies[test]).any() for train, test in folds]
    return not any(leaks) and np.array_equal(tested, np.arange(len(copies)))


def test_random_folds_and_the_folds_inside_them_keep_copies_together():
    table = double(spectra(60), name_labels(60))
    split = stratified_split(table, 6, 3)
    for folds in split.repeats:
        assert hold_together(folds, table.copies)
        assert {len(test) for _, test in folds} <= {18, 20, 22}
    train, _ = split.repeats[0][0]
    for again, test in split.divide_again(train, table.labels, 0):
        assert not np.isin(table.copies[again], table.copies[test]).any()
    folds = make_group_folds(table, ())
    assert all(folds.fold[i] == folds.fold[i + 60] for i in range(60))


def test_without_copies_random_folds_are_those_of_scikit_learn():
    from sklearn.model_selection import StratifiedKFold

    table = make_table(name_labels(60), spectra(60))
    split = stratified_split(table, 6, 1, random_state=4)
    expected = StratifiedKFold(6, shuffle=True, random_state=4).split(table.values, table.labels)
    for mine, theirs in zip(split.repeats[0], expected, strict=True):
        np.testing.assert_array_equal(mine[0], theirs[0])
        np.testing.assert_array_equal(mine[1], theirs[1])


def test_a_copy_in_another_session_is_held_out_with_the_first():
    values, labels = spectra(60), name_labels(60)
    values[59] = values[2]  # trial 59 of session 3 is a copy of trial 2 of session 0
    labels[59] = labels[2]
    table = make_table(labels, values, session_id=np.repeat(['0', '1', '2', '3'], 15))
    split = grouped_split(table, ['session_id'])
    assert hold_together(split.repeats[0], table.copies)
    assert 59 in split.repeats[0][0][1]
    assert make_group_folds(table).fold[59] == make_group_folds(table).fold[2]
    # If a session is a copy of another one, the two are held out together.
    again = double(values[:30], labels[:30], session_id=np.repeat(['0', '1', '2', '1'], 15))
    assert len(grouped_split(again, ['session_id']).repeats[0]) == 2
    whole = double(values[:30], labels[:30], session_id=np.repeat(['0', '1'], 30))
    with pytest.raises(EvaluationError, match='session or are copies'):
        grouped_split(whole, ['session_id'])


def test_few_different_trials_have_fewer_folds_and_a_stated_split_between_copies_is_refused():
    table = double(spectra(12), name_labels(12))
    split = stratified_split(table)
    assert split.name == 'stratified 4-fold ("label 0" has 4 trials), 10 times'
    assert all(hold_together(folds, table.copies) for folds in split.repeats)
    few = double(spectra(4), name_labels(4, 2))  # each trial is held out with its copy
    assert [len(test) for _, test in stratified_split(few).repeats[0]] in ([2] * 4, [4, 4])
    with pytest.raises(EvaluationError, match='has only one trial'):
        stratified_split(double(spectra(3), name_labels(3)))
    first = np.arange(24) < 12
    with pytest.raises(EvaluationError, match='12 trials with a are copies of trials with b'):
        stated_split(table, first, ~first, 'a', 'b')
