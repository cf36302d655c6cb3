# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile evaluate` on archives and experiments: splits, bad trials and messages."""

import numpy as np
import pytest
from tactile_command import ask_and_hear_tactile, ask_tactile, hear_tactile

from tactile_analysis.trial_set import select_trials
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.plan import ExperimentPlan
from tactile_ros.errors import TactileError
from tactile_ros.topics import EVENT
from tactile_testing.recordings import Archive

pytestmark = pytest.mark.usefixtures('few_convolutions')

RATE_HZ = 100.0
ONCE = ('--repetitions', 1)
HOLDS = ('--task', 'stiffness', '--folds', 3, *ONCE)


@pytest.fixture
def save(tmp_path):
    """Return a function that saves holds on two materials in two sessions.

    The second session has a smaller signal and more noise.
    """

    def save(**changes):
        rng = np.random.default_rng(5)
        label = np.tile([b'rubber', b'pla'], 24)
        day = np.repeat([1, 2], 24)
        time_s = np.arange(200) / RATE_HZ
        slope = np.where(label == b'rubber', -0.9, -0.5) * np.where(day == 1, 1.0, 0.7)
        x = 5.0 + slope[:, None] * time_s + rng.normal(0.0, 0.2, (48, 200))
        arrays = {'x': x[:, None], 'label': label, 'rate_hz': RATE_HZ, 'day': day, **changes}
        path = tmp_path / 'strange.npz'
        np.savez(path, **arrays)
        return path, arrays['x']

    return save


def test_accuracy_on_selected_test_trials_equals_scikit_learn(save):
    path, _ = save()
    said = hear_tactile('evaluate', path, *HOLDS, '--train-where', 'day=1', code=2)
    assert 'must be given together' in said
    stated = ('--train-where', 'day=2', '--test-where', 'day=1')
    (found,) = ask_tactile('evaluate', path, *HOLDS, *stated)['sets']
    plain, held_out, stated = found['evaluations']
    assert held_out['split'] == 'one day held out'
    assert stated['split'] == 'trained on day=2 (24 trials), tested on day=1'
    assert (plain['trials'], stated['trials']) == (48, 24)
    assert len(stated['scores']) == 8
    for score in stated['scores']:
        # Confusion matrix and interval are computed over the test trials.
        confusion = np.array(score['confusion'])
        assert confusion.sum() == 24
        assert score['mean'] == pytest.approx(np.trace(confusion) / 24)
        assert score['interval']['low'] <= score['mean'] <= score['interval']['high']
        assert score['interval']['method'].endswith('over 24 trials')
    scores = {(s['classifier'], s['scaling']): s['mean'] for s in stated['scores']}
    archive = Archive(path)
    table = table_from_trials(
        'stiffness', archive.x, archive.label, archive.rate_hz, columns=archive.columns
    )
    train = table.column('day') == 2
    values = (table.values - table.values[train].mean(axis=0)) / table.values[train].std(axis=0)
    squared = np.sum((values[~train][:, None] - values[train][None]) ** 2, axis=2)
    nearest = table.labels[train][np.argsort(squared, axis=1)[:, :3]]
    rubber = np.sum(nearest == 'rubber', axis=1) > 1
    expected = np.mean(rubber == (table.labels[~train] == 'rubber'))
    assert 0.5 < expected < 1.0
    assert scores['knn', 'standard'] == pytest.approx(expected)


def test_unusable_trials_are_skipped_and_listed_everywhere(save, tmp_path):
    _, x = save()
    x = x.copy()
    x[3, 0, 5] = np.inf
    x[40, 0, 17] = np.nan
    path, _ = save(x=x)
    said = hear_tactile('evaluate', path, *HOLDS, code=2)
    assert '2 of 48 trials' in said
    assert 'trial 3' in said
    report = tmp_path / 'report.html'
    options = ('--skip-bad', '--where', 'day=1,2', '--report', report)
    document, said = ask_and_hear_tactile('evaluate', path, *HOLDS, *options)
    (found,) = document['sets']
    for shown in (said, report.read_text()):
        assert 'skipped trials: 2' in shown
        assert 'trial 3: channel channel_0 ' in shown
        assert 'trial 40: channel channel_0 ' in shown
        assert '1 of 200' in shown
    assert [each.split(':')[0] for each in found['skipped']] == ['trial 3', 'trial 40']
    assert found['trials'] == 46


def test_resampling_and_crop_are_stated(save):
    path, _ = save(length=np.where(np.arange(48) < 2, 190, 200))
    said = hear_tactile('evaluate', path, *HOLDS, '--resample-hz', '60', '--crop', '0.5:1.5')
    assert 'strange.npz, at 60 Hz, 0.5 to 1.5 s' in said
    assert 'resampled from 100 to 60 Hz: polyphase filter 3/5' in said
    said = hear_tactile('evaluate', path, *HOLDS, '--crop', '0.5:1.5')
    assert 'strange.npz, 0.5 to 1.5 s' in said
    assert 'cut to the first 1.9 s' in hear_tactile('evaluate', path, *HOLDS)


def test_where_selects_by_value_by_values_or_by_boolean():
    columns = {
        'day': np.array([1, 2, 3]),
        'good': np.array([True, False, True]),
        'place': np.array(['a', 'b', 'b']),
        'speed': np.array([0.5, 1.0, 2.0]),
    }
    for text, expected in {
        'day=1,3': [1, 0, 1],
        'good': [1, 0, 1],
        'good=false': [0, 1, 0],
        'place=b': [0, 1, 1],
        'speed=1': [0, 1, 0],
    }.items():
        assert select_trials(columns, text, 'where').tolist() == [bool(e) for e in expected]
    for text, sentence in {
        'night': '--where: there is no column "night"; there are: day',
        'day=north': 'not a valid value of column day',
        'day=4': 'no trial has day=4',
        'place': 'not boolean; write place=VALUE',
        'good=maybe': 'not a valid value of column good',
    }.items():
        with pytest.raises(TactileError, match=sentence):
            select_trials(columns, text, 'where')


def splits_of(found):
    return [evaluation['split'] for evaluation in found['evaluations']]


def test_experiment_with_few_mountings_is_evaluated(simulate_bag, rewrite, tmp_path):
    """The experiment has one session of two objects, each mounted twice.

    If one mounting is held out, some inner folds have only one object in the training.
    """
    objects = ('pla', 'sponge')
    trials = {}

    def mount_twice(type_name, message):
        if type_name != EVENT:
            return message
        if message.object_label not in objects:
            return None
        of_it = trials.setdefault(message.object_label, [])
        if message.trial_id not in of_it:
            of_it.append(message.trial_id)
        message.mounting_id = f'{message.object_label}-{of_it.index(message.trial_id) // 2}'
        return message

    folder = ExperimentFolder(tmp_path / 'holds')
    folder.set_up(ExperimentPlan('holds', 'stiffness', objects, sessions=1, mountings=2, trials=2))
    bag = simulate_bag('stiffness', 'flexion', 4, seed=7)
    rewrite(bag, folder.bags / 'holds-s01-01', mount_twice)
    document, said = ask_and_hear_tactile('evaluate', folder.path, '--folds', 4, *ONCE)
    (found,) = document['sets']
    assert splits_of(found) == [
        'stratified 4-fold, once', 'one block of trials held out', 'one mounting held out'
    ]  # fmt: skip
    (told,) = (each for each in found['not_done'] if each.startswith('one session held out: '))
    assert told in said
    assert 'same session' in told


def save_levels(path, **columns):
    label = np.tile(['low', 'high'], 6)
    x = np.random.default_rng(1).normal(size=(12, 60)) + (label == 'low')[:, None]
    np.savez(path, x=x, label=label, rate_hz=60.0, **columns)
    return path, '--task', 'texture', *ONCE


@pytest.mark.parametrize(
    ('options', 'splits', 'told'),
    [
        (
            ('--group', 'day', '--group', 'part'),
            ['stratified 6-fold, once', 'one part held out'],
            'one day held out: all trials of class "high" have the same day',
        ),
    ],
)
def test_impossible_splits_are_reported_beside_possible_ones(tmp_path, options, splits, told):
    day = np.where(np.arange(12) % 2, 'monday', 'tuesday')  # a day per label
    asked = save_levels(tmp_path / 'x.npz', day=day, part=np.arange(12) // 4)
    document, said = ask_and_hear_tactile('evaluate', *asked, *options)
    (found,) = document['sets']
    assert splits_of(found) == splits
    assert found['not_done'][0].startswith(told)
    assert told in said


def test_no_possible_split_is_one_sentence(tmp_path):
    label = np.repeat(['a', 'b'], [11, 1])
    x = np.random.default_rng(1).normal(size=(12, 60))
    np.savez(tmp_path / 'few.npz', x=x, label=label, rate_hz=60.0)
    said = hear_tactile('evaluate', tmp_path / 'few.npz', '--task', 'texture', *ONCE, code=2)
    assert 'class "b" has only one trial' in said


def test_groups_that_are_too_small_for_a_choice_select_the_most_robust_candidate(tmp_path):
    # Each of the three groups has one trial per label, so few trials remain in the inner folds.
    label, part = np.tile(['a', 'b'], 3), np.repeat([0, 1, 2], 2)
    x = np.random.default_rng(1).normal(size=(6, 60))
    np.savez(tmp_path / 'few.npz', x=x, label=label, rate_hz=60.0, part=part)
    asked = (tmp_path / 'few.npz', '--task', 'texture', *ONCE, '--folds', 2, '--group', 'part')
    document, said = ask_and_hear_tactile('evaluate', *asked)
    (found,) = document['sets']
    (pick,) = found['feature_choice']['picks']
    assert (pick['classifier'], pick['folds']) == ('rocket', 3)
    assert '3 groups are too few for a choice by accuracy' in said


def test_candidate_that_cannot_be_fitted_is_omitted_with_one_line(tmp_path):
    x = np.random.default_rng(0).normal(size=(16, 6))  # too short for random convolutions
    np.savez(tmp_path / 'short.npz', x=x, label=['a', 'b'] * 8, rate_hz=50.0)
    said = hear_tactile('evaluate', tmp_path / 'short.npz', '--task', 'texture', *ONCE)
    assert said.count('glide_waveform, rocket, none left out: ') == 1
    assert 'Model: texture_spectrum with' in said


def test_labels_that_coincide_with_sessions_are_reported(stiffness_bag, rewrite, tmp_path):
    def change(type_name, message):
        if type_name == EVENT:
            message.session_id = f'day of {message.object_label}'
        return message

    bag = rewrite(stiffness_bag, tmp_path / 'bag', change)
    sentence = 'session and label coincide for 5 of 5 labels'
    quick = ('--folds', 2, *ONCE)
    document, said = ask_and_hear_tactile('evaluate', bag, *quick)
    assert sentence in said
    for evaluation in document['sets'][0]['evaluations']:
        assert any(sentence in warning for warning in evaluation['warnings'])
    options = ('-o', tmp_path / 'models', '--classifier', 'knn')
    document, said = ask_and_hear_tactile('train', bag, *options, *quick)
    assert sentence in said
    (model,) = document['models']
    assert any(sentence in warning for warning in model['evaluation']['warnings'])
