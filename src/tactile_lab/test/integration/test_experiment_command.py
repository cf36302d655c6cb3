# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile experiment` without a rig: refused calls change nothing; corrections are listed."""

import io

import pytest
from tactile_command import ask_tactile, hear_tactile, tactile

from tactile_classifier.confidence.held_out_novelty import trials_needed
from tactile_classifier.errors import TooFewTrialsError
from tactile_classifier.estimators.classifiers import NearestNeighbours
from tactile_lab.commands.experiment import LEAST_FOR_UNKNOWN, LEAST_TO_TRAIN
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.loop import Terminal
from tactile_lab.experiment.plan import ExperimentPlan
from tactile_lab.output import Output


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
        (['--append', 'grooves-s01', '--yes'], '--yes requires --simulated'),
        (['--append', 'grooves-s01'], '--simulated'),
        (['--append', 'grooves-s01', '--guide', '/dev/nothing'], '--tendon'),
        (['--append', 'grooves-s01', '--simulated', '--yes', '--params', '/nowhere'], 'nowhere'),
    ],
)
def test_a_refused_call_changes_nothing(folder, arguments, sentence):
    before = contents(folder)
    for _ in range(2):
        assert hear_tactile('experiment', folder.path, *arguments, code=2).count(sentence) == 1
        assert contents(folder) == before


def test_no_block_is_appended_if_the_rig_does_not_start(folder, parameter_file):
    order = folder.read_order()
    wrong = parameter_file('tendon_sensor: {ros__parameters: {unit: furlong}}')
    for options in (('--models', '/nowhere'), ('--params', wrong)):
        asked = ('--append', 'grooves-s01', '--simulated', '--yes', *options)
        said = hear_tactile('experiment', folder.path, *asked, code=2)
        assert 'nowhere' in said or 'tendon_sensor could not be started' in said
        assert folder.read_order() == order


def test_no_block_is_appended_while_another_program_runs_the_experiment(folder):
    before = contents(folder)
    with folder.open_journal():
        said = hear_tactile(
            'experiment', folder.path, '--append', 'grooves-s01', '--simulated', '--yes', code=2
        )
    assert 'another program is running this experiment' in said
    assert contents(folder) == before


def test_unknown_object_of_a_simulated_rig_is_refused_before_the_folder_is_created(tmp_path):
    plan = tmp_path / 'new.yaml'
    said = hear_tactile('experiment', 'new', plan, '--objects', 'R1,pla', code=2)
    assert 'pla is for stiffness trials' in said
    assert '--protocol stiffness' in said
    assert not plan.exists()
    said = hear_tactile('experiment', 'new', plan, '--objects', 'R1,oak')
    assert 'oak: only for a real rig' in said
    assert "unknown texture plate 'oak'" in hear_tactile(
        'experiment', plan, '--simulated', '--yes', code=2
    )
    assert not plan.with_suffix('').exists()


@pytest.mark.parametrize(
    ('sizes', 'words'),
    [
        ('--sessions 2 --mountings 2 --trials 5', ['Training trials: 40 in', '20 if a session']),
        (
            '--sessions 2 --mountings 1 --trials 1',
            ['Training trials: 4 in', '2 if a session', 'too few'],
        ),
        (
            '--sessions 1 --mountings 1 --trials 2',
            ['Training trials: 4 in', '3 if a trial', 'one session'],
        ),
    ],
)
def test_new_plan_states_how_many_trials_training_needs(tmp_path, sizes, words):
    plan = tmp_path / 'new.yaml'
    contacts = ('--contacts', 'flexion,abduction')
    said = hear_tactile('experiment', 'new', plan, '--objects', 'R1,R2', *contacts, *sizes.split())
    assert ('1 mounting x' in said) == ('--mountings 1' in sizes)
    for word in (*words, 'At least 3 trials', 'needs 19 trials'):
        assert word in said
    assert ('too few' in said) == ('too few' in words)


def test_required_numbers_of_trials_equal_those_of_training():
    assert trials_needed(0.05) == LEAST_FOR_UNKNOWN
    with pytest.raises(TooFewTrialsError):
        NearestNeighbours(LEAST_TO_TRAIN).fit([[0.0]] * (LEAST_TO_TRAIN - 1), ['a', 'b'])


def test_corrections_are_written_and_listed(folder):
    first, *_ = (trial.key for trial in folder.read_order())
    with folder.open_journal() as journal:
        journal.append('began', key=first, trial_id=first, mounting_id='m')
        journal.append(
            'ended', trial_id=first, verdict='good', sentence='', statistics={}, seconds=1
        )

    def correct(*arguments, code=0):
        return hear_tactile('experiment', *arguments, '--why', 'the wrong [plate]', code=code)

    assert f'{first} relabelled R2: ' in correct('relabel', folder.path, first, 'R2')
    assert f'{first} excluded' in correct('exclude', folder.path, first)
    listed = hear_tactile('experiment', 'status', folder.path)
    assert f'{first} was relabelled R2: the wrong [plate]' in listed
    assert f'{first} was excluded: the wrong [plate]' in listed
    lines = tactile('experiment', 'status', folder.path).stdout.splitlines()
    assert [each.split() for each in lines if each.split()[:2] == [first, 'R2']] == [
        [first, 'R2', 'flexion', first.rpartition('-m')[0], 'excluded']
    ]
    found = ask_tactile('experiment', 'status', folder.path)
    assert (found['done'], found['excluded'], found['relabelled']) == (1, 1, 1)
    correct('include', folder.path, first)
    assert 'excluded' not in hear_tactile('experiment', 'status', folder.path)
    before = contents(folder)
    assert f'did you mean {first}' in correct('exclude', folder.path, f'{first}x', code=2)
    assert 'is not an object' in correct('relabel', folder.path, first, 'R9', code=2)
    assert 'not the folder of' in correct('include', folder.path.parent, first, code=2)
    assert contents(folder) == before


def test_changed_setup_ends_the_command_if_there_is_no_terminal(monkeypatch, capsys):
    monkeypatch.setattr('sys.stdin', io.StringIO('y\n'))
    person = Terminal(Output(as_json=False))
    assert not person.accept_setup(['tendon_sensor.scale: 1.0 -> 1.1'])
    assert person.has_given_up
    assert Terminal(Output(as_json=False), True).accept_setup(['a: 1 -> 2'])
    said = capsys.readouterr().out
    for part in ('tendon_sensor.scale: 1.0 -> 1.1', '--accept-setup', 'a: 1 -> 2'):
        assert part in said
    monkeypatch.setattr('sys.stdin', io.StringIO('y\nno\n'))
    monkeypatch.setattr('sys.stdin.isatty', lambda: True)
    person = Terminal(Output(as_json=False))
    assert person.accept_setup(['a: 1 -> 2'])
    assert not person.accept_setup(['a: 1 -> 2'])
    assert not person.has_given_up
