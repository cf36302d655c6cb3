# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration and thresholds by held-out trials, which classifiers of the other trials score."""

import dataclasses

from classifier_tables import make_repeats, make_table
import numpy as np
import pytest

from tactile_classifier.confidence.fit_calibration import (
    calibrate_held_out,
    compute_calibration_error,
    hold_out_novelty,
    hold_out_scores,
    leave_labels_out,
    make_group_folds,
)
from tactile_classifier.confidence.fit_novelty import fit_measure
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores


def test_stated_calibration_error_is_that_of_new_conditions():
    table, new = make_repeats(60, 0), make_repeats(600, 1)
    estimator = build_estimator('knn', 'none').fit(table.values, table.labels)
    scores = compute_raw_scores(estimator, new.values)
    answers = np.unique(new.labels, return_inverse=True)[1]

    def state(known):
        part = calibrate_held_out(known, 'knn', 'none', make_group_folds(known), 0.1)
        true = compute_calibration_error(part.calibration.compute(scores), answers)
        return part.error_after, true

    stated, true = state(table)
    assert stated == pytest.approx(true, abs=0.03)
    # If single trials are held out, their near copies are among the training trials.
    stated, true = state(dataclasses.replace(table, columns={}))
    assert stated < true / 2
    assert true > 0.1


def test_no_trial_is_judged_by_a_model_that_knew_it():
    # Labels are random, so the accuracy is only high if a model was trained on tested trials.
    table = make_table(np.random.default_rng(5).choice(['a', 'b'], 200))
    fold = make_group_folds(table).fold
    scores, true = hold_out_scores(table, 'tree', 'none', fold)
    assert np.mean(scores.argmax(axis=1) == true) < 0.65
    assert hold_out_novelty(table, fold).min() > 0.0


def test_held_out_part_states_its_own_error(texture_table):
    folds = make_group_folds(texture_table)
    part = calibrate_held_out(texture_table, 'knn', 'none', folds, 0.1)
    assert part.error_after < part.error_before + 0.02
    known = part.held_out_novelty
    assert (
        known.names
        == folds.names
        == tuple(np.unique(texture_table.column('session_id')).astype(str))
    )
    shares = [np.mean(each > part.novelty_threshold) for each in known.sessions]
    assert np.mean(shares) == pytest.approx(0.1, abs=0.01)
    strict = calibrate_held_out(texture_table, 'knn', 'none', folds, 0.1, strict=True)
    shares = [np.mean(each > strict.novelty_threshold) for each in known.sessions]
    # The strict threshold rejects 10 % in the worst session, and less in the others.
    assert max(shares) == pytest.approx(0.1, abs=0.01)
    assert 0.9 < part.accuracy <= 1.0


def test_unlearned_labels_are_those_of_models_without_them(texture_table):
    table = texture_table.take(texture_table.labels < 'plate 4')
    folds = make_group_folds(table)
    missed, strictly_missed = [], []
    for label in np.unique(table.labels):
        known = table.labels != label
        others, fold = table.take(known), folds.fold[known]
        novelty = hold_out_novelty(others, fold)
        held_out = folds.take(known).divide(novelty)
        for i in np.unique(folds.fold):
            inside, part = others.take(fold != i), table.take(folds.fold == i)
            measure = fit_measure(inside.values, inside.labels, fold[fold != i])
            new = measure.compute(part.values[part.labels == label])
            missed.append(np.mean(new <= held_out.compute_threshold(0.1)))
            strictly_missed.append(np.mean(new <= held_out.compute_threshold(0.1, strict=True)))
    found = leave_labels_out(table, folds, 0.1)
    assert found.labels == 4
    assert found.miss_rate == pytest.approx(np.mean(missed))
    assert found.strict_miss_rate == pytest.approx(np.mean(strictly_missed))
    # There are too few labels, or too few trials for the rate.
    two = texture_table.take(texture_table.labels < 'plate 2')
    assert leave_labels_out(two, make_group_folds(two), 0.1) is None
    few = texture_table.take(np.arange(480) % 20 == 0)
    assert leave_labels_out(few, make_group_folds(few), 0.04) is None
