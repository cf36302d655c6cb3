# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from tactile_classifier.estimators import build_estimator
from tactile_classifier.neighbours import predict_neighbours
from tactile_classifier.splits import stratified_split


@pytest.mark.parametrize('scaling', ['standard', 'none'])
@pytest.mark.parametrize('offset', [0.0, 1e6])
def test_answers_are_those_of_scikit_learn(texture_table, scaling, offset):
    labels = texture_table.labels
    # Random errors as large as the differences of the classes, so that votes are split.
    noise = np.random.default_rng(4).normal(0.0, 0.05, texture_table.values.shape)
    values = texture_table.values + noise + offset
    (deal,) = stratified_split(texture_table, 6, 1).deals
    answers = predict_neighbours(values, labels, deal, scaling)
    wrong = 0
    for (train, test), answer in zip(deal, answers, strict=True):
        expected = build_estimator('knn', scaling).fit(values[train], labels[train])
        np.testing.assert_array_equal(answer, expected.predict(values[test]))
        wrong += np.sum(answer != labels[test])
    assert wrong > 0  # otherwise nothing was compared but easy cases


def test_votes_that_tie_go_to_the_first_label():
    values = np.array([[0.0], [1.0], [-2.0], [3.0]])
    labels = np.array(['x', 'c', 'b', 'a'])
    fold = (np.array([1, 2, 3]), np.array([0]))
    assert predict_neighbours(values, labels, [fold], 'none')[0].tolist() == ['a']


def test_two_against_one_wins_over_the_nearest():
    values = np.array([[0.0], [0.1], [1.0], [1.1], [9.0]])
    labels = np.array(['x', 'a', 'b', 'b', 'a'])
    fold = (np.array([1, 2, 3, 4]), np.array([0]))
    assert predict_neighbours(values, labels, [fold], 'none')[0].tolist() == ['b']
