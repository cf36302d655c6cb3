# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_classifier.datasets.archive import LabelledTrials
from tactile_classifier.datasets.dataset import FeatureTable, table_from_trials
from tactile_classifier.datasets.splits import grouped_split
from tactile_classifier.errors import DatasetError
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spatial import compute_spatial, SpatialWindow


def test_table_refuses_what_does_not_fit(small_table):
    values, labels, spec = small_table.values, small_table.labels, small_table.spec
    with pytest.raises(DatasetError, match=r'shape \(36, 90\); it must be \(trials, 91\)'):
        FeatureTable(values[:, 1:], labels, spec)
    with pytest.raises(DatasetError, match='labels has shape'):
        FeatureTable(values, labels[1:], spec)
    with pytest.raises(DatasetError, match=r'contact has shape \(1,\)'):
        FeatureTable(values, labels, spec, {'contact': np.array(['flexion'])})
    broken = values.copy()
    broken[5, 3] = np.nan
    with pytest.raises(DatasetError, match='trial 5 are not finite'):
        FeatureTable(broken, labels, spec)
    blank = labels.copy()
    blank[4] = ''
    with pytest.raises(DatasetError, match='trial 4 has an empty label'):
        FeatureTable(values, blank, spec)


def test_take_keeps_columns_in_step(small_table):
    part = small_table.take(small_table.column('session_id') == 's1')
    assert len(part) == 12
    assert set(part.columns['session_id']) == {'s1'}
    with pytest.raises(DatasetError, match='no column "weekday"; there are: contact, simulated'):
        small_table.column('weekday')


def test_columns_of_others_get_our_names(small_table):
    day = np.arange(36) % 3
    table = FeatureTable(
        small_table.values, small_table.labels, small_table.spec, {'session': day, 'mounting': day}
    )
    assert sorted(table.columns) == ['mounting_id', 'session_id']
    np.testing.assert_array_equal(table.column('session'), day)
    assert grouped_split(table, ['session']).name == 'one session held out'
    # The session that is stated as ours stays, and the other one beside it.
    both = {'session': day, 'session_id': day // 2}
    table = FeatureTable(small_table.values, small_table.labels, small_table.spec, both)
    assert list(table.columns) == list(both)
    np.testing.assert_array_equal(table.column('session_id'), day // 2)


def test_digest_depends_on_values_labels_and_specification(small_table):
    digest = small_table.compute_sha256()
    assert digest == small_table.take(np.arange(36)).compute_sha256()
    values = small_table.values.copy()
    values[0, 1] = np.nextafter(values[0, 1], 1.0)
    labels = small_table.labels[::-1]
    spec = dataclasses.replace(small_table.spec, version=99)
    others = [
        FeatureTable(values, small_table.labels, small_table.spec),
        FeatureTable(small_table.values, labels, small_table.spec),
        FeatureTable(small_table.values, small_table.labels, spec),
    ]
    assert len({digest, *(other.compute_sha256() for other in others)}) == 4


def trials_of(x, labels):
    return LabelledTrials(x, np.array(labels), 100.0, {'speed': np.arange(len(labels))})


def test_stiffness_features_of_straight_lines():
    time_s = np.arange(400) / 100.0
    x = np.array([[12.0 - 0.5 * time_s], [8.0 + 0.25 * time_s]])
    table = table_from_trials('stiffness', trials_of(x, ['a', 'b']))
    assert table.task == 'stiffness'
    expected = [[-0.5, 12.0, -1.0], [0.25, 8.0, 1.0]]
    np.testing.assert_allclose(table.values, expected, rtol=1e-12)
    np.testing.assert_array_equal(table.column('speed'), [0, 1])


def test_trial_without_features_is_named():
    x = np.ones((2, 1, 50))
    x[0, 0, 10] = 2.0
    with pytest.raises(DatasetError, match=r'1 of 2 .*row 1: .*constant'):
        table_from_trials('stiffness', trials_of(x, ['a', 'b']))


def test_features_over_distance_take_each_glide_at_its_speed():
    x = np.random.default_rng(0).normal(size=(3, 2, 400))
    trials = trials_of(x, ['a', 'b', 'a'])
    window, speeds = SpatialWindow(0.03, 0.001), np.array([0.01, 0.02, 0.03])
    config = FeatureConfig(
        texture_features='texture_spatial', spatial_length_m=0.03, spatial_finest_m=0.001
    )
    table = table_from_trials('texture', trials, 1, config=config, speeds_m_s=speeds)
    assert table.task == 'texture'
    assert table.spec.parameters == {'spatial_length_m': 0.03, 'spatial_finest_m': 0.001}
    first = (400 - window.sample_count(0.02, 100.0)) // 2
    middle = x[1, 1, first : first + window.sample_count(0.02, 100.0)]
    assert table.values[1].tobytes() == compute_spatial(middle, 0.02, 100.0, window).tobytes()
    with pytest.raises(DatasetError, match=r'trial 2: at 0\.2 m/s'):
        table_from_trials('texture', trials, config=config, speeds_m_s=np.array([0.01, 0.02, 0.2]))


def test_features_have_the_unit_of_the_signals():
    x = np.random.default_rng(0).normal(size=(6, 1, 200))
    units = {}
    for unit in ('', 'N', 'mN', 'V'):
        trials = LabelledTrials(x, np.array(['a', 'b'] * 3), 60.0, {}, unit=unit)
        units[unit] = table_from_trials('stiffness', trials).spec.units
    assert units[''] == units['N'] == ('N/s', 'N', '1')
    assert units['mN'] == ('mN/s', 'mN', '1')
    assert units['V'] == ('V/s', 'V', '1')
