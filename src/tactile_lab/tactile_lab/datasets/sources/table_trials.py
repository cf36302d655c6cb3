# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of tables: a file a trial, or many in one long table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_lab.datasets.sources.column_roles import assign_roles, GROUPS, Roles, split_unit
from tactile_lab.datasets.sources.leaves import Leaf, name_labels
from tactile_lab.datasets.sources.options import SourceOptions
from tactile_lab.datasets.sources.questions import Questions, SourceError
from tactile_lab.datasets.sources.raw_trials import RawTrial
from tactile_lab.datasets.sources.table_files import read_table, Table


def read_table_trials(
    leaves: Sequence[Leaf], options: SourceOptions, questions: Questions
) -> list[RawTrial]:
    """Read the trials of CSV and Parquet files.

    A file with a column of trials holds many; another is one trial. A label that no column
    states comes from the names of file or folder, see `name_labels`.

    Raises
    ------
    SourceError
        When a file is no such table, or what a column means is not known.
    """
    trials: list[RawTrial] = []
    named: list[dict[str, str]] = []
    roles: Roles | None = None
    columns: tuple[str, ...] = ()
    for i, leaf in enumerate(leaves):
        table = read_table(leaf.path)
        if table.nested:
            questions.note(f'left out, they hold lists: {", ".join(table.nested)}')
        if roles is None or tuple(table.columns) != columns:  # asked once for equal files
            roles, columns = assign_roles(table, options.roles, questions), tuple(table.columns)
        known: Mapping[str, str] = {}
        if not roles.label:
            named = named or name_labels(leaves, options, questions)
            known = named[i]
        trials += _cut_trials(table, roles, leaf, known, questions)
    return trials


def _cut_trials(
    table: Table, roles: Roles, leaf: Leaf, known: Mapping[str, str], questions: Questions
) -> list[RawTrial]:
    values = np.stack([table.columns[name].astype(np.float64) for name in roles.values])
    time_s = _times_s(table, roles)
    others = {
        name: column
        for name, column in table.columns.items()
        if name not in (*roles.values, roles.time, roles.label)
    }
    if roles.label:
        others = {**others, 'label': table.columns[roles.label]}
    found = []
    varying: set[str] = set()
    for key, rows in _group_rows(table, roles, questions):
        columns: dict[str, Any] = {**known, 'source': leaf.name}
        for name, column in others.items():
            part = column[rows]
            if (part == part[0]).all():
                columns[name] = part[0].item()
            else:
                varying.add(name)
        name = '/'.join(map(str, key)) or leaf.name
        times = None if time_s is None else time_s[rows]
        found.append(RawTrial(name, values[:, rows], times, columns))
    if 'label' in varying:
        raise SourceError(
            f'{table.path.name}: a trial has several labels; if a row is a sample, name the '
            'column of trials with --column trial=NAME'
        )
    if varying:
        questions.note(f'left out, they change within a trial: {", ".join(sorted(varying))}')
    return found


def _times_s(table: Table, roles: Roles) -> NDArray[np.float64] | None:
    """Return the times from the first one of the table, where integers lose no digit."""
    if not roles.time:
        return None
    column = table.columns[roles.time]
    if column.dtype.kind in 'iu':
        column = column.astype(np.int64)
        return np.asarray((column - column[0]) * roles.time_unit_s, dtype=np.float64)
    return np.asarray(column * roles.time_unit_s, dtype=np.float64)


def _group_rows(
    table: Table, roles: Roles, questions: Questions
) -> list[tuple[tuple[Any, ...], NDArray[np.intp]]]:
    """Return name and rows of each trial, by their first row.

    Where trials of several labels or sessions share a name, all these together are the trial.
    """
    if not roles.trial:
        return [((), np.arange(len(table)))]
    names = roles.trial
    numbers = _number_groups(table, names)
    groups = (name for name in table.columns if split_unit(name)[0] in GROUPS)
    for name in dict.fromkeys((roles.label, *groups)):
        if name and name not in (*names, *roles.values):
            finer = _number_groups(table, (name, *names))
            if finer.max() > numbers.max():
                names, numbers = (name, *names), finer
    if names != roles.trial:
        questions.note(f'a trial is named by {" and ".join(names)} together')
    order = np.argsort(numbers, kind='stable')
    starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    parts = np.split(order, starts[1:])
    return [(tuple(table.columns[n][rows[0]].item() for n in names), rows) for rows in parts]


def _number_groups(table: Table, names: Sequence[str]) -> NDArray[np.intp]:
    """Return the number of the group of each row, from 0, in the order of first rows."""
    codes = np.zeros(len(table), dtype=np.intp)
    for name in names:
        _, inverse = np.unique(table.columns[name], return_inverse=True)
        codes = codes * (int(inverse.max()) + 1) + inverse
        _, codes = np.unique(codes, return_inverse=True)
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[inverse], dtype=np.intp)
