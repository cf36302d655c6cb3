# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from collections import Counter
import json

import numpy as np
import pytest
from sklearn.model_selection import StratifiedKFold
from sklearn.svm import SVC

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.evaluation.cross_validation import AccuracyPlan, evaluate
from tactile_classifier.evaluation.plans import run_plans
from tactile_features.config import FeatureConfig
from tactile_features.spec import array_spec, spec_for


@pytest.fixture
def noisy_table(stiffness_table):
    """Same labels, features that overlap: accuracies differ from fold to fold."""
    rng = np.random.default_rng(1)
    values = stiffness_table.values + rng.normal(0.0, [0.4, 3.0, 0.2], (36, 3))
    return FeatureTable(
        values,
        stiffness_table.labels,
        stiffness_table.spec,
        {'session_id': np.arange(36) % 4, 'day': np.arange(36) % 2, 'all': np.zeros(36)},
    )


def test_scores_agree_with_folds_done_by_hand(noisy_table):
    evaluation = evaluate(noisy_table, ['svm_rbf'], ['standard'], folds=4, repetitions=3)
    x, y = noisy_table.values, noisy_table.labels
    accuracies, confusion = np.zeros((3, 4)), np.zeros((3, 3), dtype=int)
    for i in range(3):
        splits = StratifiedKFold(4, shuffle=True, random_state=i).split(x, y)
        for j, (train, test) in enumerate(splits):
            mean, deviation = x[train].mean(axis=0), x[train].std(axis=0)
            svm = SVC(break_ties=True).fit((x[train] - mean) / deviation, y[train])
            answer = svm.predict((x[test] - mean) / deviation)
            accuracies[i, j] = np.mean(answer == y[test])
            for true, said in zip(y[test], answer, strict=True):
                names = ['pla', 'rubber', 'sponge']
                confusion[names.index(true), names.index(said)] += 1
    (score,) = evaluation.scores
    np.testing.assert_array_equal(score.fold_accuracies, accuracies)
    np.testing.assert_array_equal(score.confusion, confusion)
    assert score.mean == pytest.approx(accuracies.mean(), abs=1e-15)
    assert score.spread == pytest.approx(np.std(accuracies.mean(axis=1), ddof=1), abs=1e-15)
    assert 0.3 < score.mean < 1.0
    assert score.interval.low < score.mean < score.interval.high
    assert score.interval.method == 'Wilson with t over 12 groups of repeats'
    assert score.spread > 0


def test_result_depends_neither_on_jobs_nor_on_the_other_classifiers(noisy_table):
    calls = []
    once = evaluate(noisy_table, repetitions=2).to_dict()
    twice = evaluate(noisy_table, repetitions=2, jobs=2, progress=lambda *call: calls.append(call))
    assert json.loads(json.dumps(twice.to_dict())) == once
    assert calls == [(i, 16) for i in range(1, 17)]
    assert (len(once['scores']), once['split']) == (8, 'stratified 6-fold, 2 times')
    assert once['chance'] == pytest.approx(1 / 3)
    alone = evaluate(noisy_table, ['knn'], ['none'], repetitions=2).to_dict()
    assert alone['scores'][0] in once['scores']
    other = evaluate(noisy_table, repetitions=2, random_state=99).to_dict()
    assert other['scores'] != once['scores']


def test_held_out_group_is_never_trained_on():
    # The label follows from the number of the group, and neighbouring groups differ:
    # easy for a tree that has seen the group, impossible for one that has not.
    group = np.repeat(np.arange(4), 6)
    labels = np.array(['a', 'b', 'a', 'b'])[group]
    labels = np.where(np.arange(24) % 6 == 0, np.where(labels == 'a', 'b', 'a'), labels)
    values = np.stack([10.0 * group, np.arange(24) % 6 == 0, np.zeros(24)], axis=1)
    table = FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), {'group': group})
    mixed = evaluate(table, ['tree'], ['none'], folds=2, repetitions=2)
    held_out = evaluate(table, ['tree'], ['none'], hold_out=['group'])
    assert mixed.scores[0].mean > 0.8
    assert held_out.scores[0].mean < 0.6
    assert held_out.scores[0].fold_accuracies.shape == (1, 4)
    assert held_out.split == 'one group held out'
    assert held_out.scores[0].spread_of == 'groups'


def test_groups_of_two_columns(noisy_table):
    evaluation = evaluate(noisy_table, ['knn'], ['none'], hold_out=['session_id', 'day'])
    assert evaluation.split == 'one session and day held out'
    assert evaluation.scores[0].fold_accuracies.shape == (1, 4)  # day follows from session


def test_what_cannot_be_split_is_refused(noisy_table):
    one = noisy_table.take(noisy_table.labels == 'pla')
    with pytest.raises(EvaluationError, match='one class only, "pla"'):
        evaluate(one)
    few = noisy_table.take(np.r_[0:4, 12:36])
    with pytest.raises(EvaluationError, match='class "pla" has 4 trials, fewer than the 6 folds'):
        evaluate(few)
    with pytest.raises(EvaluationError, match='two folds or more'):
        evaluate(noisy_table, folds=1)
    with pytest.raises(EvaluationError, match='2 trials would be left to train on'):
        evaluate(noisy_table.take([0, 1, 12, 13]), folds=2)


def test_what_cannot_be_held_out_is_refused(noisy_table):
    with pytest.raises(EvaluationError, match='all trials have the same all'):
        evaluate(noisy_table, hold_out=['all'])
    with pytest.raises(DatasetError, match='no column "speed"'):
        evaluate(noisy_table, hold_out=['speed'])
    sponge_today = (noisy_table.labels != 'sponge') | (noisy_table.column('day') == 1)
    with pytest.raises(EvaluationError, match='class "sponge" have the same day'):
        evaluate(noisy_table.take(sponge_today), hold_out=['day'])


def test_wrong_name_fails_before_any_work(noisy_table):
    with pytest.raises(ValueError, match='classifier is "forest"'):
        evaluate(noisy_table, ['knn', 'forest'])


def test_choice_inside_the_folds_is_that_done_by_hand(noisy_table):
    split = grouped_split(noisy_table, ['session_id'])
    plan = AccuracyPlan(noisy_table, split, ['knn', 'tree'], ['none'], random_state=3)
    (evaluation,) = run_plans([plan], 1)
    pairs = [(score.classifier, score.scaling) for score in evaluation.scores]
    accuracies, picks = [], []
    for train, test in split.repeats[0]:
        inner = split.divide_again(train, noisy_table.labels, 3)
        right = [
            sum(
                np.sum(build_estimator(*pair).fit(x[a], y[a]).predict(x[b]) == y[b])
                for a, b in inner
            )
            for pair in pairs
            for x, y in [(noisy_table.values, noisy_table.labels)]
        ]
        picks.append(pairs[int(np.argmax(right))])
        x, y = noisy_table.values, noisy_table.labels
        chosen = build_estimator(*picks[-1]).fit(x[train], y[train])
        accuracies.append(np.mean(chosen.predict(x[test]) == y[test]))
        assert not any(np.isin(test, part).any() for fold in inner for part in fold)
    nested = evaluation.nested
    assert nested.mean == pytest.approx(np.mean(accuracies), abs=1e-15)
    assert {pick[:2]: pick[2] for pick in nested.picks} == dict(Counter(picks))
    assert nested.interval.method.endswith('groups')
    assert evaluation.to_dict()['nested']['mean'] == nested.mean


def test_the_best_of_classifiers_that_know_nothing_is_chance_when_chosen_inside():
    generator = np.random.default_rng(4)
    best, inside = [], []
    for _ in range(8):
        table = FeatureTable(
            generator.normal(size=(60, 3)),
            generator.permutation(np.repeat(['a', 'b'], 30)),
            array_spec('stiffness', 50, 60.0),
        )
        split = stratified_split(table, 6, 1)
        (found,) = run_plans([AccuracyPlan(table, split, ['knn', 'tree'], random_state=0)], 1)
        best.append(max(score.mean for score in found.scores))
        inside.append(found.nested.mean)
    assert np.mean(best) > 0.55
    assert np.mean(inside) == pytest.approx(0.5, abs=0.05)
