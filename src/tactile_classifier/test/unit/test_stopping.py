# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import functools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import expit

from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.early_answers import (
    evaluate_stopping,
    find_first_stop,
    fit_rule,
    fit_stop_threshold,
)


def test_first_stage_that_reaches_the_threshold_decides():
    confidence = np.array([[0.9, 0.2, 0.1, -1.0], [0.1, 0.95, 0.3, 0.9]])
    np.testing.assert_array_equal(find_first_stop(confidence, 0.9), [0, 1, 2, 1])


def test_no_rule_from_too_few_trials():
    # 0 of n wrong proves 5 % at confidence 1 - 0.1 / 20 from n = 104 on.
    sure = np.ones((1, 104))
    assert fit_stop_threshold(sure, np.zeros((1, 104), dtype=bool), 0.05) == 0.5
    assert fit_stop_threshold(sure[:, 1:], np.zeros((1, 103), dtype=bool), 0.05) is None


def test_threshold_is_the_lowest_that_is_good_enough():
    # Answers stated at 0.75 are wrong half the time, those at 0.99 never.
    confidence = np.repeat([[0.75, 0.99]], 500, axis=0).reshape(1, -1)
    wrong = (np.arange(1000) % 4 == 0)[np.newaxis]
    assert not wrong[confidence == 0.99].any()
    assert wrong[confidence == 0.75].mean() == 0.5
    assert fit_stop_threshold(confidence, wrong, 0.05) == 0.8
    assert fit_stop_threshold(confidence, wrong, 0.3) == 0.5
    assert fit_stop_threshold(confidence, ~wrong, 0.05) is None


def test_one_bad_session_raises_the_threshold_for_all():
    session = np.repeat(np.arange(6), 200)
    confidence = np.tile(np.linspace(0.5, 0.999, 200), 6)[np.newaxis]
    wrong = ((session == 4) & (confidence[0] < 0.98))[np.newaxis]
    # Of all answers a sixth is wrong; from 0.95 on few are, but too many of that session.
    assert fit_stop_threshold(confidence, wrong, 0.2) == 0.5
    threshold = fit_stop_threshold(confidence, wrong, 0.2, session)
    stage = SimpleNamespace(confidence=confidence[0], wrong=wrong[0])
    assert fit_rule([stage], 0.2, session) == threshold
    bad = session == 4
    early = confidence[0, bad] >= threshold
    assert wrong[0, bad][early].mean() <= 0.2
    assert threshold > 0.95
    never_right = (session == 2)[np.newaxis]
    assert fit_stop_threshold(np.ones((1, 1200)), never_right, 0.2) == 0.5
    assert fit_stop_threshold(np.ones((1, 1200)), never_right, 0.2, session) is None


def test_errors_stay_below_the_rate_in_as_many_new_sessions_as_stated():
    rng = np.random.default_rng(13)

    def draw(count):
        # A session's probabilities are too high or too low by a factor of its own.
        shift = 0.5 * rng.normal(size=(count, 1))
        logit = 2.0 + 2.0 * rng.normal(size=(count, 80))
        return expit(logit), rng.random((count, 80)) > expit(logit + shift)

    kept, found = [], 0
    session = np.repeat(np.arange(6), 80)
    for _ in range(150):
        confidence, wrong = draw(6)
        threshold = fit_stop_threshold(
            confidence.reshape(1, -1), wrong.reshape(1, -1), 0.1, session
        )
        new, new_wrong = draw(20)
        early = new >= (np.inf if threshold is None else threshold)
        found += threshold is not None
        mistakes = (early & new_wrong).sum(axis=1) / np.maximum(early.sum(axis=1), 1)
        kept.append(np.mean(mistakes <= 0.1))
    assert found > 100
    assert np.mean(kept) >= 6 / 7 - 0.03


def test_bound_holds_as_often_as_stated():
    # Three stages that grow surer and a world in which confidence is what it says. The
    # rule must not exceed its error in more than a tenth of the calibrations.
    rng = np.random.default_rng(7)

    def draw(trials):
        confidence = np.sort(rng.beta(2.0, 1.0, (3, trials)), axis=0)
        return confidence, rng.random((3, trials)) > confidence

    fresh, fresh_wrong = draw(30_000)

    @functools.cache
    def exceeds(threshold):
        stage = find_first_stop(fresh, threshold)
        early = np.flatnonzero(stage < 3)
        return fresh_wrong[stage[early], early].mean() > 0.1

    thresholds = [fit_stop_threshold(*draw(600), 0.1) for _ in range(150)]
    found = [threshold for threshold in thresholds if threshold is not None]
    assert len(found) > 75
    assert sum(map(exceeds, found)) <= 0.1 * len(thresholds)


def test_evaluation_counts_early_answers(partial_tables):
    table, partial = partial_tables
    noise = 0.02 * np.random.default_rng(1).normal(size=table.values.shape)
    blurred = dataclasses.replace(table, values=np.abs(table.values + noise))
    partial = {60: blurred, 120: partial[120]}
    found = evaluate_stopping(table, partial, 'knn', error_rates=(0.05, 0.0001))
    assert found.seconds == (1.0, 2.0, 3.0)
    assert found.accuracies[0] < found.accuracies[1]
    rule, impossible = found.rules
    assert rule.early_share > 0.5
    assert rule.early_error <= rule.worst_part_error < 0.1
    assert 1.0 <= rule.mean_s < 3.0
    # Not even a trial without a mistake proves one wrong answer in ten thousand.
    assert (impossible.early_share, impossible.mean_s) == (0.0, 3.0)
    assert impossible.parts_without_rule == 3
    assert impossible.accuracy == found.accuracies[-1]
    with pytest.raises(EvaluationError, match='no partial windows'):
        evaluate_stopping(table, {}, 'knn')
