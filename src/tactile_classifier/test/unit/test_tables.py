# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of tables of features, of their warnings for an evaluation, and of their splits."""

import dataclasses

from classifier_tables import make_table
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.datasets.conditions import find_cells, find_tied_labels
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.datasets.splits import grouped_split, stated_split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spatial import compute_spatial, SpatialWindow


def changed(array, at, value):
    copy = array.copy()
    copy[at] = value
    return copy


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda t: {'values': t.values[:, 1:]}, r'shape \(36, 90\); it must be \(trials, 91\)'),
        (lambda t: {'labels': t.labels[1:]}, 'labels has shape'),
        (lambda t: {'columns': {'contact': ['flexion']}}, r'contact has shape \(1,\)'),
        (lambda t: {'values': changed(t.values, (5, 3), np.nan)}, 'trial 5 are not finite'),
        (lambda t: {'labels': changed(t.labels, 4, '')}, 'trial 4 has an empty label'),
    ],
)
def test_table_refuses_what_does_not_fit(small_table, change, message):
    with pytest.raises(DatasetError, match=message):
        dataclasses.replace(small_table, **change(small_table))


def test_columns_stay_in_step_and_get_our_names(small_table):
    part = small_table.take(small_table.column('session_id') == 's1')
    assert (len(part), set(part.columns['session_id'])) == (12, {'s1'})
    with pytest.raises(DatasetError, match='no column "weekday"; there are: contact, simulated'):
        small_table.column('weekday')
    with pytest.raises(DatasetError, match='no column "session"; there are: none'):
        dataclasses.replace(small_table, columns={}).column('session')
    day = np.arange(36) % 3
    table = dataclasses.replace(small_table, columns={'session': day, 'mounting': day})
    assert sorted(table.columns) == ['mounting_id', 'session_id']
    np.testing.assert_array_equal(table.column('session'), day)
    assert grouped_split(table, ['session']).name == 'one session held out'
    # If both columns exist, neither is renamed.
    both = {'session': day, 'session_id': day // 2}
    table = dataclasses.replace(small_table, columns=both)
    assert list(table.columns) == list(both)
    np.testing.assert_array_equal(table.column('session_id'), day // 2)


def test_digest_depends_on_values_labels_and_specification(small_table):
    values = changed(small_table.values, (0, 1), np.nextafter(small_table.values[0, 1], 1.0))
    others = [
        dataclasses.replace(small_table, **change)
        for change in (
            {'values': values},
            {'labels': small_table.labels[::-1]},
            {'spec': dataclasses.replace(small_table.spec, version=99)},
        )
    ]
    digest = small_table.compute_sha256()
    assert digest == small_table.take(np.arange(36)).compute_sha256()
    assert len({digest, *(other.compute_sha256() for other in others)}) == 4


# -- from trials --------------------------------------------------------------------


@pytest.mark.parametrize('unit', ['', 'N', 'mN', 'V'])
def test_stiffness_features_of_straight_lines_in_their_unit(unit):
    time_s = np.arange(400) / 100.0
    x = np.array([[12.0 - 0.5 * time_s], [8.0 + 0.25 * time_s]])
    named = {'unit': unit, 'columns': {'speed': np.arange(2)}}
    table = table_from_trials('stiffness', x, ['a', 'b'], 100.0, **named)
    assert (table.task, table.spec.units) == ('stiffness', (f'{unit or "N"}/s', unit or 'N', '1'))
    np.testing.assert_allclose(table.values, [[-0.5, 12.0, -1.0], [0.25, 8.0, 1.0]], rtol=1e-12)
    np.testing.assert_array_equal(table.column('speed'), [0, 1])
    still = np.stack([x[0], np.ones_like(x[1])])
    constant = table_from_trials('stiffness', still, ['a', 'b'], 100.0)
    np.testing.assert_array_equal(constant.values[1], [0.0, 1.0, 0.0])


def test_features_over_distance_take_each_glide_at_its_speed():
    x = np.random.default_rng(0).normal(size=(3, 2, 400))
    trials = ('texture', x, ['a', 'b', 'a'], 100.0)
    window, speeds = SpatialWindow(0.03, 0.001), np.array([0.01, 0.02, 0.03])
    config = FeatureConfig(
        texture_features='texture_spatial', spatial_length_m=0.03, spatial_finest_m=0.001
    )
    table = table_from_trials(*trials, 1, config=config, speeds_m_s=speeds)
    assert table.task == 'texture'
    assert table.spec.parameters == {'spatial_length_m': 0.03, 'spatial_finest_m': 0.001}
    count = window.sample_count(0.02, 100.0)
    middle = x[1, 1, (400 - count) // 2 :][:count]
    assert table.values[1].tobytes() == compute_spatial(middle, 0.02, 100.0, window).tobytes()
    with pytest.raises(DatasetError, match=r'trial 2: at 0\.2 m/s'):
        table_from_trials(*trials, config=config, speeds_m_s=np.array([0.01, 0.02, 0.2]))


# -- conditions ---------------------------------------------------------------------


def test_cells_are_label_and_conditions_without_numbering_columns():
    speed = np.tile(np.repeat([10.0, 20.0], 6), 2)
    force = np.tile(np.repeat([1, 2], 3), 4)
    numbers = {'repetition': np.tile([0, 1, 2], 8), 'trial_id': np.arange(24)}
    labels = np.repeat(['a', 'b'], 12)
    cells = find_cells(make_table(labels, speed=speed, force=force, **numbers))
    assert cells.columns == ('speed', 'force')
    assert '24 trials form 8 groups with the same label and speed and force' in cells.warning
    means, sizes = cells.average(np.arange(24.0))
    assert sizes.tolist() == [3] * 8
    assert means == pytest.approx(np.arange(24.0).reshape(8, 3).mean(axis=1))


@pytest.mark.parametrize(
    'columns',
    [
        {},
        {'session_id': np.full(12, 's')},
        {'speed': np.arange(12.0)},
        {'speed': np.tile(np.arange(6.0), 2)},
        {'maker': np.repeat([1, 2], 6)},  # the maker follows from the label
    ],
)
def test_without_repeated_conditions_there_are_no_cells(columns):
    assert find_cells(make_table(np.repeat(['a', 'b'], 6), **columns)) is None


@pytest.mark.parametrize(
    ('name', 'groups', 'sentences'),
    [
        ('mounting_id', 'aaaabbbbcccc', ['mounting and label coincide for 3 of 3 labels (a, b, ']),
        ('session_id', 'ababababcccc', ['session and label coincide for 1 of 3 labels (c)']),
        (
            'session_id',
            'aaaaaaaaabab',
            ['one session contains all trials of 2 of 3 labels (a, b)'],
        ),
        (
            'session_id',
            'aaaaaabbcccc',
            ['coincide for 1 of 3 labels (c)', 'contains all trials of 1 of 3 labels (a)'],
        ),
        ('session_id', 'ssssssssssss', []),
        ('mounting_id', 'aabbccddeeff', []),  # each label has two mountings
        ('session_id', 'abababababab', []),
    ],
)
def test_labels_that_share_no_group_or_have_one_of_several_are_told(name, groups, sentences):
    table = make_table(np.repeat(['a', 'b', 'c'], 4), **{name: list(groups)})
    warnings = find_tied_labels(table)
    assert len(warnings) == len(sentences)
    assert all(part in warning for part, warning in zip(sentences, warnings, strict=True))


def make_near_copies(noise, step):
    """Return a table of two labels in six sessions, each with ten near copies."""
    generator = np.random.default_rng(1)
    values = generator.normal(size=(2, 6, 1, 3)).repeat(10, axis=2).reshape(120, 3)
    values += noise * generator.normal(size=values.shape)
    values[:60, 0] += step
    session = np.tile(np.repeat(np.arange(6), 10), 2)
    return make_table(np.repeat(['a', 'b'], 60), values, session_id=session)


def test_random_folds_over_near_copies_say_so():
    table = make_near_copies(0.01, 0.0)
    found = evaluate(table, ['tree'], ['none'], repetitions=1)
    assert any('test trials repeat training trials' in warning for warning in found.warnings)
    held_out = evaluate(table, ['tree'], ['none'], hold_out=['session_id'])
    assert not held_out.warnings
    assert held_out.scores[0].mean < found.scores[0].mean


def test_intervals_over_cells_are_wider_than_over_trials():
    table = make_near_copies(0.01, 1.0)
    found, plain = (
        evaluate(each, ['svm_linear'], ['none'], repetitions=3).scores[0]
        for each in (table, dataclasses.replace(table, columns={}))
    )
    assert found.mean == plain.mean
    assert found.interval.method.endswith('over 12 groups of repeats')
    widths = [each.interval.high - each.interval.low for each in (found, plain)]
    assert widths[0] > 1.3 * widths[1]


# -- splits -------------------------------------------------------------------------


def check_folds(split, labels, seed):
    """Check that each trial is tested once, and that inner folds stay within their fold."""
    trials = set(range(len(labels)))
    for folds in split.repeats:
        assert sorted(np.concatenate([test for _, test in folds])) == sorted(trials)
        for train, test in folds:
            assert sorted([*train, *test]) == sorted(trials)
    for train, _ in split.repeats[0]:
        if len(train) < 6 and len(set(labels)) == 2:  # the inner folds would be too small
            with pytest.raises(EvaluationError, match='only 2 training trials'):
                split.divide_again(train, labels, seed)
            continue
        for a, b in split.divide_again(train, labels, seed):
            assert sorted([*a, *b]) == sorted(train)
            yield a, b


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 4), st.integers(4, 9), st.integers(2, 4), st.integers(0, 99))
def test_no_trial_is_trained_on_and_tested(classes, each, folds, seed):
    labels = np.random.default_rng(seed).permutation(np.repeat(np.arange(classes), each))
    labels = labels.astype(str)
    list(check_folds(stratified_split(make_table(labels), folds, 2, seed), labels, seed))


@settings(max_examples=25, deadline=None)
@given(st.data(), st.integers(2, 5), st.integers(0, 99))
def test_groups_stay_whole_in_folds_and_in_folds_of_folds(data, groups, seed):
    # Each class is in each group at least once, so that any group can be held out.
    base = [(label, group) for label in 'ab' for group in range(groups)] * 2
    pairs = base + data.draw(st.lists(st.sampled_from(base), min_size=4, max_size=30))
    pairs = [pairs[i] for i in np.random.default_rng(seed).permutation(len(pairs))]
    labels, group = np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
    split = grouped_split(make_table(labels, group=group), ['group'])
    assert len(split.repeats[0]) == groups
    assert all(len(set(group[test])) == 1 for _, test in split.repeats[0])
    if groups == 2:  # only one group is left for training
        for train, _ in split.repeats[0]:
            with pytest.raises(EvaluationError, match='too few training groups remain'):
                split.divide_again(train, labels, 0)
        return
    for a, b in check_folds(split, labels, 0):
        assert not set(group[a]) & set(group[b])


def test_inner_folds_whose_training_part_lacks_a_class_are_left_out():
    labels, groups = np.repeat(['a', 'b'], 8), np.array(list('0000111122223333'))
    split = grouped_split(make_table(labels, group=groups), ['group'])
    train, _ = split.repeats[0][0]
    inner = split.divide_again(train, labels, 0)
    assert sorted(set(groups[test]).pop() for _, test in inner) == ['2', '3']
    assert all(set(labels[a]) == {'a', 'b'} for a, _ in inner)


def test_one_trial_of_a_class_cannot_be_divided_again():
    labels = np.repeat(['a', 'b'], 8)
    split = stratified_split(make_table(labels), 2, 1)
    with pytest.raises(EvaluationError, match='one training trial of class "a"'):
        split.divide_again(np.array([0, 15]), labels, 0)


def test_once_is_the_first_repetition_and_says_so():
    split = stratified_split(make_table(['a'] * 30 + ['b'] * 30), 3, 10)
    assert split.once().name == 'stratified 3-fold, once'
    assert split.once().repeats == split.repeats[:1]
    assert stratified_split(make_table(list('aaabbb')), 3, 1).once().name == split.once().name
    tests = [sorted(test) for test in (split.repeats[0][0][1], split.repeats[1][0][1])]
    assert tests[0] != tests[1]
    held_out = grouped_split(make_table(list('abababab'), day=[0, 0, 0, 0, 1, 1, 1, 1]), ['day'])
    assert held_out.once() == held_out


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
        (
            'ababcb',
            'yyyynn',
            'nnnnyy',
            'class "c" has trials with test, but no training trials with train',
        ),
        ('aaaaaa', 'yyyynn', 'nnnnyy', 'are of one class'),
        ('abab', 'yynn', 'nnyy', 'only 2 training trials'),
    ],
)
def test_a_stated_split_that_cannot_be_is_refused(labels, train, test, message):
    masks = [np.array([letter == 'y' for letter in text]) for text in (train, test)]
    with pytest.raises(EvaluationError, match=message):
        stated_split(make_table(list(labels)), *masks, 'train', 'test')
