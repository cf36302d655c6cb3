# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Splits that the trials do not allow are left out and told; the others are evaluated."""

import numpy as np
import pytest
from tactile_command import ask_and_hear_tactile, ask_tactile, hear_tactile

from tactile_bags import EVENT
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.plan import ExperimentPlan

QUICK = ('--repetitions', 1)


@pytest.fixture(scope='module')
def experiment(simulate_bag, rewrite, tmp_path_factory):
    """Return a finished experiment: one session of two objects, each mounted twice."""
    objects = ('pla', 'sponge')
    bag = simulate_bag('stiffness', 'flexion', 4, seed=7)
    trials = {}

    def mount_twice(type_name, message):
        if type_name != EVENT:
            return message
        if message.object_label not in objects:
            return None
        of_it = trials.setdefault(message.object_label, [])
        if message.trial_id not in of_it:
            of_it.append(message.trial_id)
        number = of_it.index(message.trial_id) // 2
        message.mounting_id = f'{message.object_label}-{number}'
        return message

    folder = ExperimentFolder(tmp_path_factory.mktemp('experiments') / 'holds')
    folder.set_up(ExperimentPlan('holds', 'stiffness', objects, sessions=1, mountings=2, trials=2))
    rewrite(bag, folder.bags / 'holds-s01-01', mount_twice)
    assert [len(each) for each in trials.values()] == [4, 4]
    return folder.path


def test_a_finished_experiment_is_evaluated_whatever_its_mountings(experiment, tmp_path):
    # With one mounting held out, some folds inside the fold would train on one object alone.
    report = tmp_path / 'report.html'
    asked = ('evaluate', experiment, '--folds', 4, *QUICK, '--report', report)
    document, said = ask_and_hear_tactile(*asked)
    (found,) = document['sets']
    splits = [evaluation['split'] for evaluation in found['evaluations']]
    assert splits == [
        'stratified 4-fold, once', 'one block of trials held out', 'one mounting held out'
    ]  # fmt: skip
    told = 'one session held out: all trials have the same session: there is nothing to hold out'
    assert told in found['not_done']
    assert told in report.read_text(encoding='utf-8')
    assert told in said


def test_random_folds_that_cannot_be_made_leave_the_others(experiment):
    document, said = ask_and_hear_tactile('evaluate', experiment, '--folds', 5, *QUICK)
    (found,) = document['sets']
    told = 'random folds: class "pla" has 4 trials, fewer than the 5 folds'
    assert told in said
    assert told in str(found['not_done'])
    splits = [evaluation['split'] for evaluation in found['evaluations']]
    assert splits == ['one block of trials held out', 'one mounting held out']


def save_levels(path, **columns):
    label = np.tile(['low', 'high'], 6)
    x = np.random.default_rng(1).normal(size=(12, 60)) + (label == 'low')[:, None]
    np.savez(path, x=x, label=label, rate_hz=60.0, **columns)
    return path, '--task', 'texture', *QUICK


def test_groups_that_cannot_be_held_out_are_told_beside_those_that_can(tmp_path):
    day = np.where(np.arange(12) % 2, 'monday', 'tuesday')  # and label coincide
    asked = save_levels(tmp_path / 'x.npz', day=day, part=np.arange(12) // 4)
    (found,) = ask_tactile('evaluate', *asked, '--group', 'day', '--group', 'part')['sets']
    splits = [evaluation['split'] for evaluation in found['evaluations']]
    assert splits == ['stratified 6-fold, once', 'one part held out']
    assert found['not_done'][0].startswith(
        'one day held out: all trials of class "high" have the same day'
    )


def test_no_possible_split_is_one_sentence(tmp_path):
    label = np.repeat(['a', 'b'], [10, 2])
    x = np.random.default_rng(1).normal(size=(12, 60))
    np.savez(tmp_path / 'few.npz', x=x, label=label, rate_hz=60.0)
    said = hear_tactile('evaluate', tmp_path / 'few.npz', '--task', 'texture', *QUICK, code=2)
    assert 'random folds: class "b" has 2 trials, fewer than the 6 folds' in said


def test_a_choice_inside_the_folds_that_cannot_be_made_is_told(tmp_path):
    # Three groups of one trial of each class and no more: two trials are left inside a fold.
    label, part = np.tile(['a', 'b'], 3), np.repeat([0, 1, 2], 2)
    x = np.random.default_rng(1).normal(size=(6, 60))
    np.savez(tmp_path / 'few.npz', x=x, label=label, rate_hz=60.0, part=part)
    asked = (tmp_path / 'few.npz', '--task', 'texture', *QUICK, '--folds', 2, '--group', 'part')
    (found,) = ask_tactile('evaluate', *asked)['sets']
    told = 'choice of the classifier inside the folds, one part held out: 2 trials would be left'
    assert any(line.startswith(told) for line in found['not_done'])
