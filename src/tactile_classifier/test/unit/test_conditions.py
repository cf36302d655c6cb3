# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_classifier.datasets.conditions import find_cells, find_tied_labels
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_features.spec import array_spec


def make_table(labels, **columns):
    values = np.random.default_rng(0).normal(size=(len(labels), 3))
    values += (np.unique(labels, return_inverse=True)[1] / 2)[:, None]
    spec = array_spec('stiffness', 50, 60.0)
    return FeatureTable(values, np.array(labels), spec, columns)


def test_cells_are_label_and_conditions_without_numbering_columns():
    labels = np.repeat(['a', 'b'], 12)
    speed = np.tile(np.repeat([10.0, 20.0], 6), 2)
    force = np.tile(np.repeat([1, 2], 3), 4)
    number = np.tile([0, 1, 2], 8)
    cells = find_cells(
        make_table(labels, speed=speed, force=force, repetition=number, trial_id=np.arange(24))
    )
    assert cells.columns == ('speed', 'force')
    assert '24 trials are 8 groups of the same label and speed and force' in cells.warning
    means, sizes = cells.average(np.arange(24.0))
    assert sizes.tolist() == [3] * 8
    assert means == pytest.approx(np.arange(24.0).reshape(8, 3).mean(axis=1))


def test_without_repeated_conditions_there_are_no_cells():
    labels = np.repeat(['a', 'b'], 6)
    assert find_cells(make_table(labels)) is None
    assert find_cells(make_table(labels, session_id=np.full(12, 's'))) is None
    assert find_cells(make_table(labels, speed=np.arange(12.0))) is None
    assert find_cells(make_table(labels, speed=np.tile(np.arange(6.0), 2))) is None
    # A column that follows from the label is no condition.
    assert find_cells(make_table(labels, maker=np.repeat([1, 2], 6))) is None


def test_labels_that_share_no_group_are_told():
    labels = np.repeat(['a', 'b', 'c'], 4)
    each_its_own = np.repeat(['s1', 's2', 's3'], 4)
    (warning,) = find_tied_labels(make_table(labels, mounting_id=each_its_own))
    assert 'mounting and label coincide for 3 of 3 labels (a, b, c)' in warning
    one_alone = np.array(['s1', 's2'] * 4 + ['s3'] * 4)
    (warning,) = find_tied_labels(make_table(labels, session_id=one_alone))
    assert '1 of 3 labels (c)' in warning


def test_labels_of_one_session_among_several_are_told():
    labels = np.repeat(['a', 'b', 'c'], 4)
    session = np.array(['s1'] * 8 + ['s1', 's2', 's1', 's2'])
    (warning,) = find_tied_labels(make_table(labels, session_id=session))
    assert 'one session holds all trials of 2 of 3 labels (a, b)' in warning
    both = np.array(['s1'] * 6 + ['s2', 's2'] + ['s3'] * 4)
    warnings = find_tied_labels(make_table(labels, session_id=both))
    assert ['coincide for 1 of 3 labels (c)' in each for each in warnings] == [True, False]
    assert 'holds all trials of 1 of 3 labels (a)' in warnings[1]


def test_labels_with_several_groups_or_a_common_one_are_not_told():
    labels = np.repeat(['a', 'b', 'c'], 4)
    assert not find_tied_labels(make_table(labels, session_id=np.full(12, 's')))
    # Each mounting holds one label, and each label has two: holding one out is a test.
    assert not find_tied_labels(make_table(labels, mounting_id=np.repeat(np.arange(6), 2)))
    assert not find_tied_labels(make_table(labels, session_id=np.tile(['s1', 's2'], 6)))


def make_near_copies(noise, step):
    """Return ten repeats each of two labels in six sessions."""
    generator = np.random.default_rng(1)
    labels, session = np.repeat(['a', 'b'], 60), np.tile(np.repeat(np.arange(6), 10), 2)
    values = generator.normal(size=(2, 6, 1, 3)).repeat(10, axis=2).reshape(120, 3)
    values += noise * generator.normal(size=values.shape)
    values[:60, 0] += step
    return FeatureTable(values, labels, array_spec('stiffness', 50, 60.0), {'session_id': session})


def test_random_folds_over_near_copies_say_so_and_their_interval_is_over_cells():
    table = make_near_copies(0.01, 0.0)
    found = evaluate(table, ['tree'], ['none'], repetitions=1)
    assert any('repeats of what they train on' in warning for warning in found.warnings)
    held_out = evaluate(table, ['tree'], ['none'], hold_out=['session_id'])
    assert not held_out.warnings
    assert held_out.scores[0].mean < found.scores[0].mean


def test_intervals_over_cells_are_wider_than_over_trials():
    table = make_near_copies(0.0, 1.0)
    found, plain = (
        evaluate(dataclasses.replace(table, columns=c), ['svm_linear'], ['none'], repetitions=3)
        .scores[0]
        for c in (table.columns, {})
    )  # fmt: skip
    assert found.mean == plain.mean
    assert found.interval.method == 'Wilson with t over 12 groups of repeats'
    widths = [each.interval.high - each.interval.low for each in (found, plain)]
    assert widths[0] > 1.3 * widths[1]
