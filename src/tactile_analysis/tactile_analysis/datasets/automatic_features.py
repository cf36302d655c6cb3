# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Set of features, classifier and scaling, chosen inside the folds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.feature_tables import Key, name_table, RecordingFeatures
from tactile_analysis.datasets.reading import select_features
from tactile_analysis.wording import format_nested, name_candidate
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training.feature_choice import (
    ChoicePlan,
    FeatureChoice,
    INNER_REPEATS,
    MANY_TRIALS,
)
from tactile_classifier.training.trainer import check_size
from tactile_features.feature_sets.registry import find_feature_set, list_feature_sets
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD, PROTOCOL_TEXTURE

AUTO = 'auto'
"""In place of a set of features: choose one inside the folds."""

Say = Callable[[str], None]

SESSIONS = ('session_id', 'session', 'day')
"""Names of columns of sessions, in small letters."""


@dataclass(frozen=True)
class Chosen:
    """The choice for the trials of one table.

    ``table`` has the features of the chosen set. ``columns`` are those whose groups the folds held
    out; empty: random folds. ``splits`` has the stated trials to train on and to test on, if any.
    """

    table: FeatureTable
    choice: FeatureChoice
    columns: tuple[str, ...]
    splits: tuple[Split, ...] = ()


def choose_automatically(
    features: RecordingFeatures,
    folds: int,
    random_state: int,
    say: Say,
    columns: Sequence[str] = (),
    *,
    any_set: bool = True,
    must_hold_out: bool = False,
    scaling: str = '',
    repetitions: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[Key, Chosen]:
    """Choose set of features, classifier and scaling for each task, and say why.

    The contacts of a task share the choice, since one extractor serves them. They choose apart if
    their trials do not allow common folds. If trials to train on are stated, only these choose.

    Parameters
    ----------
    features : RecordingFeatures
    folds, random_state : int
        Number and seed of random folds, which are used if there is nothing to hold out; no more
        folds than a label has trials.
    say : callable
        Takes each sentence on the choice.
    columns : sequence of str
        Each fold holds out a group of trials that agree in these. Empty: a column of sessions, or
        the blocks of trials of a bag.
    any_set : bool
        False: the set of features is the stated or recorded one.
    must_hold_out : bool
        True: random folds are no substitute.
    scaling : str
        The only scaling that is tried; empty: all.
    repetitions : int, optional
        Repetitions of random folds. Default: as inside the folds.
    progress : callable
        ``progress(done, total)`` after each part of the work.
    """
    reading = features.reading
    tables = _read_all(features, say) if any_set else _read_stated(features)
    joined = []
    for keys in _list_partners(tables):
        of_keys = {
            key: {name: reading.training(table) for name, table in tables[key].items()}
            for key in keys
        }
        for partners, split, held_out in _divide(
            of_keys, columns, folds, random_state, repetitions, must_hold_out=must_hold_out
        ):
            parts = [of_keys[key] for key in partners]
            pooled = {name: _pool([part[name] for part in parts]) for name in parts[0]}
            plan = ChoicePlan(pooled, split, random_state, scaling, _number_parts(parts))
            joined.append((partners, plan, held_out))
    found = run_plans([plan for _, plan, _ in joined], -1, progress)
    of_these = f'; chosen on trials with {reading.train_where}' if reading.train_where else ''
    chosen = {}
    for (partners, plan, held_out), choices in zip(joined, found, strict=True):
        kinds = ' and '.join(', '.join(filter(None, key[:2])) for key in partners)
        for sentence in (*choices[0].left_out, *filter(None, [plan.no_choice])):
            say(f'{kinds}: {sentence}')
        for key, choice in zip(partners, choices, strict=True):
            table = reading.keep_stated(tables[key][choice.chosen.feature_set])
            say(f'{name_table(key, table)}: {format_choice(choice)}{of_these}')
            chosen[key] = Chosen(table, choice, held_out, reading.splits(table))
    return chosen


def format_choice(choice: FeatureChoice) -> str:
    """Return the chosen candidate, how good such a choice is, and the cost of the runner-up.

    The accuracy of the best on the folds that chose it is too good on average, and is not stated.
    """
    chosen = choice.chosen
    several = len({each.candidate.feature_set for each in choice.ranking}) > 1
    same = [
        count
        for candidate, count in choice.picks
        if candidate == chosen or (several and candidate.feature_set == chosen.feature_set)
    ]
    text = (
        f'{name_candidate(chosen)}; {format_nested(choice)}; {sum(same)} of '
        f'{sum(count for _, count in choice.picks)} folds choose this '
        f'{"set" if several else "classifier"}, too'
    )
    if choice.has_few_groups:
        text += f'; {choice.groups} groups are too few to choose by, record more'
    other = choice.find_runner_up()
    if other is None:
        return text
    score = choice.find_score(chosen)
    points = 100 * (other.score.mean - score.score.mean)
    return (
        f'{text}; the runner-up is {name_candidate(other.candidate)}: {points:+.1f} points, and '
        f'{other.fold_s / score.fold_s:.2g} times the time of training and tests'
    )


Tables = Mapping[str, FeatureTable]
"""Tables of the same trials, by feature set."""


def _list_partners(tables: Mapping[Key, Tables]) -> list[list[Key]]:
    """Return the keys by task; tables whose features differ are no partners."""
    partners: dict[tuple[str, ...], list[Key]] = {}
    for key, found in tables.items():
        specs = (f'{name} {table.spec.digest}' for name, table in found.items())
        partners.setdefault((key[0], *specs), []).append(key)
    return list(partners.values())


def _pool(tables: Sequence[FeatureTable]) -> FeatureTable:
    """Return the trials of several tables, one after another, with the columns that all have."""
    first = tables[0]
    return FeatureTable(
        np.concatenate([table.values for table in tables]),
        np.concatenate([table.labels for table in tables]),
        first.spec,
        {
            name: np.concatenate([table.columns[name] for table in tables])
            for name in first.columns
            if all(name in table.columns for table in tables)
        },
    )


def _number_parts(parts: Sequence[Tables]) -> NDArray[np.intp]:
    return np.repeat(np.arange(len(parts)), [len(next(iter(part.values()))) for part in parts])


Division = tuple[list[Key], Split, tuple[str, ...]]
"""Keys of the tables that share folds, these folds, and the columns that they hold out."""


def _divide(
    tables: Mapping[Key, Tables],
    columns: Sequence[str],
    folds: int,
    random_state: int,
    repetitions: int | None,
    *,
    must_hold_out: bool,
) -> list[Division]:
    """Return common folds of all tables, or folds of each table if only some can hold out."""
    keys = list(tables)
    # A model knows the labels of its own contact only.
    table = _pool([_name_labels(key, tables[key]) for key in keys])
    try:
        return [(keys, *_hold_out(table, columns))]
    except EvaluationError:  # one session only, or none is stated
        if must_hold_out:
            raise
    with suppress(EvaluationError):
        return [(keys, *_hold_out(table, ()))]
    if len(keys) > 1:
        apart = [
            _divide(
                {key: tables[key]},
                columns,
                folds,
                random_state,
                repetitions,
                must_hold_out=False,
            )
            for key in keys
        ]
        if any(held_out for ((_, _, held_out),) in apart):
            return [division for (division,) in apart]
    repeats = repetitions or (INNER_REPEATS if len(table) <= MANY_TRIALS else 1)
    split = stratified_split(table, folds, repeats, random_state)
    return [(keys, split, ())]


def _name_labels(key: Key, tables: Tables) -> FeatureTable:
    table = next(iter(tables.values()))
    if not key[1]:
        return table
    return replace(table, labels=np.char.add(f'{key[1]}, ', table.labels))


def _hold_out(table: FeatureTable, columns: Sequence[str]) -> tuple[Split, tuple[str, ...]]:
    """Return a split by groups and its columns; raise EvaluationError when there is none."""
    found = tuple(columns) or find_sessions(table)
    if not found:
        raise EvaluationError('the trials are of one session')
    return grouped_split(table, found), found


def find_sessions(table: FeatureTable) -> tuple[str, ...]:
    """Return the column of sessions that can be held out, else of blocks of trials; or none."""
    named = [name for name in table.columns if name.lower() in SESSIONS]
    for name in (*named, 'trial_block'):
        with suppress(DatasetError, EvaluationError):
            grouped_split(table, [name])
            return (name,)
    return ()


def _read_stated(features: RecordingFeatures) -> dict[Key, dict[str, FeatureTable]]:
    found = {
        key: select_features(table, features.reading.features)
        for key, table in features.tables().tables.items()
    }
    for table in found.values():
        check_size(table)
    return {key: {table.spec.feature_set: table} for key, table in found.items()}


def _read_all(features: RecordingFeatures, say: Say) -> dict[Key, dict[str, FeatureTable]]:
    """Return the tables of all sets that give features of the same trials.

    Sets over the surface are left out without a word if the trials state no speed.
    """
    tables: dict[Key, dict[str, FeatureTable]] = {}
    sets = (list_feature_sets(PHASE_GLIDE), list_feature_sets(PHASE_HOLD))
    for glide, hold in zip_longest(*sets):
        needs_speed = glide and getattr(find_feature_set(glide), 'needs_speed', False)
        if needs_speed and not (features.has_speeds and _state_speeds(tables)):
            if hold is None:
                continue
            glide = None
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


def _state_speeds(tables: Mapping[Key, Tables]) -> bool:
    """Return False when the texture trials have a column of speeds and none states one."""
    found = [
        table.columns['glide_speed_m_s']
        for key, by_set in tables.items()
        for table in by_set.values()
        if key[0] == PROTOCOL_TEXTURE and 'glide_speed_m_s' in table.columns
    ]
    return not found or any(bool((speeds > 0.0).any()) for speeds in found)
