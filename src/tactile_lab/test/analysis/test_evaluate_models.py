# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile evaluate --model`: model files on trials that they were not trained on."""

import numpy as np
import pytest
from scipy.stats import binomtest
from tactile_command import ask_tactile, hear_tactile

from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import read_tables
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train


def options_of(models):
    return [argument for model in models for argument in ('--model', model)]


def evaluate(*recordings, models, options=()):
    return ask_tactile('evaluate', *recordings, *options_of(models), *options)


def hear(*recordings, models, options=(), code=2):
    return hear_tactile('evaluate', *recordings, *options_of(models), *options, code=code)


@pytest.fixture(scope='module')
def bags(simulate_bag):
    """Return two bags of three sessions each: training trials, and new trials of another seed."""
    return [simulate_bag('texture', 'flexion', 2, seed=seed, sessions=3) for seed in (3, 4)]


@pytest.fixture(scope='module')
def tables(bags):
    """Return the features of each bag."""
    return [table for bag in bags for table in read_tables([bag]).values()]


@pytest.fixture(scope='module')
def models(tables, tmp_path_factory):
    """Return a good model, and a worse one that was trained with half of its labels shuffled."""
    folder = tmp_path_factory.mktemp('models')
    table = tables[0]
    write_model(folder / 'good.npz', train(table, 'knn'))
    labels = table.labels.copy()
    mixed = np.random.default_rng(1).permutation(len(labels))[: len(labels) // 2]
    labels[mixed] = np.roll(labels[mixed], 1)
    worse = FeatureTable(table.values, labels, table.spec, table.columns)
    write_model(folder / 'worse.npz', train(worse, 'svm_linear', 'none'))
    return folder / 'good.npz', folder / 'worse.npz'


def test_worse_model_is_identified_on_new_sessions(bags, tables, models):
    found = evaluate(bags[1], models=models)
    table = tables[1]
    correct = np.array(
        [load_model(path).predict_or_unknown(table.values) == table.labels for path in models]
    )
    assert (found['trials'], found['sessions']) == (len(table), 3)
    assert found['title'] == 'texture, flexion, SIMULATED'
    for score, mine in zip(found['scores'], correct, strict=True):
        assert score['accuracy'] == pytest.approx(mine.mean())
        interval = score['interval']
        if 'reason' not in interval:  # the accuracies of the sessions differ
            assert interval['low'] < score['accuracy'] <= interval['high']
            assert interval['method'].endswith('over 3 sessions')
            assert ('exact' in interval['method']) == (score['accuracy'] in (0.0, 1.0))
    difference = found['difference']
    only = [int((mine & ~other).sum()) for mine, other in (correct, correct[::-1])]
    assert [difference['only_a'], difference['only_b']] == only
    assert difference['difference'] == pytest.approx((only[1] - only[0]) / len(table))
    assert difference['difference'] < 0.0
    assert difference['p_value'] == pytest.approx(binomtest(only[0], sum(only)).pvalue)
    if 'reason' not in difference['interval']:
        assert difference['interval']['method'] == 't over 3 sessions'
    assert [model['training_trials'] for model in found['models']] == [0, 0]
    assert not found['warnings']


def test_training_trials_are_excluded_and_counted(bags, tables, models):
    both = evaluate(*bags, models=models[:1])
    new = evaluate(bags[1], models=models[:1])
    assert both['models'][0]['training_trials'] == len(tables[0])
    for name in ('trials', 'sessions', 'scores'):
        assert both[name] == new[name]
    assert both['difference'] is None
    said = hear(bags[0], models=models)
    assert f'good.npz on {len(tables[0])} of {len(tables[0])}' in said
    assert 'recordings that were not used in training' in said


def test_trials_of_a_training_session_cause_a_warning(bags, tables, tmp_path):
    table = tables[0]
    half = np.arange(len(table)) // 8 % 2 == 0
    path = tmp_path / 'half.npz'
    write_model(path, train(table.take(half), 'knn'))
    found = evaluate(bags[0], models=[path])
    assert found['trials'] == found['beside_training'] == int((~half).sum())
    assert 'from sessions used in training' in found['warnings'][0]


def test_digest_of_a_trial_ignores_rounding_and_differs_between_trials(tables):
    table = tables[0]
    digests = table.digest_trials()
    assert len(set(digests)) == len(table)
    noise = 1.0 + 1e-14 * np.random.default_rng(0).standard_normal(table.values.shape)
    other = FeatureTable(table.values * noise, table.labels, table.spec)
    assert np.mean(np.array(other.digest_trials()) == digests) > 0.97


def test_each_model_is_evaluated_with_its_features_and_window(bags, models, tmp_path):
    paths = [models[0]]
    for name, feature_options in (
        ('waveform', FeatureOptions(features='glide_waveform')),
        ('early', FeatureOptions(window_s=1.0)),
    ):
        (table,) = read_tables(bags[:1], options=feature_options).values()
        paths.append(tmp_path / f'{name}.npz')
        write_model(paths[-1], train(table, 'knn'))
        alone = evaluate(*bags, models=paths[-1:])
        assert alone['models'][0]['training_trials'] == len(table)
        pair = evaluate(bags[1], models=[models[0], paths[-1]])
        assert pair['scores'] == [
            evaluate(bags[1], models=[path])['scores'][0] for path in (models[0], paths[-1])
        ]
    features = [model['feature_set'] for model in pair['models']]
    assert features == ['texture_spectrum', 'texture_spectrum']


def test_trials_of_a_label_that_one_model_does_not_know_are_excluded(
    bags, tables, models, tmp_path
):
    table, fewer = tables[0], tmp_path / 'fewer.npz'
    left_out = str(table.labels[0])
    write_model(fewer, train(table.take(table.labels != left_out), 'knn'))
    found = evaluate(bags[1], models=[models[0], fewer])
    is_known = tables[1].labels != left_out
    assert found['trials'] == int(is_known.sum())
    new = found['new_labels']
    assert (new['labels'], new['trials']) == ([left_out], int((~is_known).sum()))
    assert all(0.0 <= rate <= 1.0 for rate in new['unknown_rates'])
    assert f'labels of A only: {left_out}' in found['warnings']
    # Without a common label there is nothing to evaluate.
    named = FeatureTable(table.values, np.char.add('x', table.labels), table.spec, table.columns)
    write_model(fewer, train(named, 'knn'))
    said = hear(bags[1], models=[models[0], fewer])
    assert 'no trial' in said
    assert 'none in common' in said


@pytest.fixture
def archives(tmp_path):
    """Return functions that save archives of three materials and train on them.

    The archives have four sessions. Two further values are a mask of the trials of the first
    session, and the arrays of all trials.
    """
    generator = np.random.default_rng(5)
    time_s = np.arange(100) / 100.0
    label = np.tile(['a', 'b', 'c'], 40)
    hz = np.tile([3.0, 9.0, 21.0], 40)
    x = np.sin(2 * np.pi * hz[:, None] * time_s) + generator.normal(0.0, 0.8, (120, 100))
    day = np.repeat(['mo', 'tu', 'we', 'th'], 30)
    first = day < 'n'
    arrays = {'x': x[:, None], 'label': label, 'session': day}

    def save(name, keep, **more):
        path = tmp_path / f'{name}.npz'
        chosen = {key: array[keep] for key, array in arrays.items()}
        np.savez(path, **{**chosen, 'rate_hz': 100.0, **more})
        return path

    def train_on(path, name, *options):
        stated = ('--task', 'texture', '--repetitions', 1)
        hear_tactile('train', path, '-o', tmp_path / name, *stated, *options)
        return tmp_path / name / 'texture.npz'

    return save, train_on, first, arrays


def test_archives_with_other_rates_tasks_and_unusable_trials(archives, bags, trained):
    save, train_on, first, arrays = archives
    old, new = save('old', first), save('new', ~first)
    model = train_on(old, 'm', '--classifier', 'knn')
    found = evaluate(new, models=[model])
    assert (found['trials'], found['sessions']) == (int((~first).sum()), 3)
    assert found['scores'][0]['accuracy'] > 0.8
    single = evaluate(new, models=[model], options=('--group', 'trial_id'))
    assert single['sessions'] == found['trials']
    slow = save('slow', ~first, rate_hz=50.0)
    said = hear(slow, models=[model])
    assert 'needs samples at 100 Hz, not 50 Hz as in slow.npz' in said
    assert '--resample-hz 100' in said
    said = hear(bags[1], models=[model])
    assert 'needs samples at 100 Hz, not 60 Hz as in texture_flexion: train' in said
    said = hear(new, models=[model], options=('--task', 'stiffness'))
    assert 'is a model for texture trials, but --task is stiffness' in said
    (stiffness,) = trained.glob('*.npz')
    assert 'the models are for different trials' in hear(new, models=[model, stiffness])
    assert 'was trained on other features' in hear(
        new, models=[model], options=('--crop', '0:0.5')
    )
    wrong = arrays['x'][~first].copy()
    wrong[4, 0, 7] = np.nan
    bad = save('bad', ~first, x=wrong)
    assert '--skip-bad' in hear(bad, models=[model])
    fewer = evaluate(bad, models=[model], options=('--skip-bad',))
    assert (fewer['trials'], len(fewer['left_out'])) == (found['trials'] - 1, 1)


def test_trial_without_features_for_one_model_counts_as_wrong_for_it(
    bags, tables, models, rewrite, tmp_path
):
    (table,) = read_tables(bags[:1], options=FeatureOptions(window_s=1.0)).values()
    write_model(tmp_path / 'early.npz', train(table, 'knn'))
    end_ns = int(tables[1].column('window_end_ns')[4])

    def lose_end(type_name, message):
        """Omit the strain block of one second at the end of the window of one trial."""
        if type_name != 'tactile_msgs/msg/StrainBlock':
            return message
        stamp = message.header.stamp
        is_end = -1.0 < stamp.sec + 1e-9 * stamp.nanosec - 1e-9 * end_ns < 0.0
        return None if is_end else message

    gap = rewrite(bags[1], tmp_path / 'gap', lose_end)
    found = evaluate(gap, models=[models[0], tmp_path / 'early.npz'])
    trials = len(tables[1])
    assert found['trials'] == trials
    full, early = found['scores']
    assert (full['no_answer_rate'], early['no_answer_rate']) == (pytest.approx(1 / trials), 0.0)
    assert len(found['left_out']) == 1
    assert full['accuracy'] == pytest.approx(
        np.mean(
            np.delete(
                load_model(models[0]).predict_or_unknown(tables[1].values) == tables[1].labels, 4
            )
        )
        * (trials - 1)
        / trials
    )
    # A single model is evaluated only on the trials for which it has features.
    assert evaluate(gap, models=models[:1])['trials'] == trials - 1


def test_a_bag_of_another_rate_or_kind_is_refused(bags, models, stiffness_bag, trained, tmp_path):
    assert 'contains no texture trials' in hear(stiffness_bag, models=models[:1])
    (stiffness,) = trained.glob('*.npz')
    assert 'contains no stiffness trials' in hear(bags[1], models=[stiffness])
    bad = tmp_path / 'bad.npz'
    bad.write_bytes(b'no model')
    assert 'is refused' in hear(bags[1], models=[bad])


def test_options_of_cross_validation_and_a_third_model_are_refused(bags, models):
    for options in (('--folds', 5), ('--features', 'auto'), ('--report', 'x.html')):
        said = hear(bags[1], models=models, options=options)
        assert f'{options[0]} is for cross-validation; omit it, or omit --model' in said
    assert '--model is given 3 times' in hear(bags[1], models=[*models, models[0]])
    assert 'there is no column "weekday"' in hear(
        bags[1], models=models, options=('--group', 'weekday')
    )


def test_the_printed_table_has_both_models_and_the_test(bags, models):
    said = hear(bags[1], models=models, code=0)
    assert 'texture, flexion, SIMULATED' in said
    assert 'exact McNemar p = ' in said
    assert f'A: {models[0]}' in said
