# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile train` on a small simulated recording of texture."""

import dataclasses

import numpy as np
import pytest
from tactile_command import hear_tactile

from tactile_bags import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_features.spec import spec_for
from tactile_lab.commands.train import parse_seconds, train_models
from tactile_lab.datasets.feature_tables import open_features
from tactile_lab.datasets.reading import Reading
from tactile_lab.datasets.tables import describe_answers
from tactile_lab.output import Output
from tactile_ros.errors import TactileError


def train_on(bag, folder, **training):
    """Train on a bag as the command does; return the models."""
    given = {'folds': 2, 'repetitions': 1, 'output': Output(as_json=True), **training}
    with open_features([bag]) as features:
        return train_models(features, features.tables().tables, folder=folder, **given)


def test_options_that_do_not_fit_are_refused(texture_bag, tmp_path):
    with pytest.raises(TactileError, match='--partial is "1;2"'):
        parse_seconds('1;2')
    over = ('--over', '45:0.5', '--detrend', 'linear')
    said = hear_tactile('train', texture_bag, '-o', tmp_path, *over, code=2)
    assert '--detrend is for the spectrum over time' in said
    with open_features([texture_bag]) as features:
        (table,) = features.tables().tables.values()
        for seconds in ([0.1], [1.0, 0.5], [3.0]):
            with pytest.raises(BagError, match='no early predictions after'):
                features.partial_tables(table, seconds)


def test_model_answers_partial_windows_and_no_file_is_replaced_unasked(texture_bag, tmp_path):
    training = {'false_alarm_rate': 0.1, 'partial_seconds': [0.5, 1.5], 'stop_error_rate': 0.2}
    (trained,) = train_on(texture_bag, tmp_path / 'models', **training)
    model = load_model(trained.path)
    assert model.partial_samples == (30, 90)
    assert model.manifest.false_alarm_rate == 0.1
    assert model.manifest.stop_error_rate == 0.2
    sentences = describe_answers(model.manifest)
    assert 'at 10 % false rejection' in sentences[0]
    assert sentences[-1].startswith('early predictions, accuracy held out: 0.5 s')
    assert trained.to_dict()['parts'][2]['sample_count'] == 90
    before = trained.path.read_bytes()
    with pytest.raises(TactileError, match='would be replaced'):
        train_on(texture_bag, tmp_path / 'models', **training)
    assert trained.path.read_bytes() == before


@pytest.mark.parametrize('detrend', ['none', 'mean', 'linear'])
def test_a_model_states_how_its_spectra_were_detrended(texture_bag, tmp_path, detrend):
    quick = ('--folds', 2, '--repetitions', 1, '--partial', 1, '--classifier', 'knn')
    said = hear_tactile('train', texture_bag, '-o', tmp_path, '--detrend', detrend, *quick)
    assert f'spectrum_detrend {detrend}' in said
    model = load_model(tmp_path / 'texture_flexion.npz')
    with TactileBag(texture_bag) as opened:
        config = dataclasses.replace(
            recorded_features(opened).config, spectrum_detrend=detrend, partial_samples=(30, 60)
        )
        windows = replay_phases(opened, RecordedFeatures(config)).windows
    assert model.spec == spec_for('texture', config)
    assert model.spec.parameters['spectrum_detrend'] == detrend
    others = {'none', 'mean', 'linear'} - {detrend}
    for other in others:
        changed = dataclasses.replace(config, spectrum_detrend=other)
        with pytest.raises(ModelFileError, match='spectrum_detrend'):
            model.check_fits(spec_for('texture', changed))
    # Tables of whole and partial windows are what the live extractor gives.
    with open_features([texture_bag], Reading(detrend=detrend)) as features:
        (table,) = features.tables().tables.values()
        tables = {**features.partial_tables(table, [0.5, 1.0]), table.spec.sample_count: table}
    assert list(tables) == [30, 60, 180]
    assert len(windows) == 3 * len(table)
    for window in windows:
        (row,) = (table.column('window_start_ns') == window.window_start_ns).nonzero()[0]
        assert window.sample_count == 30 or not model.format_mismatch(window)
        assert tables[window.sample_count].values[row].tobytes() == window.values.tobytes()


def test_what_would_give_too_large_a_file_is_refused_before_the_folds(tmp_path):
    rows = np.random.default_rng(1).normal(size=(12, 4, 600))
    labels = ['down', 'up'] * 6
    np.savez(tmp_path / 'wide.npz', x=rows, label=labels, rate_hz=200.0)
    options = ('--task', 'texture', '--channel', 'all', '--features', 'glide_waveform')
    for more in ((), ('--classifier', 'rocket')):
        asked = ('train', tmp_path / 'wide.npz', '-o', tmp_path / 'm', *options, *more)
        said = hear_tactile(*asked, code=2)
        assert (
            '12 trials of 2400 features (glide_waveform) would give a model file of 88 MiB' in said
        )
