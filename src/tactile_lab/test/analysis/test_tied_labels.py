# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Warnings of tied labels wherever a user looks, and an experiment's folder as recordings."""

import pytest
from tactile_command import ask_and_hear_tactile, ask_tactile

from tactile_bags import EVENT
from tactile_lab.datasets.feature_tables import read_tables
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.plan import ExperimentPlan

KNN = ('--classifier', 'knn')
OPTIONS = ('--folds', '2', '--repetitions', '1')
SENTENCE = 'session and label coincide for 5 of 5 labels'


@pytest.fixture(scope='module')
def tied_bag(stiffness_bag, rewrite, tmp_path_factory):
    """Return a recording in which each label has a session of its own."""

    def change(type_name, message):
        if type_name == EVENT:
            message.session_id = f'day of {message.object_label}'
        return message

    return rewrite(stiffness_bag, tmp_path_factory.mktemp('tied') / 'bag', change)


def test_tied_labels_are_told_in_terminal_json_and_report(tied_bag, tmp_path):
    report = tmp_path / 'report.html'
    asked = ('evaluate', tied_bag, *OPTIONS, '--report', report)
    document, said = ask_and_hear_tactile(*asked)
    assert SENTENCE in said
    assert SENTENCE in report.read_text()
    (found,) = document['sets']
    for evaluation in found['evaluations']:
        assert any(SENTENCE in warning for warning in evaluation['warnings'])


def test_tied_labels_are_told_at_training(tied_bag, tmp_path):
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    document, said = ask_and_hear_tactile('train', tied_bag, '-o', tmp_path, *KNN, *OPTIONS)
    assert SENTENCE in said
    (model,) = document['models']
    assert any(SENTENCE in warning for warning in model['evaluation']['warnings'])


def test_an_experiment_is_read_without_the_trials_that_do_not_count(
    stiffness_bag, rewrite, tmp_path
):
    """And a session and a mounting are held out by themselves."""
    folder = ExperimentFolder(tmp_path / 'soft')
    folder.set_up(ExperimentPlan('soft', 'stiffness', ('pla',)))
    numbers = {}

    def change(type_name, message):
        if type_name == EVENT:
            known = numbers.setdefault(message.object_label, [])
            if message.trial_id not in known:
                known.append(message.trial_id)
            message.session_id = f's{known.index(message.trial_id) % 2}'
            message.mounting_id = f'{message.object_label} {known.index(message.trial_id) % 2}'
        return message

    rewrite(stiffness_bag, folder.bags / 'soft-s01-01', change)
    names = [name for known in zip(*numbers.values(), strict=True) for name in known]
    failed = names[-1]
    with folder.open_journal() as journal:
        for name in names:
            journal.append('began', key=name, trial_id=name, mounting_id='m')
            verdict = 'failed' if name == failed else 'good'
            values = {'verdict': verdict, 'sentence': '', 'statistics': {}, 'seconds': 1.0}
            journal.append('ended', trial_id=name, **values)
    found = read_tables(folder.list_bags())
    (table,) = found.tables.values()
    assert table.column('trial_id').tolist() == names[:-1]
    assert f'{failed}: another attempt counts (failed)' in found.left_out
    (evaluated,) = ask_tactile('evaluate', folder.path, *OPTIONS)['sets']
    assert [evaluation['split'] for evaluation in evaluated['evaluations']][1:] == [
        'one session held out',
        'one mounting held out',
    ]
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    (model,) = ask_tactile('train', folder.path, '-o', tmp_path / 'models', *KNN, *OPTIONS)[
        'models'
    ]
    assert model['evaluation']['trials'] == evaluated['trials'] == 14
