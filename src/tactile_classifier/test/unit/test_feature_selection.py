# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import json

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.evaluation.cross_validation import predict_folds
from tactile_classifier.evaluation.feature_selection import choose_counts, SelectionPlan
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.evaluation.significance import rank_features
from tactile_features.spec import array_spec


def make_table(values, labels):
    spec = array_spec('texture', 2 * values.shape[1] - 1, 60.0)
    return FeatureTable(values, labels, spec, {'day': np.arange(len(labels)) % 4})


def test_selection_finds_the_two_features_that_tell_among_noise():
    generator = np.random.default_rng(2)
    code = np.repeat([0, 1, 2], 24)
    labels = np.array(['a', 'b', 'c'])[code]
    values = generator.normal(0.0, 1.0, (72, 50))
    values[:, [7, 31]] += 2.0 * code[:, None]
    table = make_table(values, labels)
    split = stratified_split(table, 4, 1)
    (results,) = run_plans([SelectionPlan(table, split, ['knn'], ['standard', 'none'])])
    for result in results:
        assert result.selected_mean > result.all_mean + 0.05
        assert result.verdict == 'helps'
        assert max(result.chosen_counts) <= 10
        assert result.split == 'stratified 4-fold, once'
    json.dumps([result.to_dict() for result in results], allow_nan=False)


def test_selection_on_nothing_but_noise_invents_no_accuracy():
    """Ranked on all trials, some features look telling; inside the folds it is chance."""
    generator = np.random.default_rng(11)
    table = make_table(generator.normal(0.0, 1.0, (160, 300)), np.repeat(['a', 'b'], 80))
    seen = rank_features(table.values, table.labels)[:20]
    folds = stratified_split(table).repeats[0]
    answers = predict_folds('svm_linear', 'none', table.values[:, seen], table.labels, folds)
    tested = [table.labels[test] for _, test in folds]
    assert np.mean(np.concatenate(answers) == np.concatenate(tested)) > 0.65
    for split in (stratified_split(table, 5, 1), grouped_split(table, ['day'])):
        ((result,),) = run_plans([SelectionPlan(table, split, ['svm_linear'], ['none'])])
        assert result.selected_mean == pytest.approx(0.5, abs=0.12)
        assert result.verdict != 'helps'


def test_counts_end_with_all_features():
    assert choose_counts(3) == (1, 2, 3)
    assert choose_counts(91) == (5, 10, 20, 40, 91)
    assert choose_counts(1) == (1,)
