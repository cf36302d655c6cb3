# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines and tables on a terminal or in a pipe, without breaks inside values.

In a pipe, each row is one line of any length, so that `grep` finds names and paths. On a terminal,
the cells of a table are folded: sentences between words, lists between values. If the table is
still too wide, its spare columns are hidden, and their names are printed below it. Lines of text
are not folded here, because the terminal wraps them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

from rich.cells import cell_len, set_cell_size
from rich.console import Console
import rich.table
from rich.text import Text

from tactile_ros.errors import plain_text

GAP = '  '
"""Gap between the columns of a table in a pipe."""


class Prose(str):
    """A cell that may be folded between words, such as a sentence."""

    __slots__ = ()


Cell: TypeAlias = str | Sequence[str]
"""A value, a `Prose`, or a list of values."""


class Table:
    """Rows of cells.

    Parameters
    ----------
    *header : str
        Names of the columns. Without names, the table has no header line.
    title : str
        Line of text above the table.
    right_from : int, optional
        Columns from this index on are right-aligned, for numbers.
    spare : sequence of str
        Columns that are hidden on a terminal if the table is too wide, the least important first.
    """

    def __init__(
        self,
        *header: str,
        title: str = '',
        right_from: int | None = None,
        spare: Sequence[str] = (),
    ) -> None:
        self.title = title
        self.header = header
        self._spare = spare
        self._right_from = right_from
        self._rows: list[tuple[list[list[str]], str]] = []

    def add_row(self, *cells: Cell, style: str = '') -> None:
        """Append a row; ``style`` is a rich style for the terminal, such as red."""
        self._rows.append(([_split(cell) for cell in cells], style))

    def plain_lines(self) -> Iterator[str]:
        """Yield a line for the header, if there is one, and for each row."""
        rows = [[' '.join(cell) for cell in row] for row, _ in self._rows]
        if self.header:
            rows.insert(0, [plain_text(name) for name in self.header])
        widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            cells = [
                ' ' * (width - cell_len(cell)) + cell
                if self._is_right(i)
                else set_cell_size(cell, width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            ]
            yield GAP.join(cells).rstrip()

    def fit(self, width: int) -> rich.table.Table:
        """Return the table for rich, at most ``width`` columns wide unless a value is longer."""
        columns, kept = self._columns(), self.choose_columns(width)
        borders = _borders(len(kept))
        widths = _share(
            [_least_width(columns[i]) for i in kept],
            [max(cell_len(' '.join(cell)) for cell in columns[i]) for i in kept],
            width - borders,
        )
        drawn = rich.table.Table(show_header=bool(self.header), width=sum(widths) + borders)
        for i, at_most in zip(kept, widths, strict=True):
            name = Text(columns[i][0][0]) if self.header else ''
            justify: Any = 'right' if self._is_right(i) else 'left'
            drawn.add_column(name, width=at_most, no_wrap=True, justify=justify)
        for row, style in self._rows:
            lines = (_fold(row[i], at_most) for i, at_most in zip(kept, widths, strict=True))
            drawn.add_row(*map(Text, lines), style=style)
        return drawn

    def choose_columns(self, width: int) -> list[int]:
        """Return the indices of the columns that a terminal of this width shows."""
        least = [_least_width(column) for column in self._columns()]
        kept = list(range(len(least)))
        for name in self._spare:
            if _borders(len(kept)) + sum(least[i] for i in kept) <= width:
                break
            if name in self.header:
                kept.remove(self.header.index(name))
        return kept

    def _columns(self) -> list[tuple[list[str], ...]]:
        """Return the cells of each column, with its name first if the table has a header."""
        header = [[plain_text(name)] for name in self.header]
        rows = [row for row, _ in self._rows]
        return list(zip(*([header] if header else []), *rows, strict=True))

    def _is_right(self, column: int) -> bool:
        return self._right_from is not None and column >= self._right_from


def _borders(columns: int) -> int:
    return 3 * columns + 1


def _least_width(column: Sequence[Sequence[str]]) -> int:
    """Return the width of the longest part of a cell, because parts are never broken."""
    return max(cell_len(part) for cell in column for part in [*cell, ''])


def _split(cell: Cell) -> list[str]:
    """Return the parts of a cell, which are never broken."""
    if isinstance(cell, Prose):
        parts = cell.split()
    elif isinstance(cell, str):
        parts = [cell]
    else:
        parts = [f'{value},' for value in cell[:-1]] + list(cell[-1:])
    return [plain_text(part) for part in parts]


def _fold(parts: Sequence[str], width: int) -> str:
    """Join the parts to lines of at most ``width`` characters, unless a part is longer."""
    lines: list[str] = []
    for part in parts:
        if lines and cell_len(lines[-1]) + 1 + cell_len(part) <= width:
            lines[-1] += f' {part}'
        else:
            lines.append(part)
    return '\n'.join(lines)


def _share(least: Sequence[int], wanted: Sequence[int], width: int) -> list[int]:
    """Return the widths of the columns, at least ``least``.

    Remaining width is given to the narrowest columns first, up to their ``wanted`` width.
    """
    widths = list(least)
    for _ in range(width - sum(least)):
        growing = [i for i, each in enumerate(widths) if each < wanted[i]]
        if not growing:
            break
        widths[min(growing, key=lambda i: widths[i])] += 1
    return widths


class PlainConsole(Console):
    """A console for untrusted names: it does not interpret markup in text or cells."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(plain_text(text, '\n\t'), **options)

    def say(self, text: str, *, markup: bool = False, style: str = '') -> None:
        """Print lines of text without adding line breaks."""
        self.print(text, soft_wrap=True, markup=markup, style=style)

    def say_table(self, table: Table) -> None:
        """Print a table."""
        if table.title:
            self.say(table.title, style='bold')
        if self.file.isatty():
            self.print(table.fit(self.width), soft_wrap=True)
            kept = table.choose_columns(self.width)
            if hidden := [name for i, name in enumerate(table.header) if i not in kept]:
                self.say(
                    f'hidden columns, shown on a wider terminal or with `| cat`: '
                    f'{", ".join(map(plain_text, hidden))}',
                    style='dim',
                )
        else:
            for line in table.plain_lines():
                self.say(line)
