# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from tactile_classifier.estimators import classifiers
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    DEFAULT_SCALING,
    SCORE_KINDS,
    warn_of_labels_never_given,
)
from tactile_classifier.records import CLASSIFIERS, SCALINGS


def test_every_name_builds_and_every_task_has_a_scaling():
    for classifier in CLASSIFIERS:
        assert classifier in SCORE_KINDS
        for scaling in SCALINGS:
            steps = build_estimator(classifier, scaling).named_steps
            assert ('scale' in steps) == (scaling == 'standard')
    assert set(DEFAULT_SCALING) == {'texture', 'stiffness'}
    assert set(DEFAULT_SCALING.values()) <= set(SCALINGS)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match='classifier is "svm"; it must be one of knn, svm_linear'):
        build_estimator('svm', 'none')
    with pytest.raises(ValueError, match='scaling is "minmax"; it must be one of standard, none'):
        build_estimator('knn', 'minmax')


@pytest.mark.parametrize('classifier', CLASSIFIERS)
def test_label_is_the_largest_score(texture_table, classifier):
    table = texture_table.take(np.arange(0, 480, 3))
    estimator = build_estimator(classifier, 'none').fit(table.values, table.labels)
    mixed = table.values[::2] + table.values[1::2][::-1]  # near the borders
    score = getattr(estimator, 'decision_function' if 'svm' in classifier else 'predict_proba')
    best = estimator.classes_[score(mixed).argmax(axis=1)]
    np.testing.assert_array_equal(estimator.predict(mixed), best)


def test_constant_feature_survives_scaling(small_table):
    assert not small_table.values[:, 0].any()  # the component at 0 Hz
    estimator = build_estimator('svm_rbf', 'standard').fit(small_table.values, small_table.labels)
    assert np.isfinite(estimator.decision_function(small_table.values)).all()


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
    equal = build_estimator('svm_linear', 'none').fit(values[1:], labels[1:])
    warn_of_labels_never_given(equal, values)
    scaled = build_estimator('svm_linear', 'standard').fit(values, labels)
    warn_of_labels_never_given(scaled, values)
    warn_of_labels_never_given(build_estimator('tree', 'none').fit(values, labels), values)
