# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What `tactile show` says must be what is in the file."""

import json

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_lab.commands.show import run_show
from tactile_ros.errors import TactileError


def show(capsys, path, plot=None, trial=1):
    run_show(path, plot, trial, as_json=True)
    return json.loads(capsys.readouterr().out)


def test_bag_lists_its_trials_and_draws_one(stiffness_bag, tmp_path, capsys):
    picture = tmp_path / 'trial.svg'
    found = show(capsys, stiffness_bag, picture, 4)
    assert found['kind'] == 'bag'
    assert [entry['trial'] for entry in found['trials']] == list(range(1, 16))
    assert len({entry['object'] for entry in found['trials']}) == 5
    assert found['facts']['simulated'] == 'SIMULATED'
    assert all(entry['seconds'] > 1.0 for entry in found['trials'])
    assert picture.read_text().startswith('<?xml')
    with pytest.raises(TactileError, match='15 trials, so there is no trial 16'):
        run_show(stiffness_bag, picture, 16, as_json=True)


def test_archive_of_one_trial_is_enough(tmp_path, capsys):
    path, picture = tmp_path / 'one.npz', tmp_path / 'one.png'
    np.savez(path, x=np.sin(np.arange(300.0))[None, None], label=np.array(['R1']), rate_hz=100.0)
    found = show(capsys, path, picture)
    assert found['facts']['trials'] == '1'
    assert found['facts']['length'] == '3 to 3 s'
    assert picture.read_bytes().startswith(b'\x89PNG')
    with pytest.raises(TactileError, match='must end in one of'):
        run_show(path, tmp_path / 'one.txt', 1, as_json=True)


@pytest.mark.parametrize('sessions', [1, 3])
def test_model_has_a_card_with_its_limits(tmp_path, capsys, sessions):
    generator = np.random.default_rng(2)
    code = np.repeat(np.arange(2), 36)
    values = code[:, None] + generator.normal(0.0, 0.1, (72, 3))
    spec = spec_for('stiffness', FeatureConfig())
    columns = {'session_id': np.array([f's{i % sessions}' for i in range(72)])}
    table = FeatureTable(values, np.array(['pla', 'sponge'])[code], spec, columns)
    path = tmp_path / 'model.onnx'
    manifest = write_model(path, train(table, 'knn')).manifest
    facts = show(capsys, path)['facts']
    assert facts['answers'] == 'stiffness, any contact: pla, sponge'
    assert facts['trained on'].startswith('72 trials')
    assert (
        f'{100 * manifest.parts[0].calibration_error_after:.1f} % after'
        in (facts['calibration error'])
    )
    assert ('no session was held out' in facts['limits']) == (sessions == 1)
