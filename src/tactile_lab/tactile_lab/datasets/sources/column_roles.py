# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Roles of the columns of a table: time, trial, label and signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import re
from typing import Any

import numpy as np

from tactile_lab.datasets.sources.questions import LAYOUT, Questions, SourceError
from tactile_lab.datasets.sources.table_files import Table

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
_NO_SIGNALS = frozenset((*GROUPS, 'index', 'sample', 'samples', 'sample_index', 'row', ''))


@dataclass(frozen=True)
class Roles:
    """The columns by what they are.

    Attributes
    ----------
    values : tuple of str
        The signal, one a channel.
    time : str
        Empty: there is none.
    time_unit_s : float
        Of ``time`` [s].
    trial : tuple of str
        Together they name a trial; empty: the file is one.
    label : str
        Empty: the file's name or folder says it.
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


def assign_roles(
    table: Table, stated: Mapping[str, tuple[str, ...]], questions: Questions
) -> Roles:
    """Return what each column is, by what is stated, its name, or an answer.

    Raises
    ------
    SourceError
        When it cannot be known, or what is stated does not fit.
    """
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
            return questions.choose(
                f'{table.path.name} has several columns that may be the {role}',
                found,
                f'--column {role}=NAME',
                found[0],
            )
        return found[0] if found else ''

    trial = stated.get('trial') or ((named('trial'),) if named('trial') else ())
    label = stated.get('label', (named('label'),))[0]
    time, unit_s = _find_time(table, stated, named, questions)
    values = stated.get('value') or _find_values(table, time, (*trial, label), short, questions)
    for name in values:
        _check_numeric(table, name)
    roles = Roles(values, time, unit_s, trial, label)
    _tell(table, roles, questions)
    return roles


def _find_time(
    table: Table,
    stated: Mapping[str, tuple[str, ...]],
    named: Callable[[str], str],
    questions: Questions,
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
        name = named('time') if table.is_named else _first_even_column(table)
    if not name:
        return '', 1.0
    if name in table.times:
        return name, 1e-9
    _check_numeric(table, name)
    unit = unit or split_unit(name)[1]
    if unit not in UNITS_S:
        unit = _guess_unit(table, name, questions)
    return name, UNITS_S[unit]


def _guess_unit(table: Table, name: str, questions: Questions) -> str:
    """Return seconds where the usual step between samples suggests them; otherwise ask."""
    steps = np.diff(table.columns[name].astype(np.float64))
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    step = float(np.median(steps)) if len(steps) else 0.0
    if 0.0 < step <= 0.2:
        return 's'
    unit = questions.choose(
        f'the unit of the times in {table.path.name}, column "{name}", is not known '
        f'(usual step {step:g})',
        tuple(UNITS_S),
        f'--column time={name}:UNIT',
        's' if 0.0 < step < 1.0 else '',
        with_layout=False,
    )
    if unit not in UNITS_S:
        raise SourceError(f'"{unit}" is none of {", ".join(UNITS_S)}')
    return unit


def _first_even_column(table: Table) -> str:
    """Return the first column when it rises in even steps, as times do; otherwise nothing."""
    if len(table.columns) < 2:
        return ''
    name, values = next(iter(table.columns.items()))
    if values.dtype.kind != 'f' or len(values) < 3:
        return ''
    steps = np.diff(values)
    return name if steps.min() > 0.0 and steps.max() < 2.0 * steps.min() else ''


def _find_values(
    table: Table,
    time: str,
    keys: tuple[str, ...],
    short: Mapping[str, str],
    questions: Questions,
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
    answer = questions.choose(
        f'which column of {table.path.name} is the signal is not known',
        changing,
        '--column value=NAME[,NAME...]',
        ','.join(likely),
    )
    names = tuple(name.strip() for name in answer.split(','))
    for name in names:
        if name not in table.columns:
            raise SourceError(f'{table.path.name} has no column "{name}"')
    return names


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


def _tell(table: Table, roles: Roles, questions: Questions) -> None:
    parts = [f'signal: {", ".join(roles.values)}']
    if roles.time:
        unit = next(unit for unit, size in UNITS_S.items() if size == roles.time_unit_s)
        parts.append(f'time: {roles.time} in {unit}')
    if roles.trial:
        parts.append(f'trial: {", ".join(roles.trial)}')
    if roles.label:
        parts.append(f'label: {roles.label}')
    questions.note('took ' + '; '.join(parts))
