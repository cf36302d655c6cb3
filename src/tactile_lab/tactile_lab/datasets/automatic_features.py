# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Set of features, classifier and scaling, chosen inside the folds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training.feature_choice import (
    Candidate,
    CandidateScore,
    ChoicePlan,
    FeatureChoice,
    INNER_REPEATS,
    MANY_TRIALS,
)
from tactile_classifier.training.trainer import check_size
from tactile_features.feature_sets.registry import list_feature_sets
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD
from tactile_lab.datasets.feature_tables import Key, name_table, RecordingFeatures
from tactile_lab.datasets.tables import format_nested, name_candidate

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
    *,
    any_set: bool = True,
    must_hold_out: bool = False,
    scaling: str = '',
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[Key, Chosen]:
    """Choose set of features, classifier and scaling for each task and contact, and say why.

    The contacts of a task share a set: that whose best classifiers have the highest mean accuracy.
    Where trials to train on are stated, these alone choose.

    ``folds``, ``random_state``: of random folds, where there is nothing to hold out; no more than
    a label has trials. ``say``: takes each sentence on the choice. ``columns``: what each fold
    holds out. ``any_set``: False: the set of features is the stated or recorded one.
    ``must_hold_out``: True: random folds are no substitute. ``scaling``: the only one that is
    tried; empty: all. ``progress``: ``progress(done, total)`` after each part of the work.
    """
    reading = features.reading
    tables = _read_all(features, say) if any_set else _read_stated(features)
    plans = []
    for found in tables.values():
        parts = {name: reading.training(table) for name, table in found.items()}
        split = _divide(parts, columns, folds, random_state, must_hold_out=must_hold_out)
        plans.append(ChoicePlan(parts, split, random_state, scaling))
    choices: dict[Key, FeatureChoice] = dict(
        zip(tables, run_plans(plans, -1, progress), strict=True)
    )
    of_these = f'; chosen on trials with {reading.train_where}' if reading.train_where else ''
    picked = {}
    for (key, choice), plan in zip(choices.items(), plans, strict=True):
        kind = name_table(key, next(iter(tables[key].values())))
        for sentence in (*choice.left_out, *filter(None, [plan.no_choice])):
            say(f'{kind}: {sentence}')
        same = [other for another, other in choices.items() if another[0] == key[0]]
        shared = [name for name in tables[key] if all(each.find_best(name) for each in same)]
        name = max(shared, key=lambda n: sum(_best(each, n).accuracy for each in same))
        kind = name_table(key, tables[key][name])
        say(f'{kind}: {format_choice(choice, name)}{of_these}')
        picked[key] = Chosen(tables[key][name], _best(choice, name).candidate, choice)
    return picked


def format_choice(choice: FeatureChoice, name: str) -> str:
    """Return what was chosen, how good such a choice is, and what the runner-up would cost.

    The accuracy of the best on the folds that chose it is too good on average, and not told.
    """
    best = _best(choice, name)
    several = len({score.candidate.feature_set for score in choice.ranking}) > 1
    same = [
        count
        for candidate, count in choice.picks
        if candidate == best.candidate or (several and candidate.feature_set == name)
    ]
    text = (
        f'{name_candidate(best.candidate)}; {format_nested(choice)}; {sum(same)} of '
        f'{sum(count for _, count in choice.picks)} folds choose this '
        f'{"set" if several else "classifier"}, too'
    )
    other = choice.find_runner_up(best.candidate)
    if other is None:
        return text
    points = 100 * (other.accuracy - best.accuracy)
    return (
        f'{text}; the runner-up is {name_candidate(other.candidate)}: {points:+.1f} points, and '
        f'{other.fold_s / best.fold_s:.2g} times the time of training and tests'
    )


def _best(choice: FeatureChoice, name: str) -> CandidateScore:
    found = choice.find_best(name)
    assert found is not None
    return found


def _divide(
    tables: Mapping[str, FeatureTable],
    columns: Sequence[str],
    folds: int,
    random_state: int,
    *,
    must_hold_out: bool,
) -> Split:
    table = next(iter(tables.values()))
    try:
        return grouped_split(table, columns)
    except (DatasetError, EvaluationError):  # one session only, or none is stated
        if must_hold_out:
            raise
        repeats = INNER_REPEATS if len(table) <= MANY_TRIALS else 1
        return stratified_split(table, folds, repeats, random_state)


def _read_stated(features: RecordingFeatures) -> dict[Key, dict[str, FeatureTable]]:
    found = features.tables().tables
    for table in found.values():
        check_size(table)
    return {key: {table.spec.feature_set: table} for key, table in found.items()}


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
            try:
                check_size(table)
            except DatasetError as error:
                say(f'{name_table(key, table)}, left out: {error}')
                continue
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
