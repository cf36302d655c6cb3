# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Automatic choice of feature set, classifier and scaling."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
from tactile_analysis.datasets.feature_tables import (
    compute_tables,
    join_tables,
    Key,
    name_table,
    needs_speed,
)
from tactile_analysis.trial_set import TrialSet
from tactile_analysis.wording import format_nested, name_candidate
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import DatasetError, EvaluationError
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.model_file.manifest import format_time_ratio
from tactile_classifier.training.feature_choice import (
    ChoicePlan,
    FeatureChoice,
    INNER_REPEATS,
    MANY_TRIALS,
)
from tactile_classifier.training.trainer import check_size
from tactile_features.feature_sets.registry import find_feature_set, list_feature_sets
from tactile_features.types import PHASE_GLIDE, PHASE_HOLD, PROTOCOL_TEXTURE

AUTO = 'auto'
"""Value of the option ``--features`` with which a feature set is chosen automatically."""

Say = Callable[[str], None]

SESSIONS = ('session_id', 'session', 'day')
"""Names of columns that contain sessions, in lower case."""


@dataclass(frozen=True)
class Chosen:
    """Result of the automatic choice for one task and contact.

    ``table`` contains the features of the chosen feature set. In the folds of the choice, trials
    with equal values in ``columns`` were held out together; the folds were random if it is empty.
    ``splits`` contains the split by ``--train-where`` and ``--test-where``, if they are given.
    """

    table: FeatureTable
    choice: FeatureChoice
    columns: tuple[str, ...]
    splits: tuple[Split, ...] = ()


def choose_automatically(
    trials: TrialSet,
    options: FeatureOptions,
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
    """Choose feature set, classifier and scaling for each task, and report the reason.

    All contacts of a task get the same choice, because they share a feature extractor. If groups
    can only be held out within single contacts, each contact gets a separate choice. If training
    trials are selected (``--train-where``), only these are used.

    Parameters
    ----------
    trials : TrialSet
    options : FeatureOptions
        Task, channel and features; selection of training trials.
    folds, random_state : int
        Number and seed of random folds, which are used if no groups can be held out. The number
        is limited to the number of trials per label.
    say : callable
        Called with each sentence about the choice.
    columns : sequence of str
        Each fold holds out a group of trials with equal values in these columns. By default,
        sessions, or blocks of trials in a bag, are held out.
    any_set : bool
        If False, use the selected or recorded feature set.
    must_hold_out : bool
        If True, do not fall back to random folds.
    scaling : str
        The only scaling to try; if empty, all scalings are tried.
    repetitions : int, optional
        Repetitions of random folds. Default: as many as in the inner cross-validation.
    progress : callable
        Called as ``progress(done, total)`` after each part of the work.
    """
    tables = _read_all(trials, options, say) if any_set else _read_stated(trials, options)
    joined = []
    for keys in _list_partners(tables):
        of_keys = {
            key: {name: options.training(table) for name, table in tables[key].items()}
            for key in keys
        }
        for partners, split, held_out in _divide(
            of_keys, columns, folds, random_state, repetitions, must_hold_out=must_hold_out
        ):
            parts = [of_keys[key] for key in partners]
            pooled = {name: join_tables([part[name] for part in parts]) for name in parts[0]}
            plan = ChoicePlan(pooled, split, random_state, scaling, _number_parts(parts))
            joined.append((partners, plan, held_out))
    found = run_plans([plan for _, plan, _ in joined], -1, progress)
    of_these = f'; chosen on trials with {options.train_where}' if options.train_where else ''
    chosen = {}
    for (partners, plan, held_out), choices in zip(joined, found, strict=True):
        kinds = ' and '.join(', '.join(filter(None, key[:2])) for key in partners)
        for sentence in (*choices[0].left_out, *filter(None, [plan.no_choice])):
            say(f'{kinds}: {sentence}')
        for key, choice in zip(partners, choices, strict=True):
            table = options.keep_stated(tables[key][choice.chosen.feature_set])
            say(f'{name_table(key, table)}: {format_choice(choice)}{of_these}')
            chosen[key] = Chosen(table, choice, held_out, options.splits(table))
    return chosen


def format_choice(choice: FeatureChoice) -> str:
    """Describe the chosen candidate, its nested accuracy, and the runner-up with its cost.

    The accuracy on the folds by which the candidate was chosen is optimistic, and is not reported.
    """
    chosen = choice.chosen
    several = len({each.candidate.feature_set for each in choice.ranking}) > 1
    same = [
        count
        for candidate, count in choice.picks
        if candidate == chosen or (several and candidate.feature_set == chosen.feature_set)
    ]
    text = (
        f'{name_candidate(chosen)}; {format_nested(choice)}; the same '
        f'{"feature set" if several else "classifier"} was chosen in {sum(same)} of '
        f'{sum(count for _, count in choice.picks)} folds'
    )
    if choice.has_few_groups:
        text += f'; {choice.groups} groups are too few for a choice by accuracy, record more'
    other = choice.find_runner_up()
    if other is None:
        return text
    score = choice.find_score(chosen)
    points = 100 * (other.score.mean - score.score.mean)
    return (
        f'{text}; runner-up: {name_candidate(other.candidate)}: {points:+.1f} points, '
        f'{format_time_ratio(other.fold_s / score.fold_s)} in training and testing'
    )


Tables = Mapping[str, FeatureTable]
"""Tables of the same trials, by feature set."""


def _list_partners(tables: Mapping[Key, Tables]) -> list[list[Key]]:
    """Group the keys of tables with the same task and features."""
    partners: dict[tuple[str, ...], list[Key]] = {}
    for key, found in tables.items():
        specs = (f'{name} {table.spec.digest}' for name, table in found.items())
        partners.setdefault((key[0], *specs), []).append(key)
    return list(partners.values())


def _number_parts(parts: Sequence[Tables]) -> NDArray[np.intp]:
    return np.repeat(np.arange(len(parts)), [len(next(iter(part.values()))) for part in parts])


Division = tuple[list[Key], Split, tuple[str, ...]]
"""Keys of the tables that share folds, the folds, and the columns of held-out groups."""


def _divide(
    tables: Mapping[Key, Tables],
    columns: Sequence[str],
    folds: int,
    random_state: int,
    repetitions: int | None,
    *,
    must_hold_out: bool,
) -> list[Division]:
    """Return common folds of all tables, or separate folds if only some allow held-out groups."""
    keys = list(tables)
    # The contact becomes part of the labels, because a model is trained on one contact only.
    table = join_tables([_name_labels(key, tables[key]) for key in keys])
    try:
        return [(keys, *_hold_out(table, columns))]
    except EvaluationError:  # only one session, or no sessions recorded
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
    """Return a split that holds out groups, and the columns that define the groups.

    Raises `EvaluationError` if there are no groups.
    """
    found = tuple(columns) or find_sessions(table)
    if not found:
        raise EvaluationError('all trials are of one session')
    return grouped_split(table, found), found


def find_sessions(table: FeatureTable) -> tuple[str, ...]:
    """Return the column of the sessions; if they cannot be held out, of the blocks of trials.

    The result is empty if neither can be held out.
    """
    named = [name for name in table.columns if name.lower() in SESSIONS]
    for name in (*named, 'trial_block'):
        with suppress(DatasetError, EvaluationError):
            grouped_split(table, [name])
            return (name,)
    return ()


def _read_stated(trials: TrialSet, options: FeatureOptions) -> dict[Key, dict[str, FeatureTable]]:
    tables, _ = compute_tables(trials, options)
    found = {key: select_features(table, options.features) for key, table in tables.items()}
    for table in found.values():
        check_size(table)
    return {key: {table.spec.feature_set: table} for key, table in found.items()}


def _read_all(
    trials: TrialSet, options: FeatureOptions, say: Say
) -> dict[Key, dict[str, FeatureTable]]:
    """Return a table for each feature set. All tables of a task and contact have the same trials.

    Other feature sets are left out with a message. Feature sets over distance are left out without
    a message if no sliding speeds are recorded.
    """
    tables: dict[Key, dict[str, FeatureTable]] = {}
    sets = (list_feature_sets(PHASE_GLIDE), list_feature_sets(PHASE_HOLD))
    for glide, hold in zip_longest(*sets):
        is_spatial = glide and getattr(find_feature_set(glide), 'needs_speed', False)
        has_speeds = trials.is_own or needs_speed(options)
        if is_spatial and not (has_speeds and _state_speeds(tables)):
            if hold is None:
                continue
            glide = None
        fields: dict[str, Any] = {
            'texture_features': glide or sets[0][0],
            'stiffness_features': hold or sets[1][0],
        }
        try:
            found, left_out = compute_tables(trials, options, fields)
        except DatasetError as error:
            say(f'left out: {error}')
            continue
        for key, table in found.items():
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
                reason = f'; {left_out[0]}' if left_out else ''
                say(
                    f'{table.spec.feature_set} left out: it has features for {len(table)} '
                    f'trials, {first.spec.feature_set} for {len(first)}{reason}'
                )
    return tables


def _state_speeds(tables: Mapping[Key, Tables]) -> bool:
    """Return False if texture trials have a column of sliding speeds, but no speed above 0."""
    found = [
        table.columns['glide_speed_m_s']
        for key, by_set in tables.items()
        for table in by_set.values()
        if key[0] == PROTOCOL_TEXTURE and 'glide_speed_m_s' in table.columns
    ]
    return not found or any(bool((speeds > 0.0).any()) for speeds in found)
