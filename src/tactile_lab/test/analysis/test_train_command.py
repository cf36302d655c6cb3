# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile train` on a small bag of simulated texture trials."""

import dataclasses

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile

from tactile_analysis.datasets import bag_features
from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import compute_tables, open_trials, read_tables
from tactile_analysis.wording import describe_answers
from tactile_bags import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_classifier import TactileClassifier
from tactile_classifier.errors import DatasetError, ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.model_file.storage import open_model
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_features.types import WindowOutcome
from tactile_lab.commands.train import parse_lengths, train_models
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

pytestmark = pytest.mark.usefixtures('few_convolutions')


def train_on(bag, folder, window_s=None, **training):
    """Train on a bag as `tactile train` does; return the models."""
    given = {'folds': 2, 'repetitions': 1, 'output': Output(as_json=True), **training}
    feature_options = FeatureOptions(window_s=window_s)
    with open_trials([bag], feature_options) as trials:
        tables, _ = compute_tables(trials, feature_options)
        return train_models(trials, feature_options, tables, folder=folder, **given)


def test_contradictory_training_options_are_refused(texture_bag, tmp_path):
    for text in ('1;2', '', '0', '-1', 'inf', '1,1', 'full,full'):
        with pytest.raises(TactileError, match=f'--window is "{text}"'):
            parse_lengths(text)
    assert parse_lengths('0.5, full') == [0.5, None]
    over = ('--over', '45:0.5', '--detrend', 'linear')
    said = hear_tactile('train', texture_bag, '-o', tmp_path, *over, code=2)
    assert '--detrend and --over exclude each other' in said
    for window_s, reason in ((0.01, 'texture_samples is 1'), (9.0, 'no labelled trial')):
        with pytest.raises(BagError, match=reason):
            read_tables([texture_bag], options=FeatureOptions(window_s=window_s))
    spatial = FeatureOptions(window_s=0.5, features='texture_spatial')
    with pytest.raises(DatasetError, match='texture_spatial: early windows are not possible'):
        read_tables([texture_bag], options=spatial)


def test_each_window_length_has_a_model_file_that_is_only_replaced_on_request(
    texture_bag, tmp_path
):
    command = ('train', texture_bag, '-o', tmp_path, '--window', '0.5,1.5,full')
    quick = ('--folds', 2, '--repetitions', 1, '--classifier', 'knn', '--false-alarms', 0.1)
    said = hear_tactile(*command, *quick)
    names = ['texture_flexion.npz', 'texture_flexion_0.5s.npz', 'texture_flexion_1.5s.npz']
    models = [load_model(tmp_path / name) for name in names]
    specs = [model.spec for model in models]
    assert [(s.sample_count, s.is_early) for s in specs] == [(180, 0), (30, 1), (90, 1)]
    assert len({spec.digest for spec in specs}) == 3
    assert all(model.manifest.false_alarm_rate == 0.1 for model in models)
    assert 'for 10 % false rejection' in ' '.join(describe_answers(models[1].manifest))
    lengths = said[said.index('accuracy by window length') :].split('texture, flexion ')[1:4]
    assert [each.split()[0] for each in lengths] == ['0.5', '1.5', '3'], said
    assert all('one session held out' in each for each in lengths)
    assert (tmp_path / 'accuracy_by_length.png').stat().st_size > 1000
    before = [path.read_bytes() for path in sorted(tmp_path.glob('*.npz'))]
    assert 'already exists' in hear_tactile(*command, *quick, code=2)
    assert [path.read_bytes() for path in sorted(tmp_path.glob('*.npz'))] == before


def test_existing_model_file_is_refused_before_features_are_computed(
    texture_bag, tmp_path, monkeypatch
):
    (tmp_path / 'texture_flexion_1s.npz').touch()
    computed = []
    monkeypatch.setattr(bag_features, 'compute_bag_tables', lambda *_: computed.append(True))
    said = hear_tactile('train', texture_bag, '-o', tmp_path, '--window', 'full,1', code=2)
    assert str(tmp_path / 'texture_flexion_1s.npz') in said
    assert '--force' in said
    assert not computed


def test_accuracy_by_window_length_is_measured_on_held_out_sessions(texture_bag, tmp_path):
    options = ('--window', '0.2,full', '--folds', 2, '--repetitions', 1)
    said = hear_tactile('train', texture_bag, '-o', tmp_path, *options)
    lengths = said[said.index('accuracy by window length') :].split('texture, flexion ')[1:3]
    for name, line in zip(('texture_flexion_0.2s', 'texture_flexion'), lengths, strict=True):
        stated = load_model(tmp_path / f'{name}.npz').manifest.cross_validation
        assert line.split()[1] == f'{100 * stated["mean"]:.1f}', said
        assert stated['split'] == 'one session held out'
        assert stated['split'] in line


def test_glides_shorter_than_the_early_window_are_excluded(texture_bag):
    (table,) = read_tables([texture_bag], options=FeatureOptions(window_s=3.6)).values()
    assert len(table) == 32
    with pytest.raises(BagError, match=r'the glide ended after .*, inside the window'):
        read_tables([texture_bag], options=FeatureOptions(window_s=3.7))


def test_trial_whose_early_window_is_refused_later_is_excluded(texture_bag, monkeypatch):
    refused = []

    def replay_and_refuse_one(*arguments, **options):
        replayed = replay_phases(*arguments, **options)
        window = replayed.windows[0]
        refused.append(window.trial_id)
        reason = 'the glide ended inside the window'
        late = dataclasses.replace(
            window, values=(), outcome=WindowOutcome.TOO_SHORT, reason=reason
        )
        replayed.windows.append(late)
        return replayed

    monkeypatch.setattr(bag_features, 'replay_phases', replay_and_refuse_one)
    feature_options = FeatureOptions(window_s=0.5)
    with open_trials([texture_bag], feature_options) as trials:
        tables, left_out = compute_tables(trials, feature_options)
    (table,) = tables.values()
    assert len(table) == 31
    assert refused[0] not in table.columns['trial_id']
    assert left_out == (f'{refused[0]}: the glide ended inside the window',)


@pytest.mark.parametrize('detrend', ['none', 'mean', 'linear'])
def test_a_model_states_how_its_spectra_were_detrended(texture_bag, tmp_path, detrend):
    quick = ('--folds', 2, '--repetitions', 1, '--classifier', 'knn')
    said = hear_tactile('train', texture_bag, '-o', tmp_path, '--detrend', detrend, *quick)
    assert f'spectrum_detrend {detrend}' in said
    model = load_model(tmp_path / 'texture_flexion.npz')
    with TactileBag(texture_bag) as opened:
        config = dataclasses.replace(recorded_features(opened).config, spectrum_detrend=detrend)
        early = dataclasses.replace(config, texture_samples=30, early_windows=True)
        both = spec_for('texture', config), spec_for('texture', early)
        windows = replay_phases(opened, RecordedFeatures(config, both)).windows
    assert model.spec == spec_for('texture', config)
    assert model.spec.parameters['spectrum_detrend'] == detrend
    others = {'none', 'mean', 'linear'} - {detrend}
    for other in others:
        changed = dataclasses.replace(config, spectrum_detrend=other)
        with pytest.raises(ModelFileError, match='spectrum_detrend'):
            model.check_fits(spec_for('texture', changed))
    # The tables of full and early windows equal the features of the live extractor.
    tables = {}
    for spec, window_s in zip(both, (None, 0.5), strict=True):
        feature_options = FeatureOptions(detrend=detrend, window_s=window_s)
        (tables[spec.digest],) = read_tables([texture_bag], options=feature_options).values()
    assert len(windows) == sum(map(len, tables.values()))
    for window in windows:
        table = tables[window.specification_digest]
        (row,) = (table.column('window_start_ns') == window.window_start_ns).nonzero()[0]
        assert table.values[row].tobytes() == window.values.tobytes()
        assert bool(model.find_mismatch(window)) == (window.sample_count == 30)


def test_three_seconds_at_1_khz_train_by_default(tmp_path, few_convolutions):
    """Train with default options on windows of 3 s at 1 kHz.

    This takes more than ten seconds, because every candidate is fitted.
    """
    few_convolutions.undo()
    # Labels are upward and downward steps, which differ in shape but not in their spectrum.
    rng = np.random.default_rng(5)
    rows = 3.0 + 0.2 * rng.normal(size=(10, 3_000))
    labels = np.repeat(['down', 'up'], 5)
    for row, label in zip(rows, labels, strict=True):
        for at in rng.integers(100, 2_900, size=12):
            row[at : at + 25] += np.linspace(1.0, 0.0, 25) * (1 if label == 'up' else -1)
    np.savez(tmp_path / 'fast.npz', x=rows, label=labels, rate_hz=1_000.0)
    options = ('--task', 'texture', '--folds', 3, '--repetitions', 1)
    (trained,) = ask_tactile('train', tmp_path / 'fast.npz', '-o', tmp_path / 'm', *options)[
        'models'
    ]
    model = load_model(trained['path'])
    assert len(model.spec.names) <= 600
    assert set(model.predict_or_unknown(np.zeros((1, len(model.spec.names))))) <= {
        'down',
        'up',
        'unknown',
    }
    config = FeatureConfig(
        texture_features='glide_waveform', texture_samples=3_000, rate_hz=1_000.0
    )
    assert len(spec_for('texture', config).names) == 600


def test_too_large_model_file_is_refused_before_cross_validation(tmp_path, few_convolutions):
    few_convolutions.undo()
    rows = np.random.default_rng(1).normal(size=(12, 4, 600))
    labels = ['down', 'up'] * 6
    np.savez(tmp_path / 'wide.npz', x=rows, label=labels, rate_hz=200.0)
    options = ('--task', 'texture', '--channel', 'all', '--features', 'glide_waveform')
    for more in ((), ('--classifier', 'rocket')):
        asked = ('train', tmp_path / 'wide.npz', '-o', tmp_path / 'm', *options, *more)
        said = hear_tactile(*asked, code=2)
        assert '12 trials of 2400 features (glide_waveform) need a model file of 88 MiB' in said


def save_tones(path, each, samples):
    """Save ``each`` trials of each of three labels: sines of different frequencies."""
    rng = np.random.default_rng(2)
    label = np.repeat(['a', 'b', 'c'], each)
    phase = 2 * np.pi * np.arange(samples) / 8
    rows = [np.sin((1 + ord(name) - ord('a')) * phase + rng.random()) for name in label]
    x = np.array(rows) + 0.05 * rng.normal(size=(len(label), samples))
    np.savez(path, x=x, label=label, rate_hz=60.0)
    return path


@pytest.mark.parametrize('each', [2, 3, 4])
def test_few_trials_are_trained_with_as_many_folds_as_possible(tmp_path, each):
    archive = save_tones(tmp_path / 'few.npz', each, 16)
    options = ('--task', 'texture', '--repetitions', 1)
    said = hear_tactile('train', archive, '-o', tmp_path / 'models', *options)
    assert f'{each}-fold ("a" has {each} trials)' in said
    assert ('nothing is chosen: only one training trial of class' in said) == (each == 2)
    model = load_model(tmp_path / 'models' / 'texture.npz')
    trials = np.load(archive)
    answers = [model.classify(row, 60.0) for row in trials['x']]
    assert {answer.label for answer in answers} <= {'a', 'b', 'c', 'unknown'}
    assert sum(a.label == b for a, b in zip(answers, trials['label'], strict=True)) > each


def test_candidate_that_cannot_be_fitted_is_omitted_with_one_line(tmp_path):
    archive = save_tones(tmp_path / 'short.npz', 6, 8)  # convolutions need 9 samples
    options = ('--task', 'texture', '--repetitions', 1)
    said = hear_tactile('train', archive, '-o', tmp_path / 'models', *options)
    assert said.count('glide_waveform, rocket, none left out: the signals have shape') == 1
    assert (tmp_path / 'models' / 'texture.npz').is_file()


def test_train_writes_the_same_model_as_tactile_classifier_in_python(tmp_path):
    """Compare the automatic choices of command and `TactileClassifier` for the same windows."""
    rng = np.random.default_rng(1)
    labels, sessions = np.repeat(['coarse', 'fine'], 15), np.tile(['s1', 's2', 's3'], 10)
    pitch_hz = np.where(labels == 'coarse', 4.0, 9.0)[:, np.newaxis]
    phase = 2 * np.pi * (pitch_hz * np.arange(90) / 60 + rng.random((30, 1)))
    x = 3.0 + 0.05 * np.sin(phase) + rng.normal(0.0, 0.05, (30, 90))
    archive = tmp_path / 'lab.npz'
    np.savez(archive, x=x, label=labels, rate_hz=60.0, session_id=sessions)
    hear_tactile('train', archive, '--task', 'texture', '-o', tmp_path / 'models')
    (path,) = (tmp_path / 'models').glob('*.npz')
    fitted = TactileClassifier('auto', task='texture', rate_hz=60.0)
    fitted.fit(x, labels, groups=sessions).save(tmp_path / 'own.npz')
    written, own = (open_model(each.read_bytes()) for each in (path, tmp_path / 'own.npz'))
    for name in ('labels', 'classifier', 'scaling', 'spec', 'training_sha256', 'confidence'):
        assert getattr(written.manifest, name) == getattr(own.manifest, name), name
    assert written.manifest.calibration == own.manifest.calibration
    for part in ('classifier', 'scaling', 'novelty'):
        first, second = (getattr(each.predictor, part) for each in (written, own))
        assert type(first) is type(second)
        for name in () if first is None else first.SHAPES:
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert fitted.predict(x).tolist() == load_model(path).predict(x).tolist()
