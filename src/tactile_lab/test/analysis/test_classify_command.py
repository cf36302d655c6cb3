# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile classify`: classification of new recordings without labels."""

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile

from tactile_analysis import TrialSet
from tactile_analysis.datasets.classified import classify_recording
from tactile_analysis.options import SourceError
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train

RATE_HZ = 60.0
LABELS = ('fine', 'middle', 'coarse')


def make_rows(labels, samples=120, seed=0):
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) / RATE_HZ
    tones = [4.0 * (1 + LABELS.index(label)) for label in labels]
    rows = [np.sin(2 * np.pi * (tone * time_s + rng.random())) for tone in tones]
    return 3.0 + np.array(rows) + 0.05 * rng.normal(size=(len(labels), samples))


@pytest.fixture(scope='module')
def model(tmp_path_factory):
    label = np.repeat(LABELS, 20)
    table = table_from_trials('texture', make_rows(label)[:, None], label, RATE_HZ, unit='N')
    path = tmp_path_factory.mktemp('models') / 'texture.npz'
    write_model(path, train(table, 'knn'))
    return path


def write_table(path, labels, samples=120, *, rate_hz=RATE_HZ, with_label=False, unit='N'):
    """Write trials as one table, as other software does."""
    lines = [f'{"label," if with_label else ""}trial,time_s,force_{unit}']
    for number, (label, row) in enumerate(zip(labels, make_rows(labels, samples, 5), strict=True)):
        named = f'{label},' if with_label else ''
        lines += [f'{named}{number},{i / rate_hz},{v}' for i, v in enumerate(row.tolist())]
    path.write_text('\n'.join(lines))
    return path


def answers_of(found):
    return [each['answer'] for each in found['trials']]


@pytest.mark.parametrize('kind', ['table', 'archive', 'files', 'arrays'])
def test_recordings_without_labels_are_classified(model, tmp_path, kind):
    labels = ['coarse', 'fine', 'middle', 'fine']
    paths = [tmp_path / 'new.npz']
    if kind == 'table':
        paths = [write_table(tmp_path / 'new.csv', labels)]
    elif kind == 'archive':
        np.savez(paths[0], x=make_rows(labels, seed=5), rate_hz=RATE_HZ)
    elif kind == 'files':
        paths = [write_table(tmp_path / f'{i}.csv', [name]) for i, name in enumerate(labels)]
    else:
        paths = [tmp_path / f'{i}.npy' for i in range(4)]
        for path, row in zip(paths, make_rows(labels, seed=5), strict=True):
            np.save(path, row)
    options = ['--rate-hz', 60] if kind == 'arrays' else []
    found = ask_tactile('classify', *paths, '--model', model, *options)
    assert answers_of(found) == labels
    assert found['with_known_label'] == 0
    for each in found['trials']:
        assert each['label'] is None
        assert sum(each['probabilities'].values()) == pytest.approx(1.0)
        assert 0.0 < each['p_value'] <= 1.0
    said = hear_tactile('classify', *paths, '--model', model, *options)
    assert 'coarse' in said


def test_recording_without_labels_is_loaded(model, tmp_path):
    path = write_table(tmp_path / 'new.csv', ['fine'])
    text = path.read_text().replace('trial,', 'material,').replace('\n0,', '\nsilk,')
    path.write_text(text)
    loaded = load_model(model)
    with TrialSet.load(path) as recording:
        (trial,) = recording.trials
        assert trial.label == ''
        assert loaded.classify(trial.signal.values, trial.signal.rate_hz).label == 'fine'
        with pytest.raises(SourceError, match='--label-column material'):
            recording.windows()


def test_long_trials_are_cut_and_short_ones_are_not_classified(model, tmp_path):
    path = write_table(tmp_path / 'long.csv', ['fine', 'coarse'], 200, with_label=True)
    found = ask_tactile('classify', path, '--model', model)
    assert answers_of(found) == ['fine', 'coarse']
    assert (found['right'], found['with_known_label']) == (2, 2)
    short = write_table(tmp_path / 'short.csv', ['fine'], 100)
    said = hear_tactile('classify', short, '--model', model, code=2)
    assert '100 samples' in said
    both = ask_tactile('classify', path, short, '--model', model, '--label', 'fine')
    assert [each['answer'] for each in both['trials']] == ['fine', 'coarse', 'no answer']
    assert both['trials'][2]['reason']


def test_rate_unit_and_task_must_match_the_model(model, tmp_path):
    path = write_table(tmp_path / 'fast.csv', ['fine'], 240, rate_hz=120.0)
    said = hear_tactile('classify', path, '--model', model, code=2)
    assert '120 Hz' in said
    assert '60 Hz' in said
    assert '--resample-hz' in said
    volts = write_table(tmp_path / 'volts.csv', ['fine'], unit='V')
    assert 'trained on signals in N, but the recording is in V' in hear_tactile(
        'classify', volts, '--model', model, code=2
    )
    label = np.repeat(['soft', 'hard'], 10)
    rng = np.random.default_rng(2)
    ramps = rng.normal(size=(20, 1, 120)) + np.where(label == 'hard', 5.0, 1.0)[:, None, None]
    table = table_from_trials('stiffness', ramps, label, RATE_HZ)
    folder = tmp_path / 'both'
    folder.mkdir()
    write_model(folder / 'stiffness.npz', train(table, 'knn'))
    (folder / 'texture.npz').write_bytes(model.read_bytes())
    said = hear_tactile('classify', path, '--model', folder, code=2)
    assert 'stiffness; texture' in said
    assert '--model' in said


def test_channel_of_the_model_is_found_by_name(tmp_path):
    label = np.repeat(LABELS, 20)
    noise = np.random.default_rng(1).normal(size=(60, 120))
    x = np.stack([noise, make_rows(label)], axis=1)
    named = {'unit': 'N', 'channels': ('fx', 'fz')}
    model = tmp_path / 'm.npz'
    write_model(
        model, train(table_from_trials('texture', x, label, RATE_HZ, 'fz', **named), 'knn')
    )
    stated = {'rate_hz': RATE_HZ, 'unit': 'N'}
    np.savez(tmp_path / 'two.npz', x=x, label=label, channel_names=['fx', 'fz'], **stated)
    for channels in ((1, 0), (1,)):
        names = [('fx', 'fz')[i] for i in channels]
        part = {'x': x[:6, channels], 'label': label[:6], 'channel_names': names}
        np.savez(tmp_path / 'other.npz', **part, **stated)
        assert (
            answers_of(ask_tactile('classify', tmp_path / 'other.npz', '-m', model))
            == ['fine'] * 6
        )
    refused = ('classify', tmp_path / 'two.npz', '-m', model, '--channel', 'fx')
    assert 'was trained on channel fz' in hear_tactile(*refused, code=2)


def test_bags_are_classified_with_live_results(stiffness_bag, trained):
    found = ask_tactile('classify', stiffness_bag, '--model', trained)
    with TrialSet.load(stiffness_bag) as recording:
        trials = {trial.name: trial for trial in recording.trials}
        answers = classify_recording(recording, trained)
    assert [each['trial'] for each in found['trials']] == list(trials)
    assert [each['label'] for each in found['trials']] == [t.label for t in trials.values()]
    assert [each.to_dict() for each in answers.trials] == found['trials']
    assert found['right'] == sum(e['answer'] == e['label'] for e in found['trials'])
    assert '--channel' in hear_tactile(
        'classify', stiffness_bag, '--model', trained, '--channel', 0, code=2
    )
