# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Dialect of a text table: header lines, separator, decimal sign, column names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import csv
from dataclasses import dataclass
import re

SEPARATORS = (',', ';', '\t', ' ')
SAMPLE_LINES = 100
"""Lines from which the form is taken."""

_NUMBER = {
    mark: re.compile(rf'[+-]?(\d+([{mark}]\d*)?|[{mark}]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)', re.I)
    for mark in '.,'
}
_UNIT_NAMES = (
    's ms us µs μs ns min Hz N mN kN g kg V mV µV A mA m mm µm deg rad ° °C C K % Pa kPa MPa bar '
    'Nm mNm mm/s m/s counts raw 1 - n/a'
)
_UNITS = frozenset(_UNIT_NAMES.split())


@dataclass(frozen=True)
class Dialect:
    """The form of a text table.

    Attributes
    ----------
    names : tuple of str
        Of the columns; ``column 1`` and so on where the text has none.
    first_line : int
        Number of the first line of data, from 0.
    is_named : bool
        Whether the names stand in the text.
    """

    separator: str
    decimal: str
    names: tuple[str, ...]
    first_line: int
    is_named: bool


def find_dialect(lines: Sequence[str]) -> Dialect | None:
    """Return the form of the first lines of a text; None where they hold no table of numbers.

    The separator and decimal sign are those that make most cells of most lines numbers.
    Column names stand in the last line without a number before the data; the units of the
    columns may stand in one more line below it.
    """
    lines = [line.rstrip('\r\n') for line in lines[:SAMPLE_LINES]]
    best: tuple[float, int, int] = (0.0, 0, 0)
    form = None
    for separator in SEPARATORS:
        for decimal in '.,':
            counts = [_count_numbers(line, separator, decimal) for line in lines]
            rows = Counter(count for count in counts if count[0])
            if decimal == separator or not rows:
                continue
            (numbers, width), times = max(rows.items(), key=lambda row: (row[1], row[0]))
            if (numbers / width, times, numbers) > best:
                best, form = (numbers / width, times, numbers), (separator, decimal, width)
    return None if form is None else _find_begin(lines, *form)


def _count_numbers(line: str, separator: str, decimal: str) -> tuple[int, int]:
    """Return how many cells of a line are numbers, and how many it has."""
    cells = _split_line(line, separator)
    return sum(_NUMBER[decimal].fullmatch(cell) is not None for cell in cells), len(cells)


def _split_line(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without quotes and blanks around them."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _find_begin(lines: Sequence[str], separator: str, decimal: str, width: int) -> Dialect:
    first = len(lines)
    while first > 0:  # up to the last line without a number
        line = lines[first - 1]
        if line.strip() and not _count_numbers(line, separator, decimal)[0]:
            break
        first -= 1
    above = [line for line in lines[:first] if line.strip()]
    rows = [_split_line(line.lstrip('#% '), separator) for line in above[-2:]]
    rows = [row for row in rows if len(row) == width and all(row)]
    units = [cell.strip('[]()') for cell in rows[-1]] if rows else []
    if len(rows) == 2 and _UNITS.issuperset(units) and len(set(rows[0])) == width:
        names = [f'{name} [{unit}]' for name, unit in zip(*rows, strict=True)]
    elif rows and rows[-1] == _split_line(above[-1].lstrip('#% '), separator):
        names = rows[-1]
    else:
        names = []
    if len(set(names)) != width:
        numbered = tuple(f'column {i + 1}' for i in range(width))
        return Dialect(separator, decimal, numbered, first, is_named=False)
    return Dialect(separator, decimal, tuple(names), first, is_named=True)
