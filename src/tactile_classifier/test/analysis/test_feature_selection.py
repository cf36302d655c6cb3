# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Selection of features by their p-values, inside the folds of a cross-validation."""

import json

from classifier_tables import make_table
import numpy as np
import pytest

from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.evaluation.cross_validation import list_pairs, predict_folds
from tactile_classifier.evaluation.feature_selection import (
    choose_counts,
    compare_selection,
    FoldSelection,
    SelectionPlan,
)
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.evaluation.significance import rank_features


def test_selection_finds_the_two_features_that_tell_among_noise():
    generator = np.random.default_rng(2)
    code = np.repeat([0, 1, 2], 24)
    values = generator.normal(0.0, 1.0, (72, 50))
    values[:, [7, 31]] += 2.0 * code[:, None]
    table = make_table(np.array(['a', 'b', 'c'])[code], values)
    split = stratified_split(table, 4, 1)
    (results,) = run_plans([SelectionPlan(table, split, ['knn'], ['standard', 'none'])])
    for result in results:
        assert result.selected_mean > result.all_mean + 0.05
        assert (result.verdict, result.split) == ('helps', 'stratified 4-fold, once')
        assert max(result.chosen_counts) <= 10
    json.dumps([result.to_dict() for result in results], allow_nan=False)


def test_selection_on_nothing_but_noise_invents_no_accuracy():
    """A ranking on all trials gives a high accuracy; a ranking inside the folds does not."""
    generator = np.random.default_rng(11)
    values, day = generator.normal(0.0, 1.0, (160, 300)), np.arange(160) % 4
    table = make_table(np.repeat(['a', 'b'], 80), values, day=day)
    seen = rank_features(table.values, table.labels)[:20]
    folds = stratified_split(table).repeats[0]
    pairs = [('svm_linear', 'none')]
    (answers,) = predict_folds(pairs, table.values[:, seen], table.labels, folds)
    tested = [table.labels[test] for _, test in folds]
    assert np.mean(np.concatenate(answers) == np.concatenate(tested)) > 0.65
    for split in (stratified_split(table, 5, 1), grouped_split(table, ['day'])):
        ((result,),) = run_plans([SelectionPlan(table, split, ['svm_linear'], ['none'])])
        assert result.selected_mean == pytest.approx(0.5, abs=0.12)
        assert result.verdict != 'helps'


def test_the_count_of_features_is_that_of_a_search_through_all_counts():
    """Skipping numbers of features that cannot become the best does not change the result."""
    generator = np.random.default_rng(4)
    code = np.repeat([0, 1, 2], 20)
    values = generator.normal(0.0, 1.0, (60, 40))
    values[:, ::8] += 1.5 * code[:, None]
    table = make_table(np.array(['a', 'b', 'c'])[code], values)
    split = stratified_split(table, 3, 1)
    pairs = list_pairs(table)
    counts = choose_counts(40)
    for fold in split.repeats[0]:
        inner = split.divide_again(fold[0], table.labels, 0)
        right = np.zeros((len(pairs), len(counts)), dtype=int)
        for part in inner:
            order = rank_features(values[part[0]], table.labels[part[0]])
            for j, count in enumerate(counts):
                said = predict_folds(pairs, values[:, order[:count]], table.labels, [part])
                right[:, j] += [(each == table.labels[part[1]]).sum() for (each,) in said]
        found = compare_selection(pairs, values, table.labels, fold, inner, counts)
        assert [each.count for each in found] == [counts[i] for i in right.argmax(axis=1)]


def test_eight_comparisons_without_effect_rarely_have_a_verdict():
    """Without Holm's correction, a third of the tables would have at least one verdict."""
    values = np.random.default_rng(5).normal(size=(80, 5))
    table = make_table(np.repeat(['a', 'b'], 40), values)
    split = stratified_split(table, 4, 1)
    plan = SelectionPlan(table, split)
    rng = np.random.default_rng(6)
    assert len(plan.finish(fake_folds(rng, split))) == 8
    verdicts = [
        [result.verdict for result in plan.finish(fake_folds(rng, split))] for _ in range(300)
    ]
    share = np.mean([any(each != 'no clear difference' for each in some) for some in verdicts])
    assert share <= 0.09
    ((result, *_),) = [plan.finish(fake_folds(rng, split, gain=0.4))]
    assert (result.verdict, result.difference.low > 0) == ('helps', True)
    ((result, *_),) = [plan.finish(fake_folds(rng, split, gain=-0.4))]
    assert (result.verdict, result.difference.high < 0) == ('hurts', True)


def fake_folds(rng, split, gain=0.0):
    """Return one selection per fold and classifier, with random correct predictions."""
    return [
        [
            FoldSelection(
                2,
                (rng.random(len(test)) < 0.5).astype(float),
                (rng.random(len(test)) < 0.5 + gain).astype(float),
            )
            for _ in range(8)
        ]
        for _, test in split.repeats[0]
    ]


def test_counts_end_with_all_features():
    assert choose_counts(3) == (1, 2, 3)
    assert choose_counts(91) == (5, 10, 20, 40, 91)
    assert choose_counts(1) == (1,)
