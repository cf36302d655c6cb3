# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile show` prints the contents of files."""

import re

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile, tactile

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def show(path, *options):
    return ask_tactile('show', path, *options)


def refusal(path, *options):
    return hear_tactile('show', path, *options, code=2)


def test_bag_lists_its_trials_and_draws_one(stiffness_bag, tmp_path):
    picture = tmp_path / 'trial.svg'
    found = show(stiffness_bag, '--plot', picture, '--trial', 4)
    assert found['kind'] == 'bag'
    assert [entry['trial'] for entry in found['trials']] == list(range(1, 16))
    assert len({entry['object'] for entry in found['trials']}) == 5
    assert found['facts']['simulated'] == 'SIMULATED'
    assert all(entry['seconds'] > 1.0 for entry in found['trials'])
    facts = list(found['facts'])
    assert facts[:4] == ['trials', 'task', 'rate', 'duration']
    assert [found['facts'][name] for name in facts[:3]] == ['15', 'stiffness', '60 Hz']
    # The duration of the recording includes the time between trials.
    total_s = sum(entry['seconds'] for entry in found['trials'])
    assert float(found['facts']['duration'].split()[0]) > total_s
    said = hear_tactile('show', stiffness_bag)
    assert '/tendon_sensor/strain' not in said
    assert 'None' not in said
    listed = tactile('show', stiffness_bag, '--topics').stdout
    assert re.search(r'^/tendon_sensor/strain +90 +tactile_msgs/msg/StrainBlock$', listed, re.M)
    assert all(entry['trial_id'] in said for entry in found['trials'])
    assert picture.read_text().startswith('<?xml')
    said = refusal(stiffness_bag, '--plot', picture, '--trial', 16)
    assert '15 trials, so there is no trial 16' in said


def test_folder_of_models_or_bags_names_one_of_them(tmp_path):
    (tmp_path / 'a.npz').touch()
    assert re.search(r'folder of 1 recordings or models; name one, .*a\.npz', refusal(tmp_path))


def test_archive_of_one_trial_is_enough(tmp_path):
    path, picture = tmp_path / 'one.npz', tmp_path / 'one.png'
    np.savez(path, x=np.sin(np.arange(300.0))[None, None], label=np.array(['R1']), rate_hz=100.0)
    found = show(path, '--plot', picture)
    assert found['facts']['trials'] == '1'
    assert found['facts']['length'] == '3 to 3 s'
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert 'must end in .png, .svg or .pdf' in refusal(path, '--plot', tmp_path / 'one.txt')


def test_trial_numbers_equal_those_of_plot_and_columns_are_hidden_if_necessary(tmp_path):
    path = tmp_path / 'two.npz'
    x = np.sin(np.arange(600.0)).reshape(2, 1, 300)
    columns = {'label': ['R1', 'C1'], 'trial': ['lab/07.csv', 'lab/03.csv'], 'day': [2, 2]}
    np.savez(path, x=x, rate_hz=100.0, **columns)
    found = show(path)['trials']
    assert [entry['trial'] for entry in found] == [1, 2]
    assert [entry['column trial'] for entry in found] == ['lab/07.csv', 'lab/03.csv']
    printed = tactile('show', path).stdout
    assert 'lab/07.csv' in printed
    assert 'all trials: seconds 3.00, day 2' in printed


@pytest.mark.parametrize('sessions', [1, 3])
def test_model_has_a_card_with_its_limits(tmp_path, sessions):
    generator = np.random.default_rng(2)
    code = np.repeat(np.arange(2), 36)
    values = code[:, None] + generator.normal(0.0, 0.1, (72, 3))
    spec = spec_for('stiffness', FeatureConfig())
    columns = {'session_id': np.array([f's{i % sessions}' for i in range(72)])}
    table = FeatureTable(values, np.array(['pla', 'sponge'])[code], spec, columns)
    path = tmp_path / 'model.npz'
    manifest = write_model(path, train(table, 'knn')).manifest
    found = show(path)
    facts = found['facts']
    assert facts['answers'] == 'stiffness, any contact: pla, sponge'
    plural = 's' * (sessions > 1)
    assert facts['trained on'].startswith(f'72 measured trials, {sessions} session{plural},')
    error = f'{100 * manifest.confidence.calibration_error_after:.1f} % after'
    assert error in facts['calibration error']
    assert any('No sessions' in limit for limit in found['limits']) == (sessions == 1)
    # The command prints the model card that is stored in the model file.
    assert found['card'] == load_model(path).card
    printed = tactile('show', path).stdout
    assert found['card'].strip() in printed
    assert found['model_id'] in printed


def test_model_card_is_printed_as_text_and_not_as_markup(tmp_path):
    labels = np.repeat(['[red]pla[/red]', '[link=x]sponge'], 36)
    values = np.random.default_rng(2).normal(size=(72, 3)) + (labels == labels[0])[:, None]
    spec = spec_for('stiffness', FeatureConfig())
    path = tmp_path / 'model.npz'
    write_model(path, train(FeatureTable(values, labels, spec), 'knn'))
    assert 'any contact: [link=x]sponge, [red]pla[/red]' in tactile('show', path).stdout


def test_names_are_printed_without_markup_and_control_characters(tmp_path):
    path = tmp_path / '[red] a :rat:.npz'
    x = np.random.default_rng(0).normal(size=(8, 60))
    labels = ['[/b]', '\x1b[2J'] * 4
    np.savez(path, x=x, label=labels, rate_hz=60.0, place=[':rat:', '[red]x'] * 4)
    said = hear_tactile('show', path)
    assert said.isprintable()
    for name in (path.name, '[/b]', '?[2J', ':rat:', '[red]x'):
        assert name in said
    asked = ('evaluate', path, '--task', 'texture', '--where', '\x1b]0;' + 'x' * 100_000)
    refused = hear_tactile(*asked, code=2)
    assert refused.isprintable()
    assert len(refused) < 5_000
