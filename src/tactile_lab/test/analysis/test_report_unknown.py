# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report's answers besides a label follow from the trials."""

import dataclasses
import json

import numpy as np
import pytest

from tactile_analysis.datasets.automatic_features import choose_automatically
from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
from tactile_analysis.datasets.feature_tables import open_trials, read_tables
from tactile_analysis.report import answers as answers_module
from tactile_analysis.report.analysis import analyse
from tactile_analysis.report.answers import answer
from tactile_analysis.report.build import build_page
from tactile_analysis.report.recordings import make_sets
from tactile_analysis.report.significance import find_components, format_alike_pairs
from tactile_analysis.report.summary import answer_rows
from tactile_classifier.confidence import fit_calibration
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.evaluation.open_set import evaluate_open_set
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_ros.errors import TactileError


def make_holds(gap, each=15):
    """Four objects in three sessions; the first two differ by ``gap`` times their scatter."""
    generator = np.random.default_rng(5)
    centres = np.array([0.0, gap, 100.0, 200.0])
    code = np.repeat(np.arange(4), each)
    values = centres[code, np.newaxis] + generator.normal(0.0, 1.0, (4 * each, 3))
    return FeatureTable(
        values,
        np.array(['alike', 'twin', 'other', 'far'])[code],
        spec_for('stiffness', FeatureConfig()),
        {'session_id': np.arange(4 * each) % 3, 'simulated': np.zeros(4 * each, dtype=bool)},
    )


@pytest.fixture(scope='module')
def answered(simulate_bag):
    """Return the results of simulated textures, and the page made of them."""
    with open_trials([simulate_bag('texture', 'flexion', 4, seed=11)]) as trials:
        chosen = choose_automatically(
            trials, FeatureOptions(), 2, 0, lambda _: None, any_set=False
        )
        sets = make_sets(trials, FeatureOptions(), chosen, answers=True)
    options = {'folds': 2, 'repetitions': 1, 'details': False}
    with pytest.MonkeyPatch.context() as patch:
        # Two folds, and a rate that the half of the trials can bound.
        patch.setattr(fit_calibration, 'MAX_FOLDS', 2)
        patch.setattr(answers_module, 'FALSE_ALARM_RATE', 0.1)
        results = analyse(sets, **options, random_state=0, jobs=1)
    return results, build_page(results, [], {})


def test_unknown_twin_is_missed_and_a_far_label_is_not():
    table = make_holds(gap=0.0)
    answers = answer(table, ['session_id'])
    alone = evaluate_open_set(table, 'knn', hold_out=('session_id',), false_alarm_rate=0.05)
    assert answers.open_set == alone
    rows = dict(answer_rows(answers))
    assert rows['AUROC'] == f'{100 * alone.auroc:.1f} %'
    assert rows['unknown labels missed'] == f'{100 * alone.miss_rate:.1f} %'
    miss = {unknown.label: unknown.miss_rate for unknown in answers.open_set.unknown}
    assert miss['twin'] > 0.7
    assert miss['far'] == 0.0
    assert answers.open_set.split == 'one session held out'


def test_what_cannot_be_done_says_why_and_the_rest_is_done():
    holds = make_holds(gap=50.0)
    answers = answer(holds, ())
    assert answers.open_set.split == 'stratified 6-fold over trials'
    assert max(unknown.miss_rate for unknown in answers.open_set.unknown) == 0.0
    assert answers.not_done == ()
    two = answer(holds.take(np.isin(holds.labels, ['far', 'twin'])), ['session_id'])
    assert two.open_set is None
    assert two.not_done[0].startswith('unknown objects: there are 2 labels')


def test_chosen_features_have_whole_names(texture_bag):
    (table,) = read_tables([texture_bag]).values()
    names = ('one__size', 'other__size', *table.spec.names[2:])
    twins = dataclasses.replace(table, spec=dataclasses.replace(table.spec, names=names))
    assert select_features(twins, 'other__size').spec.names == ('other__size',)
    with pytest.raises(TactileError, match=r'one__size, other__size$'):
        select_features(twins, 'size')


def test_sections_stand_in_page_and_json_with_split_and_mark(answered):
    (result,), page = answered
    assert result.answers.not_done == ()
    assert '<summary>Unknown objects</summary>' in page
    captions = [part.split('</caption>')[0] for part in page.split('<caption>')[1:]]
    ours = [c for c in captions if '3 nearest neighbours, not scaled, ' in c]
    assert len(ours) == 2
    assert all(c.startswith('SIMULATED. ') for c in captions)
    assert all(result.answers.open_set.split in c for c in ours)
    figures = [part.split('</figure>')[0] for part in page.split('<figure>')[1:]]
    (figure,) = (figure for figure in figures if 'left out of the training' in figure)
    assert '<figcaption>SIMULATED. ' in figure
    assert '>SIMULATED</text>' in figure
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert document['answers']['open_set']['split'] == result.answers.open_set.split


def test_mean_p_is_explained_by_counting_pairs(answered):
    (result,), page = answered
    components = find_components(result.recordings.table.spec)
    p = result.significance.p[components.columns]
    over = np.array([[p[k, i, j] > 0.05 for i in range(8) for j in range(i)] for k in range(90)])
    sentence = format_alike_pairs(result, components)
    assert f'of the 28 pairs of classes, {np.median(over.sum(axis=1)):g} have p over' in sentence
    assert f'{int((over.sum(axis=1) < 14).sum())} of 90 components' in sentence
    few = sum(p[:, i, j].min() <= 0.05 / 90 for i in range(8) for j in range(i))
    assert f'. {few} pairs differ in some component at 0.05 over' in sentence
    assert f'over 0.05 in {over.sum(axis=0).max()} components' in sentence
    assert 'depends on the pairs of labels that are averaged' in page
