# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables for terminals and pipes, and the help of the commands."""

import io

from hypothesis import given
from hypothesis import strategies as st
import pytest
from rich.cells import cell_len
from rich.console import Console
from typer.testing import CliRunner

from tactile_lab.console import PlainConsole, Prose, Table
from tactile_lab.program import app, COMMANDS, load_command
from tactile_ros.errors import plain_text

VALUES = st.text('ab /-é名\x1b\n', max_size=30)
CELLS = st.one_of(VALUES, VALUES.map(Prose), st.lists(VALUES, max_size=4))
ROWS = st.lists(st.tuples(CELLS, CELLS, CELLS), min_size=1, max_size=4)
BORDERS = 3 * 3 + 1


def draw(table, width):
    """Return the lines that are printed for a table on a terminal with ``width`` columns."""
    console = Console(file=io.StringIO(), width=width)
    console.print(table.fit(width), soft_wrap=True)
    return console.file.getvalue().splitlines()


def parts_of(cell):
    """Return the parts of a cell that no line break may divide."""
    if isinstance(cell, Prose):
        return cell.split()
    return [cell] if isinstance(cell, str) else [f'{value},' for value in cell]


def test_in_a_pipe_columns_have_no_borders(capsys):
    table = Table('name', 'count', 'why', title='two', right_from=1)
    table.add_row('名 with [red]', '7', Prose('a\nsentence'), style='red')
    table.add_row(['a', 'b\x1b[2J'], '12', '')
    PlainConsole().say_table(table)
    assert capsys.readouterr().out.splitlines() == [
        'two',
        'name           count         why',
        '名 with [red]      7  a sentence',
        'a, b?[2J          12',
    ]


def test_terminal_folds_sentences_and_lists_but_not_values():
    table = Table()
    table.add_row('/a path/of-some/length', Prose('a sentence with a long-hyphenated-word in it'))
    table.add_row(['/one/path', '/another path'], Prose(''))
    cells = [[cell.strip() for cell in line.split('│')[1:-1]] for line in draw(table, 50)[1:-1]]
    assert cells == [
        ['/a path/of-some/length', 'a sentence with a'],
        ['', 'long-hyphenated-word'],
        ['', 'in it'],
        ['/one/path,', ''],
        ['/another path', ''],
    ]


def test_narrow_terminal_hides_spare_columns_and_a_pipe_shows_all(capsys):
    table = Table('trial', 'session', 'seconds', 'trial_id', spare=['session', 'seconds'])
    table.add_row('1', 'monday-afternoon', '3.00', '20261128T120000-0001')
    shown = {width: draw(table, width)[1] for width in (80, 55, 40, 10)}
    for name, widths in (
        ('trial_id', (80, 55, 40, 10)),
        ('seconds', (80, 55)),
        ('session', (80,)),
    ):
        assert [width for width in shown if name in shown[width]] == list(widths)
    assert max(map(cell_len, draw(table, 55))) <= 55
    (header, row) = table.plain_lines()
    assert header.split() == ['trial', 'session', 'seconds', 'trial_id']
    assert row.split() == ['1', 'monday-afternoon', '3.00', '20261128T120000-0001']


@given(ROWS, st.integers(10, 120))
def test_table_is_not_wider_than_the_terminal_unless_a_value_is_longer(rows, width):
    table = Table('a', 'b', 'c')
    for row in rows:
        table.add_row(*row)
    least = BORDERS + sum(
        max(1, *(cell_len(plain_text(part)) for cell in column for part in ['', *parts_of(cell)]))
        for column in zip(*rows, strict=True)
    )
    assert max(map(cell_len, draw(table, width))) <= max(width, least)
    assert len(list(table.plain_lines())) == 1 + len(rows)


@pytest.mark.parametrize('columns', [40, 80])
@pytest.mark.parametrize('name', COMMANDS)
def test_help_has_the_whole_name_of_each_option(monkeypatch, name, columns):
    monkeypatch.setenv('COLUMNS', str(columns))
    command = load_command(name)
    for words, each in [
        ([], command),
        *(([n], c) for n, c in getattr(command, 'commands', {}).items()),
    ]:
        said = CliRunner().invoke(app, [name, *words, '--help']).output
        for option in (opt for param in each.params for opt in param.opts if opt.startswith('-')):
            assert f'{option} ' in said or f'{option},' in said, said
        assert '…' not in said
