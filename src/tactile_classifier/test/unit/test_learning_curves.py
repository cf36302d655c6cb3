# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import json

import numpy as np
import pytest

from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.evaluation.cross_validation import AccuracyPlan
from tactile_classifier.evaluation.learning_curves import choose_sizes, draw_training, LearningPlan
from tactile_classifier.evaluation.plans import run_plans


def test_training_grows_by_whole_classes_and_holds_what_was_there():
    labels = np.array(list('aabbbbcccccc'))
    drawn = draw_training(labels, np.arange(12)[::-1], np.random.default_rng(0))
    assert drawn.shape == (2, 3)
    assert [set(labels[row]) for row in drawn] == [set('abc')] * 2
    assert len(set(drawn.ravel())) == 6


def test_sizes_double_and_end_at_all():
    assert choose_sizes(50) == (2, 4, 8, 16, 32, 50)
    assert choose_sizes(33) == (2, 4, 8, 16, 33)
    assert choose_sizes(2) == (2,)
    assert choose_sizes(1) == ()


@pytest.mark.parametrize('grouped', [False, True])
def test_curve_ends_at_the_accuracy_of_the_split(small_table, grouped):
    if grouped:
        split = grouped_split(small_table, ['session_id'])
    else:
        split = stratified_split(small_table, 6, 2)
    plans = [
        LearningPlan(small_table, split, ['knn', 'svm_rbf'], ['standard']),
        AccuracyPlan(small_table, split, ['knn', 'svm_rbf'], ['standard']),
    ]
    curves, evaluation = run_plans(plans)
    for curve in curves:
        full = evaluation.score(curve.classifier, 'standard').fold_accuracies[0]
        # Balanced classes: the last size is the whole training.
        np.testing.assert_allclose(curve.accuracies[-1], full, atol=1e-12)
        assert curve.accuracies[0].mean() < curve.accuracies[-1].mean()
        assert curve.split == split.once().name
        assert json.loads(json.dumps(curve.to_dict()))['trials_per_class'][0] == 2
