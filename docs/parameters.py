# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of docs/parameters.md: node parameters and launch arguments, generated from the code."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from constants import replace_tables

from tactile_bringup.launch_config.parameter_files import CONFIGS

PACKAGE = Path(__file__).resolve().parents[1] / 'src' / 'tactile_bringup'
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


def build_parameter_tables() -> str:
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
    tree = ast.parse((PACKAGE / 'launch' / f'{name}.launch.py').read_text())
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
    launching = PACKAGE / 'tactile_bringup' / 'launch_config' / 'launching.py'
    shared = ast.parse(launching.read_text())
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


def build_argument_tables() -> str:
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


def replace_all_tables(page: str) -> str:
    """Return the page with new tables of parameters and of launch arguments."""
    page = replace_tables(page, 'parameters', f'{build_parameter_tables()}\n')
    return replace_tables(page, 'launch arguments', f'{build_argument_tables()}\n')
