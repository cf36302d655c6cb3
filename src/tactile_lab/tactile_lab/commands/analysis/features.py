# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`--features auto`: set of features and classifier, chosen inside the folds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.training.feature_choice import Candidate, choose_candidate, FeatureChoice
from tactile_features.feature_sets.registry import list_feature_sets
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD
from tactile_lab.commands.output import Output
from tactile_lab.datasets.bag_tables import BagTables, Key, name_table
from tactile_lab.datasets.selection import TrainTest
from tactile_lab.datasets.tables import name_candidate, tell_nested
from tactile_ros.errors import TactileError

AUTO = 'auto'
"""In place of a set of features: choose one inside the folds."""

Reader = Callable[[Mapping[str, Any]], BagTables]
"""Returns the tables of some recordings, with features that fields of `FeatureConfig` name."""


def keep_task(tables: Mapping[Key, FeatureTable], task: str | None) -> dict[Key, FeatureTable]:
    """Return the tables of a task; of every one if it is None.

    Raises
    ------
    TactileError
        When there is none.
    """
    found = {key: table for key, table in tables.items() if task in (None, key[0])}
    if not found:
        raise TactileError(f'the bags hold no {task} trials')
    return found


def choose_automatically(
    read: Reader,
    chosen: Mapping[str, Any],
    folds: int,
    random_state: int,
    output: Output,
    columns: Sequence[str] = ('session_id',),
    train_test: TrainTest | None = None,
) -> dict[Key, tuple[FeatureTable, Candidate, FeatureChoice]]:
    """Choose set of features and classifier for each task and contact, and say why.

    The contacts of a task share a set: that whose best classifiers have the highest mean accuracy.

    Parameters
    ----------
    read : callable
        Reads the recordings, see `Reader`.
    chosen : mapping
        Fields of `FeatureConfig`, such as the window over the surface.
    folds, random_state : int
        Of random folds, where there is nothing to hold out; no more than a label has trials.
    output : Output
    columns : sequence of str
        What each fold holds out.
    train_test : TrainTest, optional
        Where trials to train on are stated, these alone choose.

    Returns
    -------
    dict
        By task and contact: the table of the chosen set, what was chosen, and from what.
    """
    tables = _read_all(read, chosen, output)
    choices = {}
    train_test = train_test or TrainTest()
    for key, found in tables.items():
        parts = {name: train_test.training(table) for name, table in found.items()}
        split = _divide(parts, columns, folds, random_state)
        choices[key] = choose_candidate(parts, split, random_state)
    of_these = (
        f'; chosen on trials with {train_test.train_where}' if train_test.train_where else ''
    )
    picked = {}
    for key, choice in choices.items():
        same = [other for another, other in choices.items() if another[0] == key[0]]
        shared = [n for n in tables[key] if all(map(_holds(n), same))]
        name = max(shared, key=lambda n: sum(_best(each, n).accuracy for each in same))
        best = _best(choice, name)
        kind = name_table(key, tables[key][name])
        output.say(f'{kind}: {describe_choice(choice, name)}{of_these}')
        picked[key] = tables[key][name], best.candidate, choice
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


def _best(choice: FeatureChoice, name: str) -> Any:
    return next(score for score in choice.ranking if score.candidate[0] == name)


def _holds(name: str) -> Any:
    return lambda choice: any(score.candidate[0] == name for score in choice.ranking)


def _divide(
    tables: Mapping[str, FeatureTable], columns: Sequence[str], folds: int, random_state: int
) -> Split:
    table = next(iter(tables.values()))
    try:
        return grouped_split(table, columns)
    except (DatasetError, EvaluationError):  # one session only, or none is stated
        fewest = int(np.unique(table.labels, return_counts=True)[1].min())
        return stratified_split(table, max(2, min(folds, fewest)), 1, random_state)


def _read_all(
    read: Reader, chosen: Mapping[str, Any], output: Output
) -> dict[Key, dict[str, FeatureTable]]:
    """Return the tables of all sets that give features of the same trials."""
    tables: dict[Key, dict[str, FeatureTable]] = {}
    sets = (list_feature_sets(PHASE_GLIDE), list_feature_sets(PHASE_HOLD))
    for glide, hold in zip_longest(*sets):
        fields = {
            'texture_features': glide or sets[0][0],
            'stiffness_features': hold or sets[1][0],
        }
        try:
            found = read({**chosen, **fields})
        except DatasetError as error:
            output.say(f'left out: {error}', plain=True)
            continue
        for key, table in found.tables.items():
            others = tables.setdefault(key, {})
            first = next(iter(others.values()), table)
            if np.array_equal(table.column('trial_id'), first.column('trial_id')):
                others.setdefault(table.spec.feature_set, table)
            else:
                reason = f'; {found.left_out[0]}' if found.left_out else ''
                output.say(
                    f'{table.spec.feature_set} is left out: it gives features of {len(table)} '
                    f'trials, {first.spec.feature_set} of {len(first)}{reason}'
                )
    return tables
