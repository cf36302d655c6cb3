# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated glides at several speeds, and features over distance."""

import dataclasses

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile

from tactile_analysis.datasets.feature_options import parse_over
from tactile_analysis.datasets.feature_tables import read_tables
from tactile_classifier.model_file.model import load_model
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_ros.errors import TactileError

SPEEDS_MM_S = (10, 30)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    speeds = [part for mm_s in SPEEDS_MM_S for part in ('--speed', mm_s)]
    options = ('--contact', 'flexion', '--trials', 1, '--sessions', 2, '--jobs', 1, *speeds)
    hear_tactile('simulate', 'texture', '-o', folder, *options)
    return [folder / f'texture_flexion_{mm_s}mm_s' for mm_s in SPEEDS_MM_S]


def test_each_speed_has_a_bag_with_this_speed_in_its_events(bags):
    for mm_s, bag in zip(SPEEDS_MM_S, bags, strict=True):
        table = read_tables([bag], parse_over('45:0.5'))['texture', 'flexion']
        assert len(table) == 16
        assert set(table.column('glide_speed_m_s')) == {mm_s / 1e3}
        assert table.spec.feature_set == 'texture_spatial'
        # Each window has 45 mm, so its duration depends on the speed.
        duration_s = (table.column('window_end_ns') - table.column('window_start_ns')) / 1e9
        np.testing.assert_allclose(duration_s * mm_s, 45.0, atol=mm_s / 60.0)


def test_model_over_distance_requires_nodes_with_the_same_parameters(bags, tmp_path):
    arguments = ('train', *bags, '-o', tmp_path, '--over', '45:0.5')
    hear_tactile(*arguments, '--repetitions', 1, '--folds', 2)
    model = load_model(tmp_path / 'texture_flexion.npz')
    config = FeatureConfig(texture_features='texture_spatial')
    assert model.spec.mismatch(spec_for('texture', config)) is None
    assert 'feature set' in model.spec.mismatch(spec_for('texture', FeatureConfig()))
    finer = dataclasses.replace(config, spatial_finest_m=0.00025)
    assert 'spatial_finest_m' in model.spec.mismatch(spec_for('texture', finer))
    said = hear_tactile(*arguments, '--window', '1', '--force', code=2)
    assert 'no early windows' in said


def test_invalid_windows_over_distance_and_speeds_of_stiffness_are_refused(tmp_path):
    for text in ('45', '45:', 'a:b', '1:0.5', '45:0', 'nan:1'):
        with pytest.raises(TactileError, match='--over'):
            parse_over(text)
    said = hear_tactile('simulate', 'stiffness', '-o', tmp_path, '--speed', 5, code=2)
    assert 'for texture' in said


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / 'glides.npz'
    at_s = np.arange(200) / 50.0
    speeds = np.tile([10.0, 20.0], 12)
    pitch_mm = np.repeat([3.0, 5.0], 12)
    x = np.sin(2 * np.pi * (speeds / pitch_mm)[:, None] * at_s)[:, None]
    label = np.repeat(['fine', 'coarse'], 12)
    np.savez(path, x=x, label=label, rate_hz=50.0, speed_mm_s=speeds, speed=speeds)
    return path


def options_for(**changes):
    """Return the options of a small evaluation; an option is omitted if its value is None."""
    given = {'task': 'texture', 'group': 'speed_mm_s', 'folds': 2, 'repetitions': 1}
    given |= {'over': '30:0.5', 'speed-column': 'speed_mm_s', **changes}
    return [part for k, v in given.items() if v is not None for part in (f'--{k}', v)]


def test_archive_is_evaluated_over_distance_with_one_speed_held_out(archive):
    (result,) = ask_tactile('evaluate', archive, *options_for())['sets']
    assert 'over 30:0.5 mm' in result['title']
    assert result['features'][0] == 'tension__spatial_spectrum__per_m_33.333'


@pytest.mark.parametrize(
    ('fields', 'sentence'),
    [
        ({'speed-column': None}, 'give the numeric column'),
        ({'speed-column': 'label'}, 'give the numeric column'),
        ({'speed-column': 'speed'}, 'end in its unit'),
        ({'task': 'stiffness'}, 'use --task texture'),
        ({'over': '100:0.5'}, 'trial 0: it has 200 samples'),
    ],
)
def test_contradictory_values_are_refused_with_a_sentence(archive, fields, sentence):
    assert sentence in hear_tactile('evaluate', archive, *options_for(**fields), code=2)
