# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import json
import threading

from classifier_tables import make_table
import numpy as np
import pytest
from sklearn.model_selection import StratifiedKFold
from sklearn.svm import SVC

from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.evaluation.cross_validation import (
    evaluate,
    list_pairs,
    make_score,
    predict_folds,
)
from tactile_classifier.evaluation.permutation import measure_permutation
from tactile_classifier.evaluation.plans import run_plans


@pytest.fixture
def noisy_table(stiffness_table):
    """Return a table with overlapping features, so that accuracies differ between folds."""
    rng = np.random.default_rng(1)
    values = stiffness_table.values + rng.normal(0.0, [0.4, 3.0, 0.2], (36, 3))
    columns = {'session_id': np.arange(36) % 4, 'day': np.arange(36) % 2, 'all': np.zeros(36)}
    return dataclasses.replace(stiffness_table, values=values, columns=columns)


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
    assert score.interval.method.endswith('over 12 groups of repeats')
    assert score.spread > 0


def test_result_depends_neither_on_jobs_nor_on_the_other_classifiers(noisy_table):
    calls = []
    once = evaluate(noisy_table, repetitions=2).to_dict()
    twice = evaluate(noisy_table, repetitions=2, jobs=2, progress=lambda *call: calls.append(call))
    assert json.loads(json.dumps(twice.to_dict())) == once
    assert calls == [(1, 2), (2, 2)]
    assert (len(once['scores']), once['split']) == (8, 'stratified 6-fold, 2 times')
    assert once['chance'] == pytest.approx(1 / 3)
    alone = evaluate(noisy_table, ['knn'], ['none'], repetitions=2).to_dict()
    assert alone['scores'][0] in once['scores']
    other = evaluate(noisy_table, repetitions=2, random_state=99).to_dict()
    assert other['scores'] != once['scores']


def test_folds_are_predicted_as_by_one_pipeline_for_each_classifier_and_scaling(noisy_table):
    table = noisy_table
    pairs, folds = list_pairs(table), stratified_split(table, 3, 1).repeats[0]
    answers = predict_folds(pairs, table.values, table.labels, folds)
    for pair, of_pair in zip(pairs, answers, strict=True):
        for (train, test), said in zip(folds, of_pair, strict=True):
            pipeline = build_estimator(*pair).fit(table.values[train], table.labels[train])
            np.testing.assert_array_equal(said, pipeline.predict(table.values[test]))


def test_held_out_group_is_never_trained_on():
    # Even and odd groups have opposite labels. A decision tree can predict the labels of a group
    # only if trials of this group are among its training trials.
    group, odd = np.repeat(np.arange(4), 12), np.arange(48) % 6 == 0
    labels = np.where((group % 2 == 1) ^ odd, 'b', 'a')
    place = 10.0 * group + np.random.default_rng(0).random(48)
    table = make_table(labels, np.stack([place, odd, np.zeros(48)], axis=1), group=group)
    mixed = evaluate(table, ['tree'], ['none'], folds=2, repetitions=2)
    held_out = evaluate(table, ['tree'], ['none'], hold_out=['group'])
    assert mixed.scores[0].mean > 0.8
    assert held_out.scores[0].mean < 0.6
    assert held_out.scores[0].fold_accuracies.shape == (1, 4)
    assert (held_out.split, held_out.scores[0].spread_of) == ('one group held out', 'groups')


def test_groups_of_two_columns(noisy_table):
    evaluation = evaluate(noisy_table, ['knn'], ['none'], hold_out=['session_id', 'day'])
    assert evaluation.split == 'one session and day held out'
    assert evaluation.scores[0].fold_accuracies.shape == (1, 4)  # the session determines the day


@pytest.mark.parametrize(
    ('trials', 'options', 'message'),
    [
        (np.arange(12), {}, 'only one class, "pla"'),
        (np.r_[0, 12:36], {}, 'class "pla" has only one trial'),
        (np.arange(36), {'folds': 1}, 'at least two folds'),
        (np.arange(36), {'hold_out': ['all']}, 'all trials have the same all'),
        (np.arange(36), {'hold_out': ['speed']}, 'no column "speed"'),
        (np.r_[0:24, 25:36:2], {'hold_out': ['day']}, 'class "sponge" have the same day'),
        (np.arange(36), {'classifiers': ['knn', 'forest']}, 'classifier is "forest"'),
    ],
)
def test_what_cannot_be_split_or_held_out_is_refused(noisy_table, trials, options, message):
    with pytest.raises((EvaluationError, DatasetError, ValueError), match=message):
        evaluate(noisy_table.take(trials), **options)


@pytest.mark.parametrize(
    ('trials', 'split', 'folds'),
    [
        (np.r_[0:4, 12:36], 'stratified 4-fold ("pla" has 4 trials), 10 times', 40),
        (np.r_[0:3, 12:15], 'stratified 3-fold ("pla" has 3 trials), 10 times', 30),
        (np.r_[0:2, 12:14], 'leave-one-out ("pla" has 2 trials)', 4),
    ],
)
def test_few_trials_are_divided_into_the_folds_that_they_allow(noisy_table, trials, split, folds):
    evaluation = evaluate(noisy_table.take(trials), ['knn'], ['none'])
    assert evaluation.split == split
    assert evaluation.scores[0].fold_accuracies.size == folds


def test_recall_shows_what_accuracy_hides():
    labels = np.repeat(['rare', 'usual'], [6, 30])
    table = make_table(labels, np.random.default_rng(0).normal(size=(36, 3)))
    split = stratified_split(table, 3, 1)
    usual = [[np.full(len(test), 'usual') for _, test in split.repeats[0]]]
    score = make_score('knn', 'none', table, split, usual)
    assert score.mean == pytest.approx(30 / 36)
    assert score.recall.tolist() == [0.0, 1.0]
    assert score.balanced_accuracy == 0.5
    stated = score.to_dict()
    assert (stated['recall'], stated['balanced_accuracy']) == ({'rare': 0.0, 'usual': 1.0}, 0.5)


def test_permuted_labels_are_named_at_chance_under_the_same_folds():
    rng = np.random.default_rng(1)
    # Three labels in each of four groups; the group shifts all features.
    group, label = np.repeat(np.arange(4), 12), np.resize([0, 1, 2], 48)
    values = rng.normal(size=(48, 3)) + 5.0 * group[:, None]
    values[:, 0] += 40.0 * label
    table = make_table(label.astype(str), values, session_id=group)
    split = grouped_split(table, ['session_id'])
    baseline = measure_permutation(table, split, 'knn', 'none')
    assert (baseline.split, baseline.permutations) == ('one session held out', 20)
    assert baseline.p_value == 1 / 21
    assert baseline.mean == pytest.approx(1 / 3, abs=0.08)
    assert baseline.mean < baseline.largest < 0.7
    noise = dataclasses.replace(table, values=rng.normal(size=(48, 3)))
    assert measure_permutation(noise, split, 'knn', 'none').p_value > 0.05


class TwoParts:
    """Plan of two tasks: the first one ends, and the second one still runs at an interrupt."""

    def __init__(self):
        self.begun, self.interrupted, self.ended = (threading.Event() for _ in range(3))

    def tasks(self):
        return [(self.begun.wait, (10.0,)), (self.compute, ())]

    def compute(self):
        self.begun.set()
        assert self.interrupted.wait(10.0)
        threading.Event().wait(0.2)
        self.ended.set()

    def finish(self, answers):
        raise AssertionError('it was interrupted')


def test_an_interrupt_waits_for_the_parts_that_are_under_way():
    plan = TwoParts()

    def interrupt(done, total):
        plan.interrupted.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_plans([plan], 2, interrupt)
    assert plan.ended.is_set()
