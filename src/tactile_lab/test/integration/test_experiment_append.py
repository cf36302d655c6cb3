# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile experiment --append`: a call that is refused changes nothing."""

import pytest
from tactile_command import hear_tactile

from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.plan import ExperimentPlan


@pytest.fixture
def folder(tmp_path):
    folder = ExperimentFolder(tmp_path / 'grooves')
    folder.set_up(ExperimentPlan('grooves', 'texture', ('R1', 'R2'), mountings=1, trials=1))
    folder.open_journal().close()
    return folder


def contents(folder):
    files = (path for path in folder.path.rglob('*') if path.is_file())
    return {path.name: path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--append', 'grooves-s09', '--simulated', '--yes'], 'no session "grooves-s09"'),
        (['--append', 'grooves-s01', '--yes'], '--yes is for --simulated'),
        (['--append', 'grooves-s01'], '--simulated'),
        (['--append', 'grooves-s01', '--guide', '/dev/nothing'], '--tendon'),
        (['--append', 'grooves-s01', '--simulated', '--yes', '--params', '/nowhere'], 'nowhere'),
    ],
)
def test_a_refused_call_changes_nothing(folder, arguments, sentence):
    before = contents(folder)
    for _ in range(2):
        assert sentence in hear_tactile('experiment', folder.path, *arguments, code=2)
        assert contents(folder) == before


def test_a_rig_that_does_not_start_appends_nothing(folder):
    order = folder.read_order()
    models = ('--models', '/nowhere')
    asked = ('experiment', folder.path, '--append', 'grooves-s01', '--simulated', '--yes', *models)
    assert 'nowhere' in hear_tactile(*asked, code=2)
    assert folder.read_order() == order


def test_while_another_program_runs_it_nothing_is_appended(folder):
    before = contents(folder)
    with folder.open_journal():
        said = hear_tactile(
            'experiment', folder.path, '--append', 'grooves-s01', '--simulated', '--yes', code=2
        )
    assert 'another program runs this experiment' in said
    assert contents(folder) == before
