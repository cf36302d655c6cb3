# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Unknown objects and significance in the report."""

import dataclasses
import json

import numpy as np
import pytest

from tactile_analysis.datasets.automatic_features import choose_automatically
from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
from tactile_analysis.datasets.feature_tables import open_trials, read_tables
from tactile_analysis.report import analysis
from tactile_analysis.report.analysis import analyse, evaluate_unknown_objects
from tactile_analysis.report.build import build_page
from tactile_analysis.report.recordings import make_sets
from tactile_analysis.report.significance import find_components, format_alike_pairs
from tactile_analysis.report.summary import unknown_rows
from tactile_classifier.confidence import fit_calibration
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.open_set import evaluate_open_set
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_ros.errors import TactileError


def make_holds(gap, each=15):
    """Return a table of four objects in three sessions.

    The means of the first two objects differ by ``gap`` standard deviations.
    """
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
def evaluated(simulate_bag):
    """Return the results of simulated texture trials, and their report."""
    with open_trials([simulate_bag('texture', 'flexion', 4, seed=11)]) as trials:
        chosen = choose_automatically(
            trials, FeatureOptions(), 2, 0, lambda _: None, any_set=False
        )
        sets = make_sets(trials, FeatureOptions(), chosen, unknown_objects=True)
    options = {'folds': 2, 'repetitions': 1, 'details': False}
    with pytest.MonkeyPatch.context() as patch:
        # Two folds have few calibration trials, which require a larger rate of false rejection.
        patch.setattr(fit_calibration, 'MAX_FOLDS', 2)
        patch.setattr(analysis, 'FALSE_ALARM_RATE', 0.1)
        results = analyse(sets, **options, random_state=0, jobs=1)
    return results, build_page(results, [], {})


def test_unknown_object_is_missed_if_it_resembles_a_known_one():
    table = make_holds(gap=0.0)
    found = evaluate_unknown_objects(table, ['session_id'])
    expected = evaluate_open_set(table, 'knn', hold_out=('session_id',), false_alarm_rate=0.05)
    assert found == expected
    rows = dict(unknown_rows(found))
    assert rows['AUROC'] == f'{100 * expected.auroc:.1f} %'
    assert rows['unknown objects missed'] == f'{100 * expected.miss_rate:.1f} %'
    miss = {unknown.label: unknown.miss_rate for unknown in found.unknown}
    assert miss['twin'] > 0.7
    assert miss['far'] == 0.0
    assert found.split == 'one session held out'


def test_unknown_objects_are_evaluated_in_random_folds_without_groups():
    found = evaluate_unknown_objects(make_holds(gap=50.0), ())
    assert found.split == 'stratified 6-fold over trials'
    assert max(unknown.miss_rate for unknown in found.unknown) == 0.0


def test_unknown_objects_need_more_than_two_labels():
    holds = make_holds(gap=50.0)
    two = holds.take(np.isin(holds.labels, ['far', 'twin']))
    with pytest.raises(EvaluationError, match='2 labels'):
        evaluate_unknown_objects(two, ['session_id'])


def test_features_are_selected_by_whole_names(texture_bag):
    (table,) = read_tables([texture_bag]).values()
    names = ('one__size', 'other__size', *table.spec.names[2:])
    twins = dataclasses.replace(table, spec=dataclasses.replace(table.spec, names=names))
    assert select_features(twins, 'other__size').spec.names == ('other__size',)
    with pytest.raises(TactileError, match=r'one__size, other__size$'):
        select_features(twins, 'size')


def test_unknown_objects_are_in_page_and_json_marked_as_simulated(evaluated):
    (result,), page = evaluated
    assert not any(line.startswith('unknown objects') for line in result.not_done)
    assert '<summary>Unknown objects</summary>' in page
    captions = [part.split('</caption>')[0] for part in page.split('<caption>')[1:]]
    ours = [c for c in captions if '3 nearest neighbours, not scaled, ' in c]
    assert len(ours) == 2
    assert all(c.startswith('SIMULATED. ') for c in captions)
    assert all(result.open_set.split in c for c in ours)
    figures = [part.split('</figure>')[0] for part in page.split('<figure>')[1:]]
    (figure,) = (figure for figure in figures if 'left out of the training' in figure)
    assert '<figcaption>SIMULATED. ' in figure
    assert '>SIMULATED</text>' in figure
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert document['unknown_objects']['split'] == result.open_set.split


def test_similar_pairs_are_counted_to_explain_the_mean_p(evaluated):
    (result,), page = evaluated
    components = find_components(result.recordings.table.spec)
    p = result.significance.p[components.columns]
    over = np.array([[p[k, i, j] > 0.05 for i in range(8) for j in range(i)] for k in range(90)])
    sentence = format_alike_pairs(result, components)
    assert 'there are 28 pairs' in sentence
    assert f'{np.median(over.sum(axis=1)):g} of them have p above 0.05' in sentence
    assert f'{int((over.sum(axis=1) < 14).sum())} of 90 components' in sentence
    few = sum(p[:, i, j].min() <= 0.05 / 90 for i in range(8) for j in range(i))
    assert f'. {few} pairs differ in at least one component' in sentence
    assert f'above 0.05 in {over.sum(axis=0).max()} components' in sentence
    assert 'depends on the pairs of labels that are averaged' in page
