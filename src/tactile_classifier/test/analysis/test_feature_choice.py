# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the automatic choice of features, which is repeated inside the folds."""

import dataclasses

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.model_file.manifest import format_card, list_facts
from tactile_classifier.training import feature_choice, trainer
from tactile_classifier.training.feature_choice import (
    answer_fold,
    Candidate,
    ChoicePlan,
    FoldAnswers,
    ROBUST,
)
from tactile_classifier.types import CLASSIFIER_TITLES
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Use few convolutions and one repetition of the inner folds, to save time."""
    monkeypatch.setattr(random_convolutions, 'FEATURES', 168)
    monkeypatch.setattr(feature_choice, 'INNER_REPEATS', 1)


def make_table(name, separation, seed, trials=48):
    rng = np.random.default_rng(seed)
    spec = spec_for('texture', FeatureConfig(texture_features=name))
    labels = np.array(['a', 'b', 'c'])[np.arange(trials) % 3]
    values = rng.normal(size=(trials, len(spec.names)))
    values += separation * (np.arange(trials) % 3)[:, None]
    return FeatureTable(values, labels, spec)


def choose(*arguments, **options):
    ((choice,),) = run_plans([ChoicePlan(*arguments, **options)])
    return choice


def test_the_better_set_is_chosen():
    tables = {
        'texture_spectrum': make_table('texture_spectrum', 0.05, 1, trials=24),
        'glide_waveform': make_table('glide_waveform', 3.0, 2, trials=24),
    }
    split = stratified_split(tables['glide_waveform'], 3, 1)
    choice = choose(tables, split)
    assert choice.chosen == ('glide_waveform', 'rocket', 'none')
    others = [s for s in choice.ranking if s.candidate.feature_set == 'texture_spectrum']
    best = choice.find_score(choice.chosen)
    assert others[0].score.mean < best.score.mean
    assert choice.nested.mean == best.score.mean
    assert choice.picks == ((choice.chosen, 3),)
    assert len(choice.ranking) == 8  # the decision tree is tried with one scaling only
    assert all(score.fold_s > 0 for score in choice.ranking)
    assert choice.to_dict()['ranking'][0]['classifier'] == 'rocket'
    assert [score.classifier for score in choice.evaluation.scores] == ['rocket']
    stated = choice.summarise()
    assert stated['candidates'] == 8
    assert stated['runner_up']['feature_set'] == 'texture_spectrum'
    assert stated['runner_up']['difference'] == others[0].score.mean - best.score.mean


def test_of_noise_the_best_looks_better_than_the_choice_inside_the_folds():
    gaps = []
    for seed in range(4):
        tables = {'texture_spectrum': make_table('texture_spectrum', 0.0, seed)}
        split = stratified_split(tables['texture_spectrum'], 3, 1, seed)
        choice = choose(tables, split, seed)
        gaps.append(choice.ranking[0].score.mean - choice.nested.mean)
    assert min(gaps) >= 0.0
    assert np.mean(gaps) > 0.02


def test_tables_of_other_trials_are_refused():
    table = make_table('texture_spectrum', 1.0, 1)
    other = dataclasses.replace(table, labels=table.labels[::-1])
    with pytest.raises(DatasetError, match='table of other contains other trials'):
        choose({'one': table, 'other': other}, stratified_split(table, 3, 1))


def test_a_stated_scaling_is_the_only_one():
    table = make_table('texture_spectrum', 1.0, 1, trials=24)
    choice = choose({'one': table}, stratified_split(table, 3, 1), scaling='standard')
    scalings = {s.candidate.classifier: s.candidate.scaling for s in choice.ranking}
    scaled = dict.fromkeys(('knn', 'svm_linear', 'svm_rbf'), 'standard')
    assert scalings == {**scaled, 'tree': 'none'}


def test_folds_inside_share_convolutions_and_nothing_of_the_labels():
    table = make_table('glide_waveform', 0.0, 1, trials=48)
    split = stratified_split(table, 3, 1)
    (fold, *_) = split.repeats[0]
    inner = split.divide_again(fold[0], table.labels, 0, 6)
    candidate, named = Candidate('glide_waveform', 'rocket', 'none'), []
    parts = np.zeros(48, dtype=int)
    for i in range(20):
        labels = np.random.default_rng(i).permutation(table.labels)
        mixed = dataclasses.replace(table, labels=labels)
        named.append(answer_fold(candidate, mixed, parts, fold, inner).inner_right[fold[0]])
    share = np.mean(named)
    assert share == pytest.approx(1 / 3, abs=0.07)


def make_sessions(name, sessions, seed, trials=8):
    """Return features that are noise, alternating labels, sessions and the specification."""
    rng = np.random.default_rng(seed)
    spec = spec_for('texture', FeatureConfig(texture_features=name))
    session = np.repeat(np.arange(sessions), trials)
    is_b = np.tile([False, True], len(session) // 2)
    values = 0.1 * rng.normal(size=(len(session), len(spec.names)))
    return values, np.where(is_b, 'b', 'a'), session, spec


def test_folds_inside_hold_groups_out_as_the_folds_do():
    values, labels, session, spec = make_sessions('texture_spectrum', 4, 0)
    table = FeatureTable(values, labels, spec, {'session_id': session})
    split = grouped_split(table, ['session_id'])
    for train, test in split.repeats[0]:
        for inner, held_out in split.divide_again(train, labels, 0, 6):
            assert not set(session[inner]) & set(session[held_out])
            assert not set(session[test]) & set(session[[*inner, *held_out]])


def test_with_two_sessions_nothing_is_chosen_by_trials_of_the_session_that_trains():
    # The first feature distinguishes the labels, but with opposite signs in the two sessions.
    # A choice by random folds inside one session would therefore be wrong for the other.
    values, labels, session, spec = make_sessions('texture_spectrum', 2, 1)
    is_b = labels == 'b'
    values[:, 0] += 4.0 * np.where(is_b ^ (session == 1), 1.0, -1.0)
    table = FeatureTable(values, labels, spec, {'session_id': session})
    split = grouped_split(table, ['session_id'])
    with pytest.raises(EvaluationError, match='too few training groups remain'):
        split.divide_again(split.repeats[0][0][0], labels, 0)
    choice = choose({'texture_spectrum': table}, split)
    most_robust = Candidate('texture_spectrum', *ROBUST[1])
    assert choice.picks == ((most_robust, 2),)


def test_flexion_and_abduction_choose_together_inside_the_folds_too():
    """A choice for flexion alone would select a feature set that is useless for abduction."""
    rng = np.random.default_rng(3)
    count = 60
    session, contact = np.arange(count) % 5, np.arange(count) // 30
    is_b = (np.arange(count) // 5) % 2 == 1
    labels = np.where(is_b, 'b', 'a')
    columns = {'session_id': session}
    tables = {}
    # The spectrum is good for flexion and useless for abduction; the waveform is good for both.
    for name, flexion, abduction in (('texture_spectrum', 9.0, 0.0), ('glide_waveform', 0.6, 0.6)):
        spec = spec_for('texture', FeatureConfig(texture_features=name))
        values = rng.normal(size=(count, len(spec.names)))
        values += (np.where(contact == 0, flexion, abduction) * np.where(is_b, 1, -1))[:, None]
        tables[name] = FeatureTable(values, labels, spec, columns)
    split = grouped_split(tables['texture_spectrum'], ['session_id'])
    ((flexion, abduction),) = run_plans([ChoicePlan(tables, split, parts=contact)])
    assert flexion.chosen == abduction.chosen
    assert flexion.picks == abduction.picks
    assert {c.feature_set for c, _ in flexion.picks} == {'glide_waveform'}
    assert flexion.nested.confusion.sum() == abduction.nested.confusion.sum() == 30
    alone = {name: table.take(contact == 0) for name, table in tables.items()}
    by_itself = choose(alone, grouped_split(alone['texture_spectrum'], ['session_id']))
    assert flexion.nested.mean >= 0.9
    assert by_itself.find_score(flexion.chosen).score.mean == pytest.approx(flexion.nested.mean)


def finish(right_of, groups=5, each=4):
    """Return the choice between two feature sets for made-up predictions.

    ``right_of`` maps a candidate to its accuracy in each group. The predictions of all other
    candidates are wrong.
    """
    group = np.repeat(np.arange(groups), each)
    columns = {'session_id': group}
    tables = {}
    for name in ('texture_spectrum', 'glide_waveform'):
        spec = spec_for('texture', FeatureConfig(texture_features=name))
        values = np.random.default_rng(0).normal(size=(len(group), len(spec.names)))
        labels = np.resize(['a', 'b'], len(group))
        tables[name] = FeatureTable(values, labels, spec, columns)
    plan = ChoicePlan(tables, grouped_split(tables['glide_waveform'], ['session_id']))
    answers = []
    for _, (candidate, table, _, (train, test), _) in plan.tasks():
        shares = np.array(right_of.get(tuple(candidate), [0.0] * groups))
        count = round(shares[group[test[0]]] * each)
        wrong = np.where(table.labels == 'a', 'b', 'a')
        said = np.where(np.arange(len(test)) < count, table.labels[test], wrong[test])
        inner = np.full(len(group), np.nan)
        inner[train] = shares[group[train]]
        answers.append(FoldAnswers(said, inner, 1.0))
    (choice,) = plan.finish(answers)
    return choice


SPECTRUM, WAVEFORM = ('texture_spectrum', 'svm_rbf', 'none'), ('glide_waveform', 'rocket', 'none')


@pytest.mark.parametrize(
    ('spectrum', 'waveform', 'chosen'),
    [
        # If accuracies are equal, the more robust candidate is chosen.
        ([1.0] * 5, [1.0] * 5, WAVEFORM),
        # The spectrum is better on average, but by less than the standard error over groups.
        ([1.0, 1.0, 0.5, 1.0, 0.5], [0.5, 0.5, 1.0, 1.0, 0.75], WAVEFORM),
        # The spectrum is better in every group.
        ([1.0] * 5, [0.75, 0.5, 0.75, 0.75, 0.5], SPECTRUM),
        # Two groups are too few for a choice by accuracy.
        ([1.0] * 2, [0.75, 0.5], WAVEFORM),
    ],
)
def test_the_robust_candidate_is_preferred_unless_another_is_clearly_better(
    spectrum, waveform, chosen
):
    choice = finish({SPECTRUM: spectrum, WAVEFORM: waveform}, len(spectrum))
    assert choice.ranking[0].score.mean >= choice.find_score(Candidate(*chosen)).score.mean
    assert choice.chosen == chosen
    assert choice.picks == ((chosen, len(spectrum)),)


def test_a_choice_by_few_groups_says_so():
    accuracies = {SPECTRUM: [1.0] * 6, WAVEFORM: [0.5] * 6}
    for groups, is_few in ((2, True), (3, True), (4, False), (6, False)):
        right_of = {candidate: each[:groups] for candidate, each in accuracies.items()}
        choice = finish(right_of, groups)
        assert choice.has_few_groups == is_few
        assert choice.summarise()['groups'] == groups
        assert choice.summarise()['has_few_groups'] == is_few


def test_the_card_says_what_was_chosen_and_what_unlearned_labels_do(texture_table):
    table = texture_table.take(np.arange(480) % 4 == 0)
    plan = ChoicePlan({'texture_spectrum': table}, stratified_split(table, 2, 1), scaling='none')
    ((choice,),) = run_plans([plan])
    _, classifier, scaling = choice.chosen
    manifest = trainer.train(table, classifier, scaling, choice=choice).manifest
    facts = list_facts(manifest)
    runner_up = choice.find_runner_up()
    assert facts['chosen'].startswith(
        'from 4 combinations of features and classifier; '
        f'runner-up: texture_spectrum, {CLASSIFIER_TITLES[runner_up.candidate.classifier]}, '
    )
    # The card must not contain the accuracies of the candidates or of the calibration.
    nested = f'{100 * choice.nested.mean:.1f} %'
    assert facts['accuracy'].startswith(f'{nested} (stratified 2-fold, once, chosen inside')
    others = {f'{100 * each.score.mean:.1f} %' for each in choice.ranking} - {nested}
    others |= {f'{100 * manifest.confidence.accuracy:.1f} %'} - {nested}
    assert [text for text in others if text in format_card(manifest)] == []
    few = {**manifest.cross_validation['choice'], 'groups': 2, 'has_few_groups': True}
    stated = {**manifest.cross_validation, 'choice': few}
    warned = list_facts(dataclasses.replace(manifest, cross_validation=stated))['chosen']
    assert '2 groups are too few for a choice by accuracy' in warned
    assert 'too few' not in facts['chosen']
    unlearned = manifest.calibration['unlearned']
    assert facts['unlearned labels'] == (
        f'{100 * unlearned["miss_rate"]:.0f} % of their trials receive a known label with the '
        f'mean threshold, {100 * unlearned["strict_miss_rate"]:.0f} % with the strict threshold '
        '(each of 8 labels left out once)'
    )
