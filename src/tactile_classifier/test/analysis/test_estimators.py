# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of nearest neighbours, and of the warnings of support vector machines."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tactile_classifier.errors import TooFewTrialsError
from tactile_classifier.estimators import classifiers
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    default_scaling,
    warn_of_labels_never_given,
)
from tactile_classifier.training.model_writer import check_labels, make_predictor
from tactile_classifier.training.trainer import Trained


@pytest.mark.parametrize('scaling', ['standard', 'none'])
@pytest.mark.parametrize('offset', [0.0, 1e6])
def test_answers_away_from_ties_are_those_of_scikit_learn(texture_table, scaling, offset):
    labels = texture_table.labels
    # The noise is so large that the neighbours of a trial have different labels.
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
    assert np.sum(answer != labels[test]) > 0  # otherwise, all cases would be easy


@st.composite
def trials_and_midpoints(draw):
    """Return trials on a coarse grid, their labels, and the midpoints of all pairs of trials."""
    k = draw(st.integers(1, 11))
    trials = draw(st.integers(3, 14))
    grid = draw(st.integers(1, 4))
    cells = draw(st.lists(st.integers(-grid, grid), min_size=trials * k, max_size=trials * k))
    # With multiples of 0.1, differences are rounded.
    values = np.array(cells).reshape(trials, k) * draw(st.sampled_from([0.1, 1.0, 1e5, 1e-160]))
    values = values + draw(st.sampled_from([0.0, 0.3, 1e6]))
    labels = draw(st.lists(st.sampled_from('abc'), min_size=trials, max_size=trials))
    first, second = np.triu_indices(trials)
    return values, np.array(labels), (values[first] + values[second]) / 2


def convert(estimator, values):
    return make_predictor(Trained(estimator, values, None, None, None))


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(['standard', 'none']), trials_and_midpoints())
def test_neighbours_differ_from_scikit_learn_where_distances_are_equal_alone(scaling, case):
    values, labels, asked = case
    estimator = build_estimator('knn', scaling).fit(values, labels)
    predictor = convert(estimator, values)
    answers = estimator.classes_[predictor.compute_raw_scores(asked).argmax(axis=1)]
    for i in np.flatnonzero(answers != estimator.predict(asked)):
        squares = np.sort(predictor.classifier.compute_squares(predictor.scale(asked[i])))
        np.testing.assert_allclose(squares[2], squares[3], rtol=1e-13)


@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf', 'tree'])
@pytest.mark.parametrize('scaling', ['standard', 'none'])
@pytest.mark.parametrize('labels', [2, 3])
def test_labels_at_all_midpoints_of_91_features_are_those_of_scikit_learn(
    small_table, classifier, scaling, labels
):
    table = small_table.take(small_table.labels < f'plate {labels}')
    twice = np.r_[np.arange(len(table)), np.arange(5)]
    values, names = table.values[twice], table.labels[twice]
    estimator = build_estimator(classifier, scaling).fit(values, names)
    first, second = np.triu_indices(len(values))
    predictor = convert(estimator, values)
    check_labels(predictor, estimator, (values[first] + values[second]) / 2)


def test_fewer_trials_than_neighbours_are_refused():
    with pytest.raises(
        TooFewTrialsError, match='3 neighbours need at least 3 training trials, not 2'
    ):
        build_estimator('knn', 'none').fit([[0.0], [1.0]], ['a', 'b'])


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match='classifier is "svm"; it must be one of knn, svm_linear'):
        build_estimator('svm', 'none')
    with pytest.raises(ValueError, match='scaling is "minmax"; it must be one of standard, none'):
        build_estimator('knn', 'minmax')
    scalings = [default_scaling(t, c) for t in ('texture', 'stiffness') for c in ('knn', 'rocket')]
    assert scalings == ['none', 'none', 'standard', 'none']


@pytest.mark.filterwarnings('error')  # scikit-learn must not warn as well
def test_machine_that_does_not_converge_says_so(monkeypatch):
    monkeypatch.setattr(classifiers, 'MAX_SVM_STEPS', 1_000)
    rng = np.random.default_rng(1)
    values, labels = rng.normal(300.0, 100.0, (60, 3)), np.tile(['a', 'b'], 30)
    with pytest.raises(ConvergenceWarning, match=r'linear .* has not converged after 1,000 steps'):
        build_estimator('svm_linear', 'none').fit(values, labels)
    build_estimator('svm_linear', 'none').fit(np.where(labels == 'a', 1.0, 2.0)[:, None], labels)


@pytest.mark.filterwarnings('error')
def test_machine_that_never_gives_a_label_says_so():
    labels = np.repeat(['a', 'b'], [20, 19])
    values = 1e-3 * (labels == 'a')[:, None]  # amplitudes can be this small [N]
    silent = build_estimator('svm_linear', 'none').fit(values, labels)
    with pytest.raises(UserWarning, match=r'linear .* never predicts b,'):
        warn_of_labels_never_given(silent, values)
    for classifier, scaling, first in (
        ('svm_linear', 'none', 1), ('svm_linear', 'standard', 0), ('tree', 'none', 0)
    ):  # fmt: skip
        estimator = build_estimator(classifier, scaling).fit(values[first:], labels[first:])
        warn_of_labels_never_given(estimator, values)
