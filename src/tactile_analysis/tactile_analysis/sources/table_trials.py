# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials from tables: one file per trial, or one long table with a column of trial names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import find_group_word, ImportNotes, name_labels, SourceFile
from tactile_analysis.sources.signals import make_trial, NEWTONS
from tactile_analysis.sources.table_files import read_table, Table
from tactile_bags.trial import Trial

NAMES: Mapping[str, frozenset[str]] = {
    'time': frozenset(('t', 'time', 'timestamp', 'stamp')),
    'trial': frozenset(('trial', 'trial_id')),
    'label': frozenset(('label', 'object', 'object_label')),
    'force': frozenset(('force', 'tension')),
}
"""Column names that are recognised without an option, in lower case and without their unit."""

UNITS_S = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'μs': 1e-6, 'ns': 1e-9, 'min': 60.0}
"""Factors from units of time to seconds."""

ISO, DAY_FIRST = 'iso', 'day-first'
"""Values of `SourceOptions.time_unit` for times that are written as dates."""

_DAY_FIRST_FORMS = tuple(
    f'%d{mark}%m{mark}%Y %H:%M:%S{fraction}' for mark in './-' for fraction in ('', '.%f')
)
_ISO_DATE = re.compile(r'\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?$')
_BRACKETS = re.compile(r'^(.*?)[ _]*[\[(]([^\])]*)[\])]$')
_ENDING = re.compile(rf'^(.+)[ _]({"|".join(UNITS_S)}|N|[mkuµ]N|m?V|[kM]?Pa|k?g|n|mn|kn)$')
_SPELLINGS = {'n': 'N', 'mn': 'mN', 'kn': 'kN', 'newton': 'N', 'newtons': 'N', 'volt': 'V'}
_SPELLINGS |= {'volts': 'V', '-': '', '1': '', 'raw': '', 'a.u.': '', 'n/a': ''}


@dataclass(frozen=True)
class Roles:
    """Names of the columns of a table by their role; empty if no column has the role.

    Each column in ``values`` is a channel of the signal. If ``trial`` is empty, the file is one
    trial.
    ``time_unit`` is a key of `UNITS_S`, or a format of dates.
    """

    values: tuple[str, ...]
    time: str = ''
    time_unit: str = ''
    trial: str = ''
    label: str = ''


def split_unit(name: str) -> tuple[str, str]:
    """Return the name of a column in lower case and its unit, which may be empty.

    Examples of names with a unit are ``Force [N]``, ``time (ms)``, ``time_ms`` and ``force_n``.
    """
    for pattern in (_BRACKETS, _ENDING):
        found = pattern.match(name.strip())
        if found:
            unit = found.group(2).strip()
            is_known = unit in UNITS_S or unit in NEWTONS
            unit = unit if is_known else _SPELLINGS.get(unit.lower(), unit)
            return found.group(1).strip().lower().replace(' ', '_'), unit
    return name.strip().lower().replace(' ', '_'), ''


def read_table_trials(
    leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Read the trials of CSV and Parquet files.

    A file with a column of trial names contains several trials; any other file is one trial. If
    there is no column of labels, labels are taken from the names of files or folders, see
    `name_labels`. Raises `SourceError` for a column whose meaning is unknown.
    """
    trials: list[Trial] = []
    named: list[dict[str, str]] = []
    roles: Roles | None = None
    columns: tuple[str, ...] = ()
    for i, leaf in enumerate(leaves):
        table = read_table(leaf.path, options)
        if table.nested:
            notes.add(f'omitted, because they contain lists: {", ".join(table.nested)}')
        if roles is None or tuple(table.columns) != columns:  # once for files with equal columns
            roles, columns = assign_roles(table, options, notes), tuple(table.columns)
        known: Mapping[str, str] = {}
        if not roles.label:
            named = named or name_labels(leaves, options, notes)
            known = named[i]
            if notes.no_label is not None and i == 0:
                notes.no_label = SourceError(f'{notes.no_label}{_propose_label(table, roles)}')
        trials += _cut_trials(table, roles, leaf, known, options, notes)
    return trials


def _propose_label(table: Table, roles: Roles) -> str:
    """Return a text that proposes an option for each column that may contain the labels."""
    likely = [
        name
        for name, column in table.columns.items()
        if column.dtype.kind == 'U'
        and name not in (*roles.values, roles.time, roles.trial)
        and not find_group_word(name)
    ]
    return f'; in a table: {" or ".join(f"--label-column {n}" for n in likely)}' if likely else ''


def _cut_trials(
    table: Table,
    roles: Roles,
    leaf: SourceFile,
    known: Mapping[str, str],
    options: SourceOptions,
    notes: ImportNotes,
) -> list[Trial]:
    for name in roles.values:
        _check_numeric(table, name)
    values = np.stack([table.columns[name].astype(np.float64) for name in roles.values])
    units = tuple(table.units.get(name) or split_unit(name)[1] for name in roles.values)
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
    for key, rows in _group_rows(table, roles, notes):
        columns: dict[str, Any] = {**known, 'source': leaf.name}
        for name, column in others.items():
            part = column[rows]
            if (part == part[0]).all():
                columns[name] = part[0].item()
            else:
                varying.add(name)
        name = '/'.join(map(str, key)) or leaf.name
        times = None if time_s is None else time_s[rows]
        found.append(
            make_trial(
                name,
                values[:, rows],
                times,
                columns,
                options,
                notes,
                channels=roles.values,
                units=units,
                rate_hz=table.rate_hz,
            )
        )
    if 'label' in varying:
        raise SourceError(
            f'{table.path}: a trial has several labels; state the column of trials with '
            '--trial-column'
        )
    if varying:
        notes.add(f'omitted, because they vary within a trial: {", ".join(sorted(varying))}')
    return found


def _times_s(table: Table, roles: Roles) -> NDArray[np.float64] | None:
    """Return the times [s]; dates and integers are relative to the first time in the table."""
    if not roles.time:
        return None
    column = table.columns[roles.time]
    if roles.time_unit in (ISO, DAY_FIRST):
        column = _parse_dates(table, roles.time, roles.time_unit)
        unit_s = 1e-9
    else:
        _check_numeric(table, roles.time)
        unit_s = 1e-9 if roles.time in table.times else UNITS_S[roles.time_unit]
    if column.dtype.kind in 'iu':
        column = column.astype(np.int64)
        return np.asarray((column - column[0]) * unit_s, dtype=np.float64)
    return np.asarray(column * unit_s, dtype=np.float64)


def _parse_dates(table: Table, name: str, form: str) -> NDArray[np.int64]:
    """Convert a column of dates and times to nanoseconds since 1970."""
    found = []
    for row, text in enumerate(table.columns[name].tolist(), start=1):
        stamp = _parse_date(str(text).strip().replace(',', '.'), form)
        if stamp is None:
            raise SourceError(
                f'{table.path}: column "{name}", data row {row}: "{text}" is not a date and '
                f'time of the format {form}'
            )
        found.append(stamp)
    return np.array(found, dtype=np.int64)


def _parse_date(text: str, form: str) -> int | None:
    """Return a date and time in nanoseconds since 1970; None if the text is invalid."""
    try:
        if form == ISO:
            # Checked first, because NumPy also accepts other texts, such as "now".
            if not _ISO_DATE.match(text):
                return None
            return int(np.datetime64(text.replace(' ', 'T'), 'ns').astype(np.int64))
    except ValueError:
        return None
    for pattern in _DAY_FIRST_FORMS:
        try:
            since = datetime.strptime(text, pattern) - datetime(1970, 1, 1)
        except ValueError:
            continue
        return (since // timedelta(microseconds=1)) * 1000
    return None


def _group_rows(
    table: Table, roles: Roles, notes: ImportNotes
) -> list[tuple[tuple[Any, ...], NDArray[np.intp]]]:
    """Return the name and the row indices of each trial, in the order of their first rows.

    Trials with different labels or sessions may have the same name. In this case, the name of a
    trial also contains its label, its session, or its value in another column of groups (see
    `find_group_word`). A trial never contains several values of such a column.
    """
    if not roles.trial:
        return [((), np.arange(len(table)))]
    names: tuple[str, ...] = (roles.trial,)
    numbers = _number_groups(table, names)
    groups = (name for name in table.columns if find_group_word(name))
    for name in dict.fromkeys((roles.label, *groups)):
        if name and name not in (*names, *roles.values):
            finer = _number_groups(table, (name, *names))
            if finer.max() > numbers.max():
                names, numbers = (name, *names), finer
    if len(names) > 1:
        notes.add(f'trials are distinguished by {" and ".join(names)} together')
    order = np.argsort(numbers, kind='stable')
    starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    parts = np.split(order, starts[1:])
    return [(tuple(table.columns[n][rows[0]].item() for n in names), rows) for rows in parts]


def _number_groups(table: Table, names: Sequence[str]) -> NDArray[np.intp]:
    """Return the number of each row's group, from 0, in the order of the groups' first rows.

    Rows with equal values in the columns ``names`` are a group.
    """
    codes = np.zeros(len(table), dtype=np.intp)
    for name in names:
        _, inverse = np.unique(table.columns[name], return_inverse=True)
        codes = codes * (int(inverse.max()) + 1) + inverse
        _, codes = np.unique(codes, return_inverse=True)
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[inverse], dtype=np.intp)


def assign_roles(table: Table, options: SourceOptions, notes: ImportNotes) -> Roles:
    """Return the columns of each role, from the options or by their exact names.

    Raises `SourceError` if neither determines the column of a required role.
    """
    forces = tuple(name.strip() for name in options.force_column.split(',') if name.strip())
    stated = {'time': options.time_column, 'trial': options.trial_column}
    stated['label'] = options.label_column
    for name in filter(None, (*forces, *stated.values())):
        if name not in table.columns:
            raise SourceError(f'{table.path} has no column "{name}"; {_show_columns(table)}')
    named = {role: name or _find_named(table, role) for role, name in stated.items()}
    if not named['time'] and table.times:
        named['time'] = _choose(table, 'time', sorted(table.times))
    force = forces or table.values
    if not force:
        force = (_find_named(table, 'force'),)
    if not any(force):
        likely = [name for name in table.columns if split_unit(name)[1] in NEWTONS]
        raise _ask(table, 'force', likely)
    unit = _find_time_unit(table, named['time'], options.time_unit)
    roles = Roles(force, named['time'], unit, named['trial'], named['label'])
    _note_roles(table, roles, notes)
    return roles


def _find_named(table: Table, role: str) -> str:
    """Return the column whose name is in `NAMES` for this role, or an empty string."""
    found = [name for name in table.columns if split_unit(name)[0] in NAMES[role]]
    return _choose(table, role, found) if found else ''


def _choose(table: Table, role: str, found: Sequence[str]) -> str:
    if len(found) > 1:
        raise _ask(table, role, found)
    return found[0]


def _ask(table: Table, role: str, likely: Sequence[str]) -> SourceError:
    """Return the error for a table in which the column of a role is unknown."""
    possible = f'; possible: {", ".join(likely)}' if likely else ''
    several = '[,NAME...]' if role == 'force' else ''
    channels = ''
    if role == 'force' and len(likely) > 1:
        channels = f', such as --force-column "{",".join(likely)}" for {len(likely)} channels'
    return SourceError(
        f'{table.path}: the column of the {role} is unknown{possible}. State it with '
        f'--{role}-column NAME{several}{channels}; {_show_columns(table)}'
    )


def _show_columns(table: Table) -> str:
    """Return the names of the columns with their values in the first row."""
    cells = [f'{name} = {column[0]}' for name, column in table.columns.items()]
    more = f', and {len(cells) - 12} more' if len(cells) > 12 else ''
    return f'columns and first row: {", ".join(cells[:12])}{more}'


def _find_time_unit(table: Table, name: str, stated: str) -> str:
    """Return the unit of the times, from the option or from the name of the column."""
    if stated and stated not in (*UNITS_S, ISO, DAY_FIRST):
        raise SourceError(
            f'--time-unit is "{stated}"; it must be one of {", ".join((*UNITS_S, ISO, DAY_FIRST))}'
        )
    if not name:
        return ''
    if name in table.times:
        return 'ns'
    is_text = table.columns[name].dtype.kind not in 'fiu'
    unit = stated or split_unit(name)[1]
    if is_text and unit not in (ISO, DAY_FIRST):
        _check_numeric(table, name, f'; for dates state --time-unit {ISO} or {DAY_FIRST}')
    if unit in UNITS_S or (is_text and unit in (ISO, DAY_FIRST)):
        return unit
    if unit in (ISO, DAY_FIRST):
        raise SourceError(f'{table.path}: column "{name}" contains numbers; --time-unit is {unit}')
    steps = np.diff(table.columns[name][:1000].astype(np.float64))
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    step = float(np.median(steps)) if len(steps) else 0.0
    rates = [f'{u}: {1.0 / (step * UNITS_S[u]):.4g} Hz' for u in ('s', 'ms', 'us') if step > 0.0]
    shown = f' ({", ".join(rates)})' if rates else ''
    raise SourceError(
        f'{table.path}: the unit of the times in column "{name}" is unknown. State it with '
        f'--time-unit UNIT{shown}, or in the name, as in {name}_s; {_show_columns(table)}'
    )


def _check_numeric(table: Table, name: str, remedy: str = '') -> None:
    column = table.columns[name]
    if column.dtype.kind in 'fiu':
        return
    row, cell = next(
        ((row, cell) for row, cell in enumerate(column.tolist(), 1) if not _is_number(cell)),
        (1, column[0]),
    )
    raise SourceError(
        f'{table.path}: column "{name}" must contain numbers, but data row {row} contains '
        f'"{cell}"{remedy}'
    )


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _note_roles(table: Table, roles: Roles, notes: ImportNotes) -> None:
    parts = [f'force: {", ".join(roles.values)}']
    if roles.time:
        parts.append(f'time: {roles.time} in {roles.time_unit}')
    if roles.trial:
        parts.append(f'trial: {roles.trial}')
    if roles.label:
        parts.append(f'label: {roles.label}')
    notes.add('used ' + '; '.join(parts))
