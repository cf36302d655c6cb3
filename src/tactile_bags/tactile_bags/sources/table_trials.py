# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of tables: a file a trial, or many in one long table, by the roles of their columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_bags.sources.files import (
    ambiguity,
    LAYOUT,
    Leaf,
    name_labels,
    Notes,
    SourceError,
    SourceOptions,
)
from tactile_bags.sources.raw_trials import RawTrial
from tactile_bags.sources.table_files import read_table, Table

NAMES: Mapping[str, frozenset[str]] = {
    'time': frozenset(
        ('t', 'time', 'timestamp', 'timestamps', 'stamp', 'sec', 'seconds', 'zeit', 'elapsed')
    ),
    'trial': frozenset(
        ('trial', 'trial_id', 'trial_no', 'trial_number', 'run', 'run_id', 'measurement', 'case')
    ),
    'label': frozenset(
        ('label', 'class', 'y', 'target', 'object', 'object_label', 'material', 'texture')
    ),
}
"""Usual names of columns, without their unit, in small letters."""

GROUPS = frozenset(
    ('session', 'session_id', 'day', 'mounting', 'mounting_id', 'block', 'repetition', 'rep')
)
"""Usual names of columns that no trial goes across, and within which trials are numbered."""

UNITS_S = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'μs': 1e-6, 'ns': 1e-9, 'min': 60.0}
"""Units of time [s]."""

_BRACKETS = re.compile(r'^(.*?)[ _]*[\[(]([^\])]*)[\])]$')
_ENDING = re.compile(rf'^(.+)[ _]({"|".join(UNITS_S)})$')
_SIGNAL = re.compile(r'(force|tension|strain|value|signal|load|f[xyz]?$|ch(annel)?_?\d)')
_FORCE_UNITS = frozenset(('N', 'mN', 'kN', 'g', 'kg'))
_SIGNAL_ENDING = re.compile(r'.+[ _](N|[mkuµ]N|m?V|[kM]?Pa|n|mn|kn)$')
_SPELLINGS = {'n': 'N', 'mn': 'mN', 'kn': 'kN', 'newton': 'N', 'newtons': 'N', 'volt': 'V'}
_SPELLINGS |= {'volts': 'V', '-': '', '1': '', 'raw': '', 'a.u.': '', 'n/a': ''}
_NO_SIGNALS = frozenset((*GROUPS, 'index', 'sample', 'samples', 'sample_index', 'row', ''))


@dataclass(frozen=True)
class Roles:
    """The columns by what they are; an empty name: there is none.

    Each of ``values`` is a channel of the signal. Those of ``trial`` name a trial together;
    without them the file is one.
    """

    values: tuple[str, ...]
    time: str = ''
    time_unit_s: float = 1.0
    trial: tuple[str, ...] = ()
    label: str = ''


def split_unit(name: str) -> tuple[str, str]:
    """Return the name of a column in small letters and its unit, which may be empty.

    ``Force [N]``, ``time (ms)`` and ``time_ms`` have one.
    """
    small = name.strip()
    for pattern in (_BRACKETS, _ENDING):
        found = pattern.match(small)
        if found:
            return found.group(1).strip().lower().replace(' ', '_'), found.group(2).strip()
    return small.lower().replace(' ', '_'), ''


def signal_unit(name: str) -> str:
    """Return the unit of a signal that the name of its column states; empty: it states none.

    ``force_mN``, ``tension [N]``, ``Kraft (N)`` and ``force_n`` have one.
    """
    found = _BRACKETS.match(name.strip())
    ending = _SIGNAL_ENDING.match(name.strip())
    unit = found.group(2).strip() if found else ending.group(1) if ending else ''
    return _SPELLINGS.get(unit.lower(), unit) if unit not in _FORCE_UNITS else unit


def read_table_trials(
    leaves: Sequence[Leaf], options: SourceOptions, notes: Notes
) -> list[RawTrial]:
    """Read the trials of CSV and Parquet files.

    A file with a column of trials holds many; another is one trial. A label that no column
    states comes from the names of file or folder, see `name_labels`. A column whose meaning is not
    known is a `SourceError`.
    """
    trials: list[RawTrial] = []
    named: list[dict[str, str]] = []
    roles: Roles | None = None
    columns: tuple[str, ...] = ()
    for i, leaf in enumerate(leaves):
        table = read_table(leaf.path, options)
        if table.nested:
            notes.add(f'left out, they hold lists: {", ".join(table.nested)}')
        if roles is None or tuple(table.columns) != columns:  # asked once for equal files
            roles, columns = assign_roles(table, options.roles, notes), tuple(table.columns)
        known: Mapping[str, str] = {}
        if not roles.label:
            named = named or name_labels(leaves, options, notes)
            known = named[i]
        trials += _cut_trials(table, roles, leaf, known, notes)
    return trials


def _cut_trials(
    table: Table, roles: Roles, leaf: Leaf, known: Mapping[str, str], notes: Notes
) -> list[RawTrial]:
    values = np.stack([table.columns[name].astype(np.float64) for name in roles.values])
    units = tuple(table.units.get(name) or signal_unit(name) for name in roles.values)
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
            RawTrial(name, values[:, rows], times, columns, roles.values, units, table.rate_hz)
        )
    if 'label' in varying:
        raise SourceError(
            f'{table.path.name}: a trial has several labels; if a row is a sample, name the '
            'column of trials with --column trial=NAME'
        )
    if varying:
        notes.add(f'left out, they change within a trial: {", ".join(sorted(varying))}')
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
    table: Table, roles: Roles, notes: Notes
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
        notes.add(f'a trial is named by {" and ".join(names)} together')
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


def assign_roles(table: Table, stated: Mapping[str, tuple[str, ...]], notes: Notes) -> Roles:
    """Return what each column is, by what is stated, or its name."""
    for role, names in stated.items():
        for name in names:
            bare = name.rpartition(':')[0] or name if role == 'time' else name
            if bare not in table.columns and name not in table.columns:
                raise SourceError(
                    f'{table.path.name} has no column "{name}"; there are: '
                    f'{", ".join(table.columns)}'
                )
    short = {name: split_unit(name)[0] for name in table.columns}

    def named(role: str) -> str:
        found = [name for name, bare in short.items() if bare in NAMES[role]]
        if len(found) > 1:
            raise ambiguity(
                f'{table.path.name} has several columns that may be the {role}',
                found,
                f'--column {role}=NAME',
                found[0],
            )
        return found[0] if found else ''

    trial = stated.get('trial') or ((named('trial'),) if named('trial') else ())
    label = stated.get('label', (named('label'),))[0]
    time, unit_s = _find_time(table, stated, named)
    values = stated.get('value') or table.values
    values = values or _find_values(table, time, (*trial, label), short)
    for name in values:
        _check_numeric(table, name)
    roles = Roles(values, time, unit_s, trial, label)
    _note_roles(table, roles, notes)
    return roles


def _find_time(
    table: Table, stated: Mapping[str, tuple[str, ...]], named: Callable[[str], str]
) -> tuple[str, float]:
    """Return the column of times and its unit [s]."""
    unit = ''
    if 'time' in stated:
        name = stated['time'][0]
        if name not in table.columns:
            name, _, unit = name.rpartition(':')
            if unit not in UNITS_S:
                raise SourceError(
                    f'--column time={name}:{unit}: the unit is none of {", ".join(UNITS_S)}'
                )
    elif table.times:
        name = min(table.times)
    else:
        name = named('time')
    if not name:
        return '', 1.0
    if name in table.times:
        return name, 1e-9
    _check_numeric(table, name)
    unit = unit or split_unit(name)[1]
    if unit not in UNITS_S:
        unit = _guess_unit(table, name)
    return name, UNITS_S[unit]


def _guess_unit(table: Table, name: str) -> str:
    """Return seconds where the usual step between samples suggests them; otherwise refuse."""
    steps = np.diff(table.columns[name].astype(np.float64))
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    step = float(np.median(steps)) if len(steps) else 0.0
    if 0.0 < step <= 0.2:
        return 's'
    raise ambiguity(
        f'the unit of the times in {table.path.name}, column "{name}", is not known '
        f'(usual step {step:g})',
        tuple(UNITS_S),
        f'--column time={name}:UNIT',
        's' if 0.0 < step < 1.0 else '',
        with_layout=False,
    )


def _find_values(
    table: Table, time: str, keys: tuple[str, ...], short: Mapping[str, str]
) -> tuple[str, ...]:
    taken = (time, *keys)
    free = [
        name
        for name, column in table.columns.items()
        if name not in taken and column.dtype.kind in 'fiu' and short[name] not in _NO_SIGNALS
    ]
    first = np.ones(len(table), dtype=bool)  # the rows of the first trial
    for name in filter(None, keys):
        first &= table.columns[name] == table.columns[name][0]
    changing = [n for n in free if len(np.unique(table.columns[n][first])) > 1] or free
    if len(changing) == 1:
        return (changing[0],)
    if not changing:
        raise SourceError(
            f'{table.path.name} has no column of numbers beside time, trial and label; there '
            f'are: {", ".join(table.columns)}\n{LAYOUT}'
        )
    likely = [
        name
        for name in changing
        if _SIGNAL.match(short[name]) or split_unit(name)[1] in _FORCE_UNITS
    ]
    raise ambiguity(
        f'which column of {table.path.name} is the signal is not known',
        changing,
        '--column value=NAME[,NAME...]',
        ','.join(likely),
    )


def _check_numeric(table: Table, name: str) -> None:
    column = table.columns[name]
    if column.dtype.kind in 'fiu':
        return
    row, cell = next(
        ((row, cell) for row, cell in enumerate(column.tolist()) if not _is_number(cell)),
        (0, column[0]),
    )
    raise SourceError(
        f'{table.path.name}: column "{name}" must hold numbers, and row {row} of its data holds '
        f'"{cell}"'
    )


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _note_roles(table: Table, roles: Roles, notes: Notes) -> None:
    parts = [f'signal: {", ".join(roles.values)}']
    if roles.time:
        unit = next(unit for unit, size in UNITS_S.items() if size == roles.time_unit_s)
        parts.append(f'time: {roles.time} in {unit}')
    if roles.trial:
        parts.append(f'trial: {", ".join(roles.trial)}')
    if roles.label:
        parts.append(f'label: {roles.label}')
    notes.add('took ' + '; '.join(parts))
