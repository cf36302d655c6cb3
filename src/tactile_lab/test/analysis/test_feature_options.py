# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`--features` of train and evaluate: sets by name, and the choice inside the folds."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from tactile_classifier.model_file.inference import TactileModel
from tactile_lab.cli.main import app
from tactile_lab.datasets.feature_options import choose_features, list_sets
from tactile_ros.errors import TactileError


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    arguments = ['simulate', 'texture', '-o', str(folder), '--contact', 'flexion']
    done = CliRunner().invoke(app, [*arguments, '--trials', '3', '--sessions', '2', '--jobs', '1'])
    assert done.exit_code == 0, done.output
    return folder / 'texture_flexion'


@pytest.fixture
def archive(tmp_path):
    rng = np.random.default_rng(0)
    label = np.repeat(['a', 'b'], 12)
    x = rng.normal(size=(24, 3, 60))
    x[:, 1] += np.where(label == 'a', 3.0, 0.0)[:, None]
    np.savez(tmp_path / 'glides.npz', x=x, label=label, rate_hz=60.0)
    return tmp_path / 'glides.npz'


def invoke(*arguments):
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_automatic_features_are_chosen_and_the_runner_up_is_named(bag, tmp_path):
    said = ' '.join(
        invoke(
            *('train', bag, '-o', tmp_path, '--features', 'auto'),
            *('--repetitions', 1, '--folds', 2),
        ).split()
    )
    assert 'chosen inside the folds' in said
    assert 'the runner-up is' in said
    assert 'times the time of training and tests' in said
    model = TactileModel.load(tmp_path / 'texture_flexion.onnx')
    name = model.spec.feature_set
    assert f'texture, flexion: {name} with' in said


def test_a_named_waveform_goes_into_a_model_of_random_convolutions(bag, tmp_path):
    invoke(
        *('train', bag, '-o', tmp_path, '--features', 'glide_waveform', '--classifier', 'rocket'),
        *('--repetitions', 1, '--folds', 2),
    )
    model = TactileModel.load(tmp_path / 'texture_flexion.onnx')
    assert model.spec.feature_set == 'glide_waveform'
    assert model.manifest.classifier == 'rocket'


def test_all_channels_of_an_archive_count(archive):
    def best(channel):
        said = invoke(
            *('evaluate', archive, '--task', 'texture', '--channel', channel, '--json'),
            *('--features', 'glide_waveform', '--folds', 3, '--repetitions', 1),
        )
        (found,) = json.loads(said)['sets']
        scores = {s['classifier']: s['mean'] for s in found['evaluations'][0]['scores']}
        return len(found['features']), scores['rocket']

    assert best('all') == (180, 1.0)
    count, accuracy = best(0)
    assert count == 60
    assert accuracy < 0.9


def test_names_that_are_no_sets_are_refused_by_train(bag, tmp_path):
    done = CliRunner().invoke(app, ['train', str(bag), '-o', str(tmp_path), '--features', 'slope'])
    assert done.exit_code == 2
    assert 'it must be auto or name sets of features: texture_spectrum' in ' '.join(
        done.output.split()
    )


def test_each_set_goes_to_its_phase():
    assert choose_features(None, None, 'glide_waveform,hold_waveform') == {
        'texture_features': 'glide_waveform',
        'stiffness_features': 'hold_waveform',
    }
    over = choose_features('45:0.5', None, 'spatial_waveform')
    assert over['texture_features'] == 'spatial_waveform'
    assert over['spatial_length_m'] == pytest.approx(0.045)
    assert list_sets('slope,correlation') == []
    with pytest.raises(TactileError, match='glide_waveform is none'):
        choose_features('45:0.5', None, 'glide_waveform')


def test_folds_choose_the_set_for_an_archive(tmp_path):
    rng = np.random.default_rng(1)
    label = np.repeat(['low', 'high'], 12)
    x = rng.normal(size=(24, 1, 60)) + np.where(label == 'low', 0.0, 4.0)[:, None, None]
    part, speed = np.tile([1, 2, 3], 8), np.full(24, 15.0)
    archive = tmp_path / 'levels.npz'
    np.savez(archive, x=x, label=label, rate_hz=60.0, part=part, speed_mm_s=speed)
    arguments = ('evaluate', archive, '--task', 'texture', '--features', 'auto')
    more = ('--folds', 3, '--repetitions', 1, '--group', 'part')
    said = ' '.join(invoke(*arguments, *more).split())
    # The level tells them apart, and a spectrum does not have it.
    assert 'texture: glide_waveform with' in said
    assert 'one part held out' in said
    assert 'left out: no features from these trials: texture_spatial needs the' in said
    (found,) = json.loads(invoke(*arguments, *more, '--json'))['sets']
    assert found['title'].endswith('auto: glide_waveform')
    assert len(found['features']) == 60


def test_folds_choose_among_sets_over_the_surface_where_speeds_are_stated(tmp_path):
    rng = np.random.default_rng(2)
    label, speed = np.tile(['a', 'b'], 18), np.repeat([10.0, 15.0, 20.0], 12)
    at_mm = speed[:, None] * np.arange(300) / 60.0
    pitch_mm = np.where(label == 'a', 2.0, 2.6)[:, None]
    x = np.sin(2 * np.pi * at_mm / pitch_mm + rng.uniform(0, 6, (36, 1)))
    archive = tmp_path / 'glides.npz'
    np.savez(archive, x=x[:, None], label=label, rate_hz=60.0, speed_mm_s=speed)
    said = ' '.join(
        invoke(
            *('evaluate', archive, '--task', 'texture', '--features', 'auto', '--over', '40:1'),
            *('--speed-column', 'speed_mm_s', '--group', 'speed_mm_s', '--repetitions', 1),
        ).split()
    )
    assert 'texture: texture_spatial with' in said or 'texture: spatial_waveform with' in said


def test_folds_choose_the_set_for_bags(bag):
    said = ' '.join(
        invoke('evaluate', bag, '--features', 'auto', '--repetitions', 1, '--folds', 2).split()
    )
    assert 'chosen inside the folds' in said
    assert 'the runner-up is' in said
