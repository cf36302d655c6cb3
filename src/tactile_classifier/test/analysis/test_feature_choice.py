# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The choice of features inside the folds."""

import dataclasses

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import stratified_split
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators import random_convolutions
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training import feature_choice
from tactile_classifier.training.feature_choice import Candidate, check_candidate, ChoicePlan
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Fit few convolutions, and divide the training trials of a fold once."""
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
    (choice,) = run_plans([ChoicePlan(*arguments, **options)])
    return choice


def test_the_better_set_is_chosen():
    tables = {
        'texture_spectrum': make_table('texture_spectrum', 0.05, 1, trials=24),
        'glide_waveform': make_table('glide_waveform', 3.0, 2, trials=24),
    }
    split = stratified_split(tables['glide_waveform'], 3, 1)
    choice = choose(tables, split)
    assert choice.best.candidate == ('glide_waveform', 'rocket', 'none')
    others = [s for s in choice.ranking if s.candidate.feature_set == 'texture_spectrum']
    assert others[0].accuracy < choice.best.accuracy
    assert choice.nested_accuracy == choice.best.accuracy
    assert choice.picks == ((choice.best.candidate, 3),)
    assert len(choice.ranking) == 8  # a tree needs no scaling
    assert all(score.fold_s > 0 for score in choice.ranking)
    assert choice.to_dict()['ranking'][0]['classifier'] == 'rocket'
    stated = choice.summarise(choice.best.candidate)
    assert (stated['candidates'], stated['accuracy']) == (8, choice.nested_accuracy)
    assert stated['runner_up']['feature_set'] == 'texture_spectrum'
    assert stated['runner_up']['difference'] == others[0].accuracy - choice.best.accuracy


def test_of_noise_the_best_looks_better_than_the_choice_inside_the_folds():
    gaps = []
    for seed in range(4):
        tables = {'texture_spectrum': make_table('texture_spectrum', 0.0, seed)}
        split = stratified_split(tables['texture_spectrum'], 3, 1, seed)
        choice = choose(tables, split, seed)
        gaps.append(choice.best.accuracy - choice.nested_accuracy)
    assert min(gaps) >= 0.0
    assert np.mean(gaps) > 0.02


def test_tables_of_other_trials_are_refused():
    table = make_table('texture_spectrum', 1.0, 1)
    other = dataclasses.replace(table, labels=table.labels[::-1])
    with pytest.raises(DatasetError, match='table of other is not of the same trials'):
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
    for i in range(20):
        labels = np.random.default_rng(i).permutation(table.labels)
        mixed = dataclasses.replace(table, labels=labels)
        named.append(check_candidate(candidate, mixed, fold, inner).inner_right)
    share = np.mean(named) / len(fold[0])
    assert share == pytest.approx(1 / 3, abs=0.07)
