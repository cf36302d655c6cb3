# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Learning curves of tables for which it is known whether more sessions help."""

import json

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_classifier.evaluation.learning_curve import measure_learning_curve, MOST_POINTS
from tactile_classifier.evaluation.permutation import permute_labels
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def make_table(sessions, offset, noise, trials=6, column='session_id'):
    """Return a table of three labels; each label has a random offset in each session."""
    generator = np.random.default_rng(6)
    session = np.repeat(np.arange(sessions), 3 * trials)
    code = np.tile(np.repeat(np.arange(3), trials), sessions)
    centre = np.eye(3)[code] + offset * generator.normal(size=(sessions, 3, 3))[session, code]
    values = centre + noise * generator.normal(size=(len(code), 3))
    labels = np.array(['pla', 'rubber', 'sponge'])[code]
    columns = {column: np.char.mod('%d', session)}
    return FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), columns)


def find_curve(table, columns=('session_id',), classifier='knn'):
    return measure_learning_curve(table, columns, classifier, 'none')


def test_of_separate_labels_one_session_is_enough():
    curve = find_curve(make_table(6, 0.0, 0.05))
    assert [point.groups for point in curve.points] == [1, 2, 3, 4, 5]
    assert [point.mean for point in curve.points] == [1.0] * 5
    assert (curve.gain, curve.needs_more) == (0.0, False)
    # Each session has 18 trials; those of the tested session are not used for training.
    assert [point.trials for point in curve.points] == [18 * n for n in range(1, 6)]


def test_where_labels_take_many_trials_to_learn_more_sessions_help():
    """Labels alternate along one feature, so neighbours must be close to predict the label."""
    generator = np.random.default_rng(7)
    place = generator.uniform(0.0, 1.0, 12 * 18)
    labels = np.array(['pla', 'rubber', 'sponge'])[(30 * place).astype(int) % 3]
    values = np.column_stack([place, np.zeros((len(place), 2))])
    columns = {'session_id': np.repeat(np.arange(12), 18)}
    curve = find_curve(FeatureTable(values, labels, make_table(2, 0.0, 0.1).spec, columns))
    means = [point.mean for point in curve.points]
    assert len(means) == MOST_POINTS
    assert curve.points[-1].groups == 11
    assert means[-1] > means[0] + 0.2
    assert curve.half <= 5
    assert curve.gain == pytest.approx(
        means[-1] - next(p.mean for p in curve.points if p.groups == curve.half)
    )
    assert curve.needs_more is True


def test_noise_without_any_difference_cannot_tell_or_does_not_ask_for_more():
    curve = find_curve(make_table(6, 0.0, 30.0))
    assert curve.needs_more is not True
    assert abs(curve.points[-1].mean - 1 / 3) < 0.15
    json.dumps(curve.to_dict(), allow_nan=False)


def test_the_last_point_is_the_accuracy_with_one_session_held_out():
    table = make_table(4, 0.4, 0.3)
    score = evaluate(table, ['knn'], ['none'], hold_out=['session_id']).scores[0]
    last = find_curve(table).points[-1]
    assert last.mean == pytest.approx(score.mean)
    assert last.interval == score.interval


def test_specimens_of_one_label_each_are_counted_by_label():
    table = make_table(4, 0.2, 0.1)
    names = np.char.add(table.labels, np.char.add('-', table.columns['session_id']))
    table = FeatureTable(table.values, table.labels, table.spec, {'specimen': names})
    curve = find_curve(table, ('specimen',))
    assert curve.group == 'specimen'
    assert [point.groups for point in curve.points] == [1, 2, 3]
    # Without the tested specimen, its label has three specimens, so at most three are used.
    assert [point.trials for point in curve.points] == [18, 36, 54]


def test_two_groups_and_single_trials_are_refused():
    with pytest.raises(EvaluationError, match=r'"pla" has trials in 2 groups \(session\)'):
        find_curve(make_table(2, 0.0, 0.1))
    table = make_table(3, 0.0, 0.1, trials=1)
    two = table.take(table.labels != 'sponge')
    with pytest.raises(EvaluationError, match='fewer than 3 trials'):
        find_curve(two)


def test_random_convolutions_have_a_curve_too():
    config = FeatureConfig(stiffness_features='hold_waveform')
    spec = spec_for('stiffness', config)
    generator = np.random.default_rng(1)
    code = np.tile([0, 1], 12)
    time = np.linspace(0.0, 1.0, len(spec.names))
    values = np.sin(2 * np.pi * (2 + 3 * code[:, None]) * time) + generator.normal(
        0.0, 0.1, (24, len(time))
    )
    columns = {'session_id': np.arange(24) // 8}
    table = FeatureTable(values, np.array(['a', 'b'])[code], spec, columns)
    curve = find_curve(table, classifier='rocket')
    assert [point.groups for point in curve.points] == [1, 2]
    assert curve.points[-1].mean > 0.9


def test_labels_of_specimens_are_permuted_among_them():
    labels = np.repeat(['a', 'b', 'a', 'b'], 3)
    groups = np.repeat(np.arange(4), 3)
    rng = np.random.default_rng(0)
    permuted = [permute_labels(labels, groups, rng) for _ in range(20)]
    assert any((each != labels).any() for each in permuted)
    for each in permuted:
        by_group = each.reshape(4, 3)
        assert (by_group == by_group[:, :1]).all()
        assert (each == 'a').sum() == 6
    # A group with several labels keeps its number of trials of each label.
    mixed = np.tile(['a', 'b', 'b'], 4)
    for _ in range(5):
        each = permute_labels(mixed, groups, rng).reshape(4, 3)
        assert ((each == 'a').sum(axis=1) == 1).all()
