# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`--features auto`: set of features and classifier, chosen inside the folds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.training.feature_choice import (
    Candidate,
    CandidateScore,
    choose_candidate,
    FeatureChoice,
)
from tactile_features.feature_sets.registry import list_feature_sets
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD
from tactile_lab.datasets.feature_tables import Key, name_table, RecordingFeatures
from tactile_lab.datasets.tables import name_candidate, tell_nested

AUTO = 'auto'
"""In place of a set of features: choose one inside the folds."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Chosen:
    """The table of the chosen set, what was chosen, and from what."""

    table: FeatureTable
    candidate: Candidate
    choice: FeatureChoice


def choose_automatically(
    features: RecordingFeatures,
    folds: int,
    random_state: int,
    say: Say,
    columns: Sequence[str] = ('session_id',),
) -> dict[Key, Chosen]:
    """Choose set of features and classifier for each task and contact, and say why.

    The contacts of a task share a set: that whose best classifiers have the highest mean accuracy.
    Where trials to train on are stated, these alone choose.

    Parameters
    ----------
    folds, random_state : int
        Of random folds, where there is nothing to hold out; no more than a label has trials.
    say : callable
        Takes each sentence on the choice.
    columns : sequence of str
        What each fold holds out.
    """
    reading = features.reading
    tables = _read_all(features, say)
    choices = {}
    for key, found in tables.items():
        parts = {name: reading.training(table) for name, table in found.items()}
        split = _divide(parts, columns, folds, random_state)
        choices[key] = choose_candidate(parts, split, random_state)
    of_these = f'; chosen on trials with {reading.train_where}' if reading.train_where else ''
    picked = {}
    for key, choice in choices.items():
        same = [other for another, other in choices.items() if another[0] == key[0]]
        shared = [name for name in tables[key] if all(_find_best(each, name) for each in same)]
        name = max(shared, key=lambda n: sum(_best(each, n).accuracy for each in same))
        kind = name_table(key, tables[key][name])
        say(f'{kind}: {describe_choice(choice, name)}{of_these}')
        picked[key] = Chosen(tables[key][name], _best(choice, name).candidate, choice)
    return picked


def describe_choice(choice: FeatureChoice, name: str) -> str:
    """Return what was chosen, how good such a choice is, and what the runner-up would cost.

    The accuracy of the best on the folds that chose it is too good on average, and not told.
    """
    best = _best(choice, name)
    picks = sum(count for candidate, count in choice.picks if candidate[0] == name)
    folds = sum(count for _, count in choice.picks)
    text = (
        f'{name_candidate(best.candidate)}; {tell_nested(choice)}; {picks} of {folds} folds '
        'choose this set, too'
    )
    others = [score for score in choice.ranking if score.candidate[0] != name]
    if not others:
        return text
    other = others[0]
    points = 100 * (other.accuracy - best.accuracy)
    return (
        f'{text}; the runner-up is {name_candidate(other.candidate)}: {points:+.1f} points, and '
        f'{other.fold_s / best.fold_s:.2g} times the time of training and tests'
    )


def _find_best(choice: FeatureChoice, name: str) -> CandidateScore | None:
    return next((score for score in choice.ranking if score.candidate[0] == name), None)


def _best(choice: FeatureChoice, name: str) -> CandidateScore:
    found = _find_best(choice, name)
    assert found is not None
    return found


def _divide(
    tables: Mapping[str, FeatureTable], columns: Sequence[str], folds: int, random_state: int
) -> Split:
    table = next(iter(tables.values()))
    try:
        return grouped_split(table, columns)
    except (DatasetError, EvaluationError):  # one session only, or none is stated
        fewest = int(np.unique(table.labels, return_counts=True)[1].min())
        return stratified_split(table, max(2, min(folds, fewest)), 1, random_state)


def _read_all(features: RecordingFeatures, say: Say) -> dict[Key, dict[str, FeatureTable]]:
    """Return the tables of all sets that give features of the same trials."""
    tables: dict[Key, dict[str, FeatureTable]] = {}
    sets = (list_feature_sets(PHASE_GLIDE), list_feature_sets(PHASE_HOLD))
    for glide, hold in zip_longest(*sets):
        fields: dict[str, Any] = {
            'texture_features': glide or sets[0][0],
            'stiffness_features': hold or sets[1][0],
        }
        try:
            found = features.tables(fields)
        except DatasetError as error:
            say(f'left out: {error}')
            continue
        for key, table in found.tables.items():
            others = tables.setdefault(key, {})
            first = next(iter(others.values()), table)
            if np.array_equal(table.column('trial_id'), first.column('trial_id')):
                others.setdefault(table.spec.feature_set, table)
            else:
                reason = f'; {found.left_out[0]}' if found.left_out else ''
                say(
                    f'{table.spec.feature_set} is left out: it gives features of {len(table)} '
                    f'trials, {first.spec.feature_set} of {len(first)}{reason}'
                )
    return tables
