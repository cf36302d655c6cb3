# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.estimators.neighbours import halve, NearestNeighbours
from tactile_classifier.model_file.graphs import add_neighbours, add_scaling


def predict(values, labels, asked):
    return NearestNeighbours().fit(values, labels).predict(asked).tolist()


@pytest.mark.parametrize('scaling', ['standard', 'none'])
@pytest.mark.parametrize('offset', [0.0, 1e6])
def test_answers_away_from_ties_are_those_of_scikit_learn(texture_table, scaling, offset):
    labels = texture_table.labels
    # Random errors as large as the differences of the classes, so that votes are split.
    noise = np.random.default_rng(4).normal(0.0, 0.05, texture_table.values.shape)
    values = texture_table.values + noise + offset
    peer = KNeighborsClassifier(3, algorithm='kd_tree')
    expected = peer if scaling == 'none' else make_pipeline(StandardScaler(), peer)
    train, test = np.arange(480) % 3 > 0, np.arange(480) % 3 == 0
    answer = (
        build_estimator('knn', scaling).fit(values[train], labels[train]).predict(values[test])
    )
    expected.fit(values[train], labels[train])
    np.testing.assert_array_equal(answer, expected.predict(values[test]))
    assert np.sum(answer != labels[test]) > 0  # otherwise nothing was compared but easy cases


def test_votes_that_tie_go_to_the_first_label():
    assert predict([[1.0], [-2.0], [3.0]], ['c', 'b', 'a'], [[0.0]]) == ['a']


def test_two_against_one_wins_over_the_nearest():
    assert predict([[0.1], [1.0], [1.1], [9.0]], [*'abba'], [[0.0]]) == ['b']


def test_of_duplicates_the_earlier_trials_count():
    assert predict(5 * [[1.0]], [*'babaa'], [[1.0]]) == ['b']
    assert predict(4 * [[1.0]], [*'abaa'], [[1.0]]) == ['a']


def test_fewer_than_three_trials_are_refused():
    with pytest.raises(ValueError, match='3 neighbours are asked of 2 training trials'):
        NearestNeighbours().fit([[0.0], [1.0]], ['a', 'b'])


def test_halves_of_91():
    assert list(halve(91)) == [(64, 91), (32, 64), (16, 32), (8, 16), (4, 8), (2, 4), (1, 2)]
    assert list(halve(3)) == [(2, 3), (1, 2)]
    assert list(halve(1)) == []


@st.composite
def trials_and_midpoints(draw):
    """Trials on a coarse grid, many twice, and asked at all midpoints of two of them."""
    k = draw(st.integers(1, 11))
    trials = draw(st.integers(3, 14))
    grid = draw(st.integers(1, 4))
    cells = draw(st.lists(st.integers(-grid, grid), min_size=trials * k, max_size=trials * k))
    # 0.1: no multiple of a power of two, so that differences are rounded.
    values = np.array(cells).reshape(trials, k) * draw(st.sampled_from([0.1, 1.0, 1e5, 1e-160]))
    values = values + draw(st.sampled_from([0.0, 0.3, 1e6]))
    labels = draw(st.lists(st.sampled_from('abc'), min_size=trials, max_size=trials))
    first, second = np.triu_indices(trials)
    return values, np.array(labels), (values[first] + values[second]) / 2


def predict_by_hand(values, labels, asked):
    """Return the labels by the rule as it stands in the docstrings, term by term."""
    answers = []
    for row in asked.tolist():
        squares = []
        for trial in values.tolist():
            terms = [(a - b) * (a - b) for a, b in zip(trial, row, strict=True)]
            while len(terms) > 1:
                half = max(2**i for i in range(8) if 2**i < len(terms))
                head, tail = terms[:half], terms[half:] + [0.0] * half
                terms = [a + b for a, b in zip(head, tail, strict=False)]
            squares.append(terms[0])
        order = sorted(range(len(values)), key=lambda i: (squares[i], i))
        said = [labels[i] for i in order[:3]]
        answers.append(max(sorted(set(said)), key=said.count))
    return answers


def check_graph(run_graph, estimator, asked):
    """Compare the operators that a model file holds with the estimator, bit for bit."""

    def add(graph, x):
        neighbours = estimator.named_steps['classify']
        return add_neighbours(graph, neighbours, add_scaling(graph, estimator, x))

    votes = run_graph(add, asked, len(estimator.classes_))
    np.testing.assert_array_equal(votes, estimator.predict_proba(asked))


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(['standard', 'none']), trials_and_midpoints())
def test_training_and_file_agree_at_midpoints_and_duplicates(run_graph, scaling, case):
    values, labels, asked = case
    estimator = build_estimator('knn', scaling).fit(values, labels)
    trained = estimator.predict(asked).tolist()
    check_graph(run_graph, estimator, asked)
    scaler = estimator.named_steps.get('scale')
    known, rows = (v if scaler is None else scaler.transform(v) for v in (values, asked))
    assert predict_by_hand(known, labels, rows) == trained


@pytest.mark.parametrize('scaling', ['standard', 'none'])
def test_file_agrees_at_all_midpoints_of_91_features(run_graph, small_table, scaling):
    values = np.concatenate([small_table.values, small_table.values[:5]])  # the last ones twice
    labels = np.concatenate([small_table.labels, small_table.labels[-5:]])
    estimator = build_estimator('knn', scaling).fit(values, labels)
    first, second = np.triu_indices(len(values))
    asked = (values[first] + values[second]) / 2
    check_graph(run_graph, estimator, asked)


def test_distances_that_overflow_are_ties():
    values = np.array([[9e200], [-9e200], [8e200], [7e200]])
    knn = NearestNeighbours().fit(values, ['a', 'a', 'b', 'b'])
    with np.errstate(over='ignore'):
        assert knn.predict([[0.0]]) == ['a']
