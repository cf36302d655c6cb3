# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile evaluate` on archives that were not made for it."""

import numpy as np
import pytest
from tactile_command import ask_and_hear_tactile, ask_tactile, hear_tactile

from tactile_classifier.datasets.archive import load_archive
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_lab.datasets.reading import select_trials
from tactile_ros.errors import TactileError

RATE_HZ = 100.0
CHEAP = ('--task', 'stiffness', '--repetitions', '1', '--folds', '3')


@pytest.fixture
def save(tmp_path):
    """Save holds on two materials in two sessions; the second session is weaker and noisier."""

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


def test_training_on_one_day_and_testing_on_the_other_equals_a_fit_by_hand(save):
    path, _ = save()
    stated = ('--train-where', 'day=2', '--test-where', 'day=1')
    (found,) = ask_tactile('evaluate', path, *CHEAP, *stated)['sets']
    plain, held_out, stated = found['evaluations']
    assert held_out['split'] == 'one day held out'
    assert stated['split'] == 'trained on day=2 (24 trials), tested on day=1'
    assert (plain['trials'], stated['trials']) == (48, 24)
    assert len(stated['scores']) == 8
    for score in stated['scores']:
        # The counts of the confusion are those of the tests, and the interval is over them.
        confusion = np.array(score['confusion'])
        assert confusion.sum() == 24
        assert score['mean'] == pytest.approx(np.trace(confusion) / 24)
        assert score['interval']['low'] <= score['mean'] <= score['interval']['high']
        assert score['interval']['method'].endswith('over 24 trials')
    scores = {(s['classifier'], s['scaling']): s['mean'] for s in stated['scores']}
    table = table_from_trials('stiffness', load_archive(path))
    train = table.column('day') == 2
    values = (table.values - table.values[train].mean(axis=0)) / table.values[train].std(axis=0)
    squared = np.sum((values[~train][:, None] - values[train][None]) ** 2, axis=2)
    nearest = table.labels[train][np.argsort(squared, axis=1)[:, :3]]
    rubber = np.sum(nearest == 'rubber', axis=1) > 1
    expected = np.mean(rubber == (table.labels[~train] == 'rubber'))
    assert 0.5 < expected < 1.0
    assert scores['knn', 'standard'] == pytest.approx(expected)


def test_bad_trials_are_skipped_and_listed_everywhere(save, tmp_path):
    _, x = save()
    x = x.copy()
    x[3] = 5.0
    x[40, 0, 17] = np.nan
    path, _ = save(x=x)
    said = hear_tactile('evaluate', path, *CHEAP, code=2)
    assert '1 of 48 trials' in said
    assert 'row 40' in said
    report = tmp_path / 'report.html'
    options = ('--skip-bad', '--where', 'day=1,2', '--report', report)
    document, said = ask_and_hear_tactile('evaluate', path, *CHEAP, *options)
    (found,) = document['sets']
    for shown in (said, report.read_text()):
        assert 'skipped 2 trials' in shown
        assert 'row 3: the tension is constant' in shown
        assert 'row 40: x in strange.npz is not finite at 1 of 200 samples' in shown
    assert [each['row'] for each in found['skipped']] == [40, 3]
    assert found['trials'] == 46


def test_resampling_and_crop_are_stated(save):
    path, _ = save(length=np.where(np.arange(48) < 2, 190, 200))
    said = hear_tactile('evaluate', path, *CHEAP, '--resample-hz', '60', '--crop', '0.5:1.5')
    assert 'channel 0, at 60 Hz, 0.5 to 1.5 s' in said
    assert 'resampled from 100 to 60 Hz: polyphase filter 3/5' in said
    first_name = ('--static-phase', '0.5:1.5')
    said = hear_tactile('evaluate', path, *CHEAP, *first_name)
    assert 'channel 0, 0.5 to 1.5 s' in said
    assert 'cut to the first 1.9 s' in hear_tactile('evaluate', path, *CHEAP)


def test_columns_select_by_value_by_values_or_by_truth():
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
        'day=north': 'no value of column day',
        'day=4': 'no trial has day=4',
        'place': 'not true or false; write place=VALUE',
        'good=maybe': 'no value of column good',
    }.items():
        with pytest.raises(TactileError, match=sentence):
            select_trials(columns, text, 'where')


def test_one_of_the_two_alone_is_refused(save):
    path, _ = save()
    said = hear_tactile('evaluate', path, *CHEAP, '--train-where', 'day=1', code=2)
    assert 'give both' in said
