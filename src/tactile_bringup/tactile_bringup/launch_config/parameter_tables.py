# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Markdown tables of node parameters and launch arguments, generated from the code.

``python -m tactile_bringup.launch_config.parameter_tables FILE`` updates the tables between the
markers in a page.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
import dataclasses
from pathlib import Path
import sys
from typing import Any, NamedTuple

from tactile_bringup.launch_config.parameter_files import CONFIGS

LAUNCH_FOLDER = Path(__file__).resolve().parents[2] / 'launch'
ARGUMENTS_OF = {
    'texture.launch.py`**, **`stiffness': 'rig',
    'hand.launch.py`**, **`sense': 'hand',
    'replay': 'replay',
}
"""Title of each table of arguments, and the launch file that declares them."""


class LaunchArgument(NamedTuple):
    """One declared argument of a launch file."""

    name: str
    default: str
    choices: tuple[str, ...]
    description: str


def parameter_tables() -> str:
    """Return one table per node: name, default, unit, allowed values, meaning.

    A sentence before each table says when the node reads its parameters.
    """
    header = ('parameter', 'default', 'unit', 'allowed', 'meaning')
    tables = []
    for node, config_class in CONFIGS.items():
        fields = dataclasses.fields(config_class)
        live = [f'`{f.name}`' for f in fields if f.metadata.get('live')]
        when = (
            f'Live: {", ".join(live)}. The other parameters are read at configure.'
            if live
            else 'Live: none. All parameters are read at configure.'
        )
        tables.append(f'**`{node}`**\n\n{when}\n\n{_table(header, map(_row, fields))}')
    return '\n'.join(tables)


def _row(field: dataclasses.Field[Any]) -> tuple[str, ...]:
    metadata = field.metadata
    allowed = _choices(metadata.get('choices', ()))
    if 'range' in metadata:
        low, high = (f'{x:g}' if isinstance(x, float) else str(x) for x in metadata['range'])
        allowed = f'{low} to {high}'
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    shown = f'`{default}`' if default != '' else ''
    unit = metadata.get('unit') or ''
    return f'`{field.name}`', shown, unit, allowed, metadata['description']


def read_launch_arguments(name: str) -> tuple[LaunchArgument, ...]:
    """Return the declared arguments of a launch file; does not need ``launch``.

    The file is parsed and not executed, so the arguments of each call must be literals. Shared
    arguments are read from `launching.shared_arguments`.
    """
    tree = ast.parse((LAUNCH_FOLDER / f'{name}.launch.py').read_text())
    changed: dict[str, str] = {}
    found = []
    for call in ast.walk(tree):
        called = getattr(getattr(call, 'func', None), 'id', '')
        if not isinstance(call, ast.Call):
            continue
        words = {w.arg: w.value for w in call.keywords if w.arg}
        if called == 'DeclareLaunchArgument':
            options = {key: ast.literal_eval(value) for key, value in words.items()}
            found.append(
                LaunchArgument(
                    ast.literal_eval(call.args[0]),
                    options.get('default_value', ''),
                    tuple(options.get('choices', ())),
                    options['description'],
                )
            )
        elif called == 'shared_arguments':
            changed = {key: ast.literal_eval(value) for key, value in words.items()}
    shared = ast.parse(Path(__file__).with_name('launching.py').read_text())
    described, choices = (
        ast.literal_eval(node.value)
        for name in ('described', 'choices')
        for node in ast.walk(shared)
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == name
    )
    return (
        *found,
        *(
            LaunchArgument(key, changed.get(key, default), tuple(choices.get(key, ())), text)
            for key, (default, text) in described.items()
        ),
    )


def argument_tables() -> str:
    """Return one table per launch file: argument, default, choices, meaning."""
    header = ('argument', 'default', 'choices', 'meaning')
    return '\n'.join(
        f'**`{title}.launch.py`**\n\n'
        + _table(header, map(_argument_row, read_launch_arguments(name)))
        for title, name in ARGUMENTS_OF.items()
    )


def _argument_row(argument: LaunchArgument) -> tuple[str, ...]:
    default = f'`{argument.default}`' if argument.default else ''
    return f'`{argument.name}`', default, _choices(argument.choices), argument.description


def _choices(choices: Iterable[str]) -> str:
    return ', '.join(f'`{choice}`' if choice else '(empty)' for choice in choices)


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f'| {" | ".join(cells)} |' for cells in (header, *rows)]
    lines.insert(1, '|---' * len(header) + '|')
    return '\n'.join(lines) + '\n'


def renew(text: str) -> str:
    """Return ``text`` with updated tables between its markers; ValueError if they are missing."""
    for name, tables in (
        ('parameters', parameter_tables()),
        ('launch arguments', argument_tables()),
    ):
        begin, end = f'<!-- {name}: begin -->', f'<!-- {name}: end -->'
        head, rest = text.split(begin)
        _, tail = rest.split(end)
        text = f'{head}{begin}\n{tables}\n{end}{tail}'
    return text


if __name__ == '__main__':
    page = Path(sys.argv[1])
    page.write_text(renew(page.read_text()))
