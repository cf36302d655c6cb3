# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The classifiers: neighbours without rounding, machines that say what they cannot do."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tactile_classifier.estimators import classifiers
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    default_scaling,
    warn_of_labels_never_given,
)
from tactile_classifier.estimators.neighbours import NearestNeighbours
from tactile_classifier.model_file.graphs import add_neighbours, add_scaling


@pytest.mark.parametrize('scaling', ['standard', 'none'])
@pytest.mark.parametrize('offset', [0.0, 1e6])
def test_answers_away_from_ties_are_those_of_scikit_learn(texture_table, scaling, offset):
    labels = texture_table.labels
    # Random errors as large as the differences of the classes, so that votes are split.
    noise = np.random.default_rng(4).normal(0.0, 0.05, texture_table.values.shape)
    values = texture_table.values + noise + offset
    peer = KNeighborsClassifier(3, algorithm='kd_tree')
    peer = peer if scaling == 'none' else make_pipeline(StandardScaler(), peer)
    train, test = np.arange(480) % 3 > 0, np.arange(480) % 3 == 0
    answer, expected = (
        each.fit(values[train], labels[train]).predict(values[test])
        for each in (build_estimator('knn', scaling), peer)
    )
    np.testing.assert_array_equal(answer, expected)
    assert np.sum(answer != labels[test]) > 0  # otherwise nothing was compared but easy cases


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
    check_graph(run_graph, estimator, asked)
    scaler = estimator.named_steps.get('scale')
    known, rows = (v if scaler is None else scaler.transform(v) for v in (values, asked))
    assert predict_by_hand(known, labels, rows) == estimator.predict(asked).tolist()


@pytest.mark.parametrize('scaling', ['standard', 'none'])
def test_file_agrees_at_all_midpoints_of_91_features(run_graph, small_table, scaling):
    twice = np.r_[np.arange(36), np.arange(5)]
    values, labels = small_table.values[twice], small_table.labels[twice]
    estimator = build_estimator('knn', scaling).fit(values, labels)
    first, second = np.triu_indices(len(values))
    check_graph(run_graph, estimator, (values[first] + values[second]) / 2)


@pytest.mark.parametrize(
    ('values', 'labels', 'answer'),
    [
        ([1.0, -2.0, 3.0], 'cba', 'a'),  # of equal votes the first label
        ([0.1, 1.0, 1.1, 9.0], 'abba', 'b'),
        ([1.0] * 5, 'babaa', 'b'),  # of duplicates the earlier trials
        ([9e200, -9e200, 8e200, 7e200], 'aabb', 'a'),  # distances that overflow are equal
    ],
)
def test_ties_go_to_the_earlier_trial_and_the_first_label(values, labels, answer):
    knn = NearestNeighbours().fit(np.array(values)[:, None], list(labels))
    with np.errstate(over='ignore'):
        assert knn.predict([[0.0]]) == [answer]
    with pytest.raises(ValueError, match='3 neighbours are asked of 2 training trials'):
        knn.fit([[0.0], [1.0]], ['a', 'b'])


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match='classifier is "svm"; it must be one of knn, svm_linear'):
        build_estimator('svm', 'none')
    with pytest.raises(ValueError, match='scaling is "minmax"; it must be one of standard, none'):
        build_estimator('knn', 'minmax')
    scalings = [default_scaling(t, c) for t in ('texture', 'stiffness') for c in ('knn', 'rocket')]
    assert scalings == ['none', 'none', 'standard', 'none']


@pytest.mark.filterwarnings('error')  # scikit-learn's own words would come besides
def test_machine_that_does_not_converge_says_so(monkeypatch):
    monkeypatch.setattr(classifiers, 'MAX_SVM_STEPS', 1_000)
    rng = np.random.default_rng(1)
    values, labels = rng.normal(300.0, 100.0, (60, 3)), np.tile(['a', 'b'], 30)
    with pytest.raises(ConvergenceWarning, match=r'linear .* was stopped after 1,000 steps'):
        build_estimator('svm_linear', 'none').fit(values, labels)
    build_estimator('svm_linear', 'none').fit(np.where(labels == 'a', 1.0, 2.0)[:, None], labels)


@pytest.mark.filterwarnings('error')
def test_machine_that_never_gives_a_label_says_so():
    labels = np.repeat(['a', 'b'], [20, 19])
    values = 1e-3 * (labels == 'a')[:, None]  # as small as amplitudes in newtons can be
    silent = build_estimator('svm_linear', 'none').fit(values, labels)  # as in a fold
    with pytest.raises(UserWarning, match=r'linear .* never answers b,'):
        warn_of_labels_never_given(silent, values)
    for classifier, scaling, first in (
        ('svm_linear', 'none', 1), ('svm_linear', 'standard', 0), ('tree', 'none', 0)
    ):  # fmt: skip
        estimator = build_estimator(classifier, scaling).fit(values[first:], labels[first:])
        warn_of_labels_never_given(estimator, values)
