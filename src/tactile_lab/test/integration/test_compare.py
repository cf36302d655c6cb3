# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile compare` from the command line, on simulated trials and models trained on them."""

import shutil

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.records import NO_ANSWER
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_lab.datasets.feature_tables import FeatureTables, read_tables
from tactile_lab.datasets.model_pairs import pair_tables


def compare(*arguments):
    (found,) = ask_tactile('compare', *arguments)['comparisons']
    return found


def hear(*arguments, **options):
    return hear_tactile('compare', *arguments, **options)


@pytest.fixture(scope='module')
def bags(simulate_bag):
    """Return bags of two seeds, of five sessions each: to train on and to compare on."""
    return [simulate_bag('texture', 'flexion', 2, seed=seed, sessions=5) for seed in (3, 4)]


@pytest.fixture(scope='module')
def tables(bags):
    """Return the features of each bag."""
    return [table for bag in bags for table in read_tables([bag]).tables.values()]


@pytest.fixture(scope='module')
def models(tables, tmp_path_factory):
    """Return a good model and a worse one: half of its labels were shuffled in training."""
    folder = tmp_path_factory.mktemp('models')
    table = tables[0]
    write_model(folder / 'good.npz', train(table, 'knn'))
    labels = table.labels.copy()
    mixed = np.random.default_rng(1).permutation(len(labels))[: len(labels) // 2]
    labels[mixed] = np.roll(labels[mixed], 1)
    worse = FeatureTable(table.values, labels, table.spec, table.columns)
    write_model(folder / 'worse.npz', train(worse, 'svm_linear', 'none'))
    return folder / 'good.npz', folder / 'worse.npz'


def test_the_worse_model_is_found_on_new_sessions(bags, tables, models):
    found = compare(*models, bags[1])
    assert found['trials'] == len(tables[1])
    assert (found['groups'], found['parts_are']) == (5, 'sessions')
    assert found['better'] == 'A'
    assert found['interval']['low'] < found['difference'] < found['interval']['high'] < 0.0
    assert found['difference'] == pytest.approx(found['b']['accuracy'] - found['a']['accuracy'])
    assert found['only_a'] - found['only_b'] == round(-found['difference'] * found['trials'])
    assert found['verdict'].startswith('A is better by ')
    assert [found['models'][side]['training_trials_among_these'] for side in 'ab'] == [0, 0]
    assert not found['warnings']
    assert found['models']['a']['size_bytes'] == models[0].stat().st_size
    assert found['predict_time_ratio_b_to_a'] > 0.0
    assert compare(*models[::-1], bags[1])['better'] == 'B'


def test_a_model_is_not_told_apart_from_itself(bags, models):
    found = compare(models[0], models[0], bags[1])
    assert (found['better'], found['difference'], found['agreement']) == ('', 0.0, 1.0)
    low, high = found['interval']['low'], found['interval']['high']
    assert low == -high < 0.0
    assert found['verdict'].startswith(
        f'Not told apart: B less A is +0.0 points ({100 * low:+.1f} to {100 * high:+.1f}), '
    )


def test_trials_of_the_training_are_counted_and_left_out(bags, tables, models):
    found = compare(*models, *bags)
    count = len(tables[0])
    for side in 'ab':
        assert found['models'][side]['training_trials_among_these'] == count
    assert f'{count} of these {2 * count} trials' in found['warnings'][0]
    assert 'on trials that A and B were trained on' in found['verdict']
    assert found['groups'] == 10
    unseen = compare(*models, *bags, '--unseen')
    alone = compare(*models, bags[1])
    for name in ('trials', 'difference', 'interval', 'confusions', 'verdict', 'groups'):
        assert unseen[name] == alone[name]
    said = hear(*models, bags[0], '--unseen', code=2)
    assert 'a model was trained on each of these trials, so none is left' in said


def test_new_trials_of_a_session_of_the_training_are_pointed_out(bags, tables, tmp_path):
    table = tables[0]
    half = np.arange(len(table)) // 8 % 2 == 0
    model = tmp_path / 'half.npz'
    write_model(model, train(table.take(half), 'knn'))
    found = compare(model, model, bags[0], '--unseen')
    count = int((~half).sum())
    assert found['trials'] == found['trials_in_sessions_of_the_training'] == count
    assert f'{count} of these trials share one of the sessions' in found['warnings'][0]


def test_a_model_that_does_not_tell_its_trials_is_said(bags, tables, models, tmp_path):
    table = tables[0]
    few = np.concatenate([np.flatnonzero(table.labels == x)[:2] for x in np.unique(table.labels)])
    silent = tmp_path / 'few.npz'
    write_model(silent, train(table.take(few), 'knn'))
    found = compare(models[0], silent, bags[1])
    assert found['models']['b']['training_trials_among_these'] is None
    assert 'whether B has seen these trials is not known' in found['warnings']
    said = hear(models[0], silent, bags[1], '--unseen', code=2)
    assert 'does not tell which trials it was trained on' in said


def test_a_trial_without_features_for_one_model_is_no_answer_of_it(tables, models):
    loaded = tuple(load_model(path) for path in (models[0], models[0]))
    key, table = ('texture', 'flexion'), tables[1]
    parts = [table.take(np.arange(5, len(table))), table.take(np.arange(len(table))[::-1])]
    parts[1] = parts[1].take(np.arange(3, len(table)))
    answers = iter(parts)
    (paired,) = pair_tables(lambda _: FeatureTables({key: next(answers)}, ()), loaded, [])
    assert len(paired) == len(table)
    for side, missing in ((0, range(5)), (1, range(len(table) - 3, len(table)))):
        found = paired.spread(side, parts[side].column('trial_id'), NO_ANSWER)
        lacks = np.isin(paired.trial_ids, table.column('trial_id')[list(missing)])
        np.testing.assert_array_equal(found, np.where(lacks, NO_ANSWER, paired.trial_ids))
    order = [table.column('trial_id').tolist().index(name) for name in paired.trial_ids]
    np.testing.assert_array_equal(paired.labels, table.labels[order])
    np.testing.assert_array_equal(paired.groups, table.column('session_id')[order])


def test_each_model_has_features_of_its_own(bags, models, tmp_path):
    (table,) = read_tables(bags[:1], {'texture_features': 'glide_waveform'}).tables.values()
    other = tmp_path / 'other.npz'
    write_model(other, train(table, 'knn'))
    found = compare(models[0], other, bags[1])
    features = [found['models'][side]['feature_set'] for side in 'ab']
    assert features == ['texture_spectrum', 'glide_waveform']
    assert found['a'] == compare(*models, bags[1])['a']


def test_one_session_is_said_and_groups_may_be_others(bags, models):
    said = hear(*models, bags[1], '--group', 'bag')
    assert 'of one session, or it is not stated' in said
    assert 'Tango score interval over 80 paired trials; p ' in said
    assert 'SIMULATED' in said
    found = compare(*models, bags[1], '--group', 'session_id,mounting_id')
    assert found['parts_are'] == 'groups of session_id and mounting_id'
    assert found['groups'] > 5
    assert 'there is no column "weekday"' in hear(*models, bags[1], '--group', 'weekday', code=2)


def test_an_archive_with_sessions_and_a_new_label(tmp_path):
    generator = np.random.default_rng(5)
    time_s = np.arange(100) / 100.0
    label = np.tile(['a', 'b', 'c'], 40)
    hz = np.tile([3.0, 9.0, 21.0], 40)
    x = np.sin(2 * np.pi * hz[:, None] * time_s) + generator.normal(0.0, 0.8, (120, 100))
    day = np.repeat(['mo', 'tu', 'we', 'th'], 30)
    known = label != 'c'
    first, paths = day < 'n', []
    for name, keep in (('train', first & known), ('new', ~first)):
        paths.append(tmp_path / f'{name}.npz')
        np.savez(paths[-1], x=x[keep, None], label=label[keep], rate_hz=100.0, session=day[keep])
    for folder, classifier in (('m1', 'knn'), ('m2', 'svm_linear')):
        options = ('--task', 'texture', '--classifier', classifier, '--repetitions', 1)
        hear_tactile('train', paths[0], '-o', tmp_path / folder, *options)
    found = compare(tmp_path / 'm1', tmp_path / 'm2', paths[1])
    assert (found['trials'], found['groups']) == (int((~first & known).sum()), 2 + 1)
    assert found['new_labels']['labels'] == ['c']
    assert found['new_labels']['trials'] == int((~first & ~known).sum())
    assert found['a']['accuracy'] > 0.8


def test_what_cannot_be_compared_is_one_sentence(
    bags, tables, models, stiffness_bag, trained, tmp_path
):
    assert 'does not exist' in hear(models[0], tmp_path / 'no.npz', bags[1], code=2)
    bad = tmp_path / 'bad.npz'
    bad.write_bytes(b'no model')
    assert 'is refused' in hear(models[0], bad, bags[1], code=2)
    said = hear(models[0], trained, bags[1], code=2)
    assert 'A answers texture, flexion and B stiffness, flexion' in said
    said = hear(*models, stiffness_bag, code=2)
    assert 'no labelled trials of texture, flexion in these recordings' in said
    table, fewer = tables[0], tmp_path / 'fewer.npz'
    write_model(fewer, train(table.take(table.labels != 'F'), 'knn'))
    said = hear(models[0], fewer, bags[1], code=2)
    assert 'know different labels: only A knows F, only B none' in said
    both = tmp_path / 'both'
    shutil.copytree(trained, both)
    shutil.copy(models[0], both / 'texture_flexion.npz')
    told = ask_tactile('compare', both, models[1], bags[1])
    assert told['left_out'] == ['only A has a model for stiffness, flexion: not compared']
    told = ask_tactile('compare', both, both, bags[1])
    assert [each['title'] for each in told['comparisons']] == ['texture, flexion, SIMULATED']
    assert told['left_out'] == ['no labelled trials of stiffness, flexion in these recordings']


def test_trials_of_other_labels_alone_are_refused(tmp_path, bags):
    spec = spec_for('texture', FeatureConfig())
    values = np.random.default_rng(0).normal(size=(40, len(spec.names)))
    table = FeatureTable(values, np.repeat(['felt', 'silk'], 20), spec)
    write_model(tmp_path / 'one.npz', train(table, 'knn'))
    said = hear(tmp_path / 'one.npz', tmp_path / 'one.npz', bags[1], code=2)
    assert 'no trial has a label that the models know: the trials have' in said
    assert 'the models know felt, silk' in said
