# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`--features` of train and evaluate: named feature sets, and the choice within the folds."""

import numpy as np
import pytest
from tactile_command import ask_and_hear_tactile, ask_tactile, hear_tactile

from tactile_analysis.datasets.feature_options import FeatureOptions, list_sets
from tactile_classifier.model_file.model import load_model
from tactile_ros.errors import TactileError

pytestmark = pytest.mark.usefixtures('few_convolutions')


def save_glides(path, x, label, **columns):
    np.savez(path, x=x, label=label, rate_hz=60.0, **columns)
    return path


CHEAP = ('--repetitions', 1, '--folds', 2)


def test_train_chooses_features_and_classifier_and_prints_the_candidates(texture_bag, tmp_path):
    said = hear_tactile('train', texture_bag, '-o', tmp_path, *CHEAP)
    model = load_model(tmp_path / 'texture_flexion.npz')
    stated = model.manifest.cross_validation
    assert stated['split'] == 'one session held out'
    assert stated['choice']['candidates'] == 16  # two feature sets, and two sets of waveforms
    nested = f'{100 * stated["mean"]:.1f}'
    for text in (
        'in training and testing',
        f'texture, flexion: {model.spec.feature_set} with',
        'runner-up: ',
        f'accuracy of this selection procedure: {nested} % (one session held out',
        # The table has the accuracies with held-out sessions.
        'accuracy in %: one session held out',
    ):
        assert text in said
    table = said[
        said.index('accuracy [%]' if 'accuracy [%]' in said else 'this selection procedure') :
    ]
    assert 'stratified' not in said
    assert f'this selection procedure {nested}' in ' '.join(table.split())
    # The model card contains only this accuracy.
    assert 'cross-validation' not in model.card
    assert 'classified correctly' not in model.card
    assert f'- accuracy: {nested} % (one session held out, chosen inside the folds' in model.card


def test_if_a_feature_set_is_given_only_the_classifier_is_chosen(texture_bag, tmp_path):
    stated = ('--features', 'texture_spectrum', '--scaling', 'standard', '--group', 'trial_block')
    hear_tactile('train', texture_bag, '-o', tmp_path, *stated, *CHEAP)
    manifest = load_model(tmp_path / 'texture_flexion.npz').manifest
    assert manifest.spec.feature_set == 'texture_spectrum'
    assert manifest.cross_validation['choice']['candidates'] == 4
    assert manifest.cross_validation['split'] == 'one block of trials held out'
    assert manifest.calibration['held_out'] == ['trial_block']


@pytest.mark.parametrize(
    ('options', 'refusal'),
    [
        (('--group', 'bag'), 'all trials have the same bag'),
        (('--group', 'bag', '--classifier', 'knn'), 'all trials have the same bag'),
        (('--features', 'auto', '--classifier', 'knn'), 'omit --classifier'),
        (('--features', 'slope'), 'it must be auto or feature sets: texture_spectrum'),
    ],
)
def test_contradictory_options_of_the_choice_are_refused(texture_bag, tmp_path, options, refusal):
    assert refusal in hear_tactile('train', texture_bag, '-o', tmp_path, *options, *CHEAP, code=2)
    assert not list(tmp_path.iterdir())


def test_random_convolutions_use_all_channels_of_an_archive(tmp_path):
    label = np.repeat(['a', 'b'], 8)
    x = np.random.default_rng(0).normal(size=(16, 3, 60))
    x[:, 1] += np.where(label == 'a', 6.0, 0.0)[:, None]
    archive = save_glides(tmp_path / 'glides.npz', x, label)
    accuracies = []
    for channel, count in (('all', 180), (0, 60)):
        features = ('--task', 'texture', '--channel', channel, '--features', 'glide_waveform')
        (found,) = ask_tactile('evaluate', archive, *features, *CHEAP)['sets']
        scores = {s['classifier']: s['mean'] for s in found['evaluations'][0]['scores']}
        assert len(found['features']) == count
        accuracies.append(scores['rocket'])
    assert accuracies[0] == 1.0
    assert accuracies[1] < 0.9
    trained = ('--task', 'texture', '--features', 'glide_waveform', '--classifier', 'rocket')
    hear_tactile('train', archive, '-o', tmp_path / 'models', *trained, *CHEAP)
    manifest = load_model(tmp_path / 'models' / 'texture.npz').manifest
    assert (manifest.spec.feature_set, manifest.classifier) == ('glide_waveform', 'rocket')


def test_each_feature_set_is_used_for_its_phase():
    assert FeatureOptions(features='glide_waveform,hold_waveform').choose_fields() == {
        'texture_features': 'glide_waveform',
        'stiffness_features': 'hold_waveform',
    }
    over = FeatureOptions(over='45:0.5', features='spatial_waveform').choose_fields()
    assert over['texture_features'] == 'spatial_waveform'
    assert over['spatial_length_m'] == pytest.approx(0.045)
    assert list_sets('slope,correlation') == []
    with pytest.raises(TactileError, match='not glide_waveform'):
        FeatureOptions(over='45:0.5', features='glide_waveform').choose_fields()


def test_feature_set_of_an_archive_is_chosen_by_cross_validation(tmp_path):
    label = np.repeat(['low', 'high'], 12)
    x = np.random.default_rng(1).normal(size=(24, 1, 60))
    x += np.where(label == 'low', 0.0, 4.0)[:, None, None]
    columns = {'part': np.tile([1, 2, 3], 8), 'speed_mm_s': np.full(24, 15.0)}
    archive = save_glides(tmp_path / 'levels.npz', x, label, **columns)
    options = ('--task', 'texture', '--features', 'auto', *CHEAP, '--group', 'part')
    said = hear_tactile('evaluate', archive, *options)
    # The labels differ in the mean, which the spectrum does not contain.
    assert 'texture: glide_waveform with' in said
    assert 'auto: glide_waveform' in said
    assert 'one part held out' in said
    # Feature sets over distance are impossible without speeds, and are not mentioned.
    assert 'speed' not in said
    assert 'left out' not in said


def test_nested_accuracy_on_noise_is_printed_with_the_chance_of_its_split(tmp_path):
    rng = np.random.default_rng(4)
    label = np.repeat(['a', 'b'], [20, 10])
    archive = save_glides(
        tmp_path / 'noise.npz', rng.normal(size=(30, 1, 60)), label, part=np.arange(30) % 3
    )
    asked = ('evaluate', archive, '--task', 'texture', '--features', 'auto', *CHEAP)
    report = tmp_path / 'report.html'
    document, said = ask_and_hear_tactile(*asked, '--group', 'part', '--report', report)
    (found,) = document['sets']
    choice = found['feature_choice']
    mean = choice['nested']['mean']
    assert found['headline']['mean'] == mean
    right = f'{100 * mean:.1f} % of the trials of a new part are classified correctly'
    sentence = f'{right} (30 trials of 3 groups; '
    assert sentence in report.read_text()
    assert sentence in said
    nested = f'accuracy of this selection procedure: {100 * mean:.1f} %'
    assert choice['ranking'][0]['accuracy'] >= mean
    assert (choice['groups'], choice['nested']['split']) == (3, 'one part held out')
    # The nested accuracy is printed with the choice of features, and again below the headline.
    assert said.count(nested) == 2
    assert said.count('chance 66.7 %') >= 2
    chosen = choice['chosen']
    assert f'Model: {chosen["feature_set"]} with ' in said
    # The headline comes before the tables.
    assert said.index(sentence) < said.index('accuracy in %')


def test_evaluate_begins_with_the_accuracy_of_the_model_that_train_would_write(tmp_path):
    """The labels differ in the mean of the signal, which the spectrum does not contain."""
    label = np.repeat(['low', 'high'], 12)
    x = np.random.default_rng(1).normal(size=(24, 1, 60))
    x += np.where(label == 'low', 0.0, 4.0)[:, None, None]
    archive = save_glides(tmp_path / 'levels.npz', x, label, session=np.tile([1, 2, 3], 8))
    asked = ('--task', 'texture', *CHEAP)
    hear_tactile('train', archive, '-o', tmp_path, *asked)
    document, said = ask_and_hear_tactile('evaluate', archive, *asked)
    (found,) = document['sets']
    manifest = load_model(tmp_path / 'texture.npz').manifest
    assert found['headline']['mean'] == manifest.cross_validation['mean'] == 1.0
    assert found['feature_choice']['chosen']['feature_set'] == manifest.spec.feature_set
    assert manifest.spec.feature_set == 'glide_waveform'
    # An accuracy of 100 % must come with the number of trials and the interval.
    sentence = (
        '100.0 % of the trials of a new session are classified correctly '
        '(24 trials of 3 sessions; 95 % interval 29.2 to 100.0 %; chance 50.0 %).'
    )
    assert sentence in said
    assert found['headline']['recall'] == {'high': 1.0, 'low': 1.0}
    assert 'recall by label in %' in said
    assert found['permuted']['p_value'] == pytest.approx(1 / 21)
    # The paper's four classifiers follow, with the spectrum as features.
    assert found['feature_set'] == 'texture_spectrum'
    assert said.index(sentence) < said.index('3 nearest neighbours')


def test_test_trials_do_not_influence_the_choice(tmp_path):
    # The labels differ in the mean of the first 12 trials, and in the frequency of the others.
    label = np.tile(['a', 'b'], 18)
    is_b, later = label == 'b', np.arange(36) >= 12
    rng, time_s = np.random.default_rng(6), np.arange(60) / 60.0
    hz = np.where(later & is_b, 20.0, 10.0)
    x = np.sin(2 * np.pi * hz[:, None] * time_s + rng.uniform(0, 6, (36, 1)))
    x += np.where(~later & is_b, 2.0, 0.0)[:, None]
    choices = []
    for number, later_label in enumerate((label, label[::-1])):
        labels = np.where(later, later_label, label)
        archive = tmp_path / f'{number}.npz'
        save_glides(archive, x[:, None], labels, later=later.astype(int))
        asked = ('--task', 'texture', '--features', 'auto', *CHEAP)
        stated = ('--train-where', 'later=0', '--test-where', 'later=1')
        document, said = ask_and_hear_tactile('evaluate', archive, *asked, *stated)
        (found,) = document['sets']
        ranking = [
            {k: v for k, v in each.items() if k != 'fold_s'}
            for each in found['feature_choice']['ranking']
        ]
        choices.append(ranking)
        assert 'chosen on trials with later=0' in said
        assert ' of the stated test trials are classified correctly (' in said
        assert 'trained on later=0 (12 trials), tested on later=1' in said
        assert 'chosen on the training trials only' in said
        chosen = found['feature_choice']['chosen']
        (mean,) = (
            s['mean']
            for s in found['evaluations'][-1]['scores']
            if (s['classifier'], s['scaling']) == (chosen['classifier'], chosen['scaling'])
        )
        assert found['headline']['mean'] == mean
        assert f'accuracy {100 * mean:.1f} % (trained on' in said
    assert choices[0] == choices[1]


def test_few_training_trials_reduce_the_number_of_folds(tmp_path):
    label = np.tile(['a', 'b'], 12)
    x = np.random.default_rng(1).normal(size=(24, 1, 60)) + (label == 'a')[:, None, None]
    archive = save_glides(tmp_path / 'few.npz', x, label, part=np.arange(24) // 8)
    said = hear_tactile(
        *('evaluate', archive, '--task', 'texture', '--features', 'auto', '--repetitions', 1),
        *('--train-where', 'part=0', '--test-where', 'part=1,2'),
    )
    assert '% (stratified 4-fold' in said


def test_feature_sets_over_distance_are_candidates_if_speeds_are_known(tmp_path):
    rng = np.random.default_rng(2)
    label, speed = np.tile(['a', 'b'], 8), np.repeat([15.0, 20.0], 8)
    at_mm = speed[:, None] * np.arange(200) / 60.0
    pitch_mm = np.where(label == 'a', 2.0, 2.6)[:, None]
    x = np.sin(2 * np.pi * at_mm / pitch_mm + rng.uniform(0, 6, (16, 1)))
    archive = save_glides(tmp_path / 'glides.npz', x[:, None], label, speed_mm_s=speed)
    options = ('--task', 'texture', '--features', 'auto', '--over', '40:1', *CHEAP)
    said = hear_tactile(
        'evaluate', archive, *options, '--speed-column', 'speed_mm_s', '--group', 'speed_mm_s'
    )
    assert 'texture: texture_spatial with' in said or 'texture: spatial_waveform with' in said
