# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, stated_split, stratified_split
from tactile_classifier.errors import EvaluationError
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def make_table(labels, **columns):
    values = np.zeros((len(labels), 3))
    names = {name: np.array(column) for name, column in columns.items()}
    return FeatureTable(values, np.array(labels), spec_for('stiffness', FeatureConfig()), names)


def check_each_trial_is_tested_once_and_never_trained_on(split, trials):
    for folds in split.repeats:
        tested = np.concatenate([test for _, test in folds])
        assert sorted(tested) == list(range(trials))
        for train, test in folds:
            assert sorted([*train, *test]) == list(range(trials))


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 4), st.integers(4, 9), st.integers(2, 4), st.integers(0, 99))
def test_no_trial_is_trained_on_and_tested(classes, each, folds, seed):
    labels = np.random.default_rng(seed).permutation(np.repeat(np.arange(classes), each))
    split = stratified_split(make_table(labels.astype(str)), folds, 2, seed)
    check_each_trial_is_tested_once_and_never_trained_on(split, len(labels))
    for train, _ in split.repeats[0]:
        if (
            len(train) < 6 and len(set(labels)) == 2
        ):  # halves of which three neighbours cannot be fitted
            with pytest.raises(EvaluationError, match='2 trials would be left to train on'):
                split.divide_again(train, np.array(labels.astype(str)), seed)
            continue
        for a, b in split.divide_again(train, np.array(labels.astype(str)), seed):
            assert sorted([*a, *b]) == sorted(train)


@settings(max_examples=25, deadline=None)
@given(st.data(), st.integers(2, 5), st.integers(0, 99))
def test_groups_stay_whole_in_folds_and_in_folds_of_folds(data, groups, seed):
    # Each class in each group at least once, so that any of them can be held out.
    base = [(label, group) for label in 'ab' for group in range(groups)] * 2
    pairs = base + data.draw(st.lists(st.sampled_from(base), min_size=4, max_size=30))
    pairs = [pairs[i] for i in np.random.default_rng(seed).permutation(len(pairs))]
    labels = np.array([label for label, _ in pairs])
    group = np.array([g for _, g in pairs])
    split = grouped_split(make_table(labels, group=group), ['group'])
    check_each_trial_is_tested_once_and_never_trained_on(split, len(labels))
    assert len(split.repeats[0]) == groups
    for train, test in split.repeats[0]:
        assert len(set(group[test])) == 1
        assert not set(group[train]) & set(group[test])
        if len(set(group[train])) > 1:
            for a, b in split.divide_again(train, labels, 0):
                assert not set(group[a]) & set(group[b])
                assert not {*a, *b} & set(test)


def test_inner_folds_of_groups_that_lack_a_class_are_drawn_at_random():
    # Each class in two groups of its own: without one, a fold of groups may have one class alone.
    labels, group = np.repeat(['a', 'b'], 8), np.repeat([0, 1, 2, 3], 4)
    split = grouped_split(make_table(labels, group=group), ['group'])
    for train, test in split.repeats[0]:
        inner = split.divide_again(train, labels, 0)
        assert len(inner) == 3
        for a, b in inner:
            assert set(labels[a]) == {'a', 'b'}
            assert sorted([*a, *b]) == sorted(train)
            assert not {*a, *b} & set(test)


def test_one_group_left_is_divided_at_random():
    labels = np.array(list('aaabbb') * 2)
    split = grouped_split(make_table(labels, day=np.repeat([0, 1], 6)), ['day'])
    train, _ = split.repeats[0][0]
    assert len(split.divide_again(train, labels, 0)) == 3
    with pytest.raises(EvaluationError, match='one trial of class "a" is left to train on'):
        split.divide_again(train[[0, 3]], labels, 0)


def test_once_is_the_first_repetition_and_says_so():
    split = stratified_split(make_table(['a'] * 30 + ['b'] * 30), 3, 10)
    assert split.once().name == 'stratified 3-fold, once'
    assert split.once().repeats == split.repeats[:1]
    assert stratified_split(make_table(list('aaabbb')), 3, 1).once().name == split.once().name
    tests = [sorted(test) for test in (split.repeats[0][0][1], split.repeats[1][0][1])]
    assert tests[0] != tests[1]
    held_out = grouped_split(make_table(list('abababab'), day=[0, 0, 0, 0, 1, 1, 1, 1]), ['day'])
    once = held_out.once()
    assert (once.name, len(once.repeats)) == (held_out.name, 1)
    assert once.repeats[0] is held_out.repeats[0]


def test_a_stated_split_trains_on_the_one_and_tests_on_the_other():
    table = make_table(list('abababab'), day=[0, 0, 0, 0, 1, 1, 2, 2])
    day = table.column('day')
    split = stated_split(table, day == 0, day == 2, 'day=0', 'day=2')
    assert split.name == 'trained on day=0 (4 trials), tested on day=2'
    ((train, test),) = split.repeats[0]
    assert (train.tolist(), test.tolist()) == ([0, 1, 2, 3], [6, 7])
    assert split.tested.tolist() == [6, 7]


@pytest.mark.parametrize(
    ('labels', 'train', 'test', 'message'),
    [
        ('abab', 'yyyn', 'nnyy', '1 trials are in both'),
        ('ababcb', 'yyyynn', 'nnnnyy', 'class "c" has trials with test and none with train'),
        ('aaaaaa', 'yyyynn', 'nnnnyy', 'all of one class'),
        ('abab', 'yynn', 'nnyy', '2 trials would be left'),
    ],
)
def test_a_stated_split_that_cannot_be_is_refused(labels, train, test, message):
    masks = [np.array([letter == 'y' for letter in text]) for text in (train, test)]
    with pytest.raises(EvaluationError, match=message):
        stated_split(make_table(list(labels)), *masks, 'train', 'test')
