# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page about the code's layout, and its picture: modules, their first lines, real imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
import functools
from pathlib import Path
import re
from typing import Any

BEGIN, END = '<!-- modules: begin -->\n', '<!-- modules: end -->\n'

LAYERS = (
    ('tactile_lab',),
    ('tactile_bringup', 'tactile_analysis'),
    ('tactile_sim', 'tactile_bags'),
    ('tactile_classifier',),
    ('tendon_sensor_driver', 'linear_guide_driver', 'tactile_features'),
    ('tactile_ros',),
)
"""From top to bottom, as the first import contract of pyproject.toml states them."""


@dataclass
class Module:
    """One module: what its docstring says first, its length, who it imports of ours."""

    name: str
    summary: str
    line_count: int
    imports: set[str] = field(default_factory=set)


@functools.cache
def read_modules(source: Path) -> dict[str, Module]:
    """Return the modules of all packages, by dotted name; ``source`` is the folder ``src``."""
    found = {}
    for package in (name for layer in LAYERS for name in layer):
        root = source / package / package
        for path in sorted(root.rglob('*.py')):
            parts = path.relative_to(root.parent).with_suffix('').parts
            name = '.'.join(parts).removesuffix('.__init__')
            tree = ast.parse(path.read_text('utf-8'))
            summary = (ast.get_docstring(tree) or '').split('\n\n')[0].replace('\n', ' ')
            count = len(path.read_text('utf-8').splitlines())
            found[name] = Module(name, summary, count, set(_imports(tree)))
    for module in found.values():
        module.imports = {_owner(name, found) for name in module.imports} - {'', module.name}
    return found


def _imports(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def _owner(name: str, modules: dict[str, Module]) -> str:
    """Return the module that a dotted name is in; empty: it is none of ours."""
    while name not in modules and '.' in name:
        name = name.rpartition('.')[0]
    return name if name in modules else ''


def count_arrows(modules: dict[str, Module]) -> dict[tuple[str, str], int]:
    """Return how many modules of one package import another package."""
    arrows: dict[tuple[str, str], int] = {}
    for module in modules.values():
        own = module.name.partition('.')[0]
        for other in {name.partition('.')[0] for name in module.imports} - {own}:
            arrows[own, other] = arrows.get((own, other), 0) + 1
    return arrows


def build_tables(source: Path) -> str:
    """Return a table for each package, with what its modules are."""
    modules = read_modules(source)
    parts = []
    for package in (name for layer in LAYERS for name in layer):
        own = [m for m in modules.values() if m.name.startswith(f'{package}.') and m.summary]
        rows = [f'| `{m.name.partition(".")[2]}` | {_as_cell(m.summary)} |' for m in own]
        head = (
            f'### {package}\n\n{modules[package].summary}\n\n| module | what it is |\n|---|---|\n'
        )
        parts.append(head + '\n'.join(rows) + '\n')
    return '\n'.join(parts)


def _as_cell(text: str) -> str:
    return re.sub(r'``?', '`', text).replace('|', '\\|')


def replace_tables(page: str, tables: str) -> str:
    """Return the page with these tables."""
    before, rest = page.split(BEGIN)
    return before + BEGIN + '\n' + tables + '\n' + END + rest.split(END)[1]


def draw_layout(source: Path, axes: Any) -> None:
    """Draw the packages, with their sizes, and who imports whom."""
    modules = read_modules(source)
    places = {}
    for row, layer in enumerate(reversed(LAYERS)):
        for k, package in enumerate(layer):
            places[package] = ((k + 0.5) * 12.0 / len(layer), 2.2 * row)
    for (own, other), count in sorted(count_arrows(modules).items()):
        (x0, y0), (x1, y1) = places[own], places[other]
        bend = 0.0 if abs(x0 - x1) > 0.1 or abs(y0 - y1) < 2.5 else 0.28
        axes.annotate(
            '',
            (x1, y1 + 0.62),
            (x0, y0 - 0.62),
            arrowprops={
                'arrowstyle': '-|>',
                'lw': 0.5 + 0.08 * min(count, 30),
                'color': '#7f8ea3',
                'alpha': 0.75,
                'connectionstyle': f'arc3,rad={bend}',
                'shrinkA': 0,
                'shrinkB': 0,
            },
            zorder=1,
        )
    for package, (x, y) in places.items():
        own = [m for m in modules.values() if m.name.split('.')[0] == package]
        axes.text(
            x,
            y,
            f'{package}\n{len(own)} modules, {sum(m.line_count for m in own):,} lines',
            ha='center',
            va='center',
            fontsize=9,
            linespacing=1.5,
            bbox={'boxstyle': 'round,pad=0.55', 'fc': 'white', 'ec': '#1f5fae', 'lw': 1.2},
            zorder=2,
        )
    axes.set_xlim(0.0, 12.0)
    axes.set_ylim(-1.0, 2.2 * len(LAYERS) - 1.2)
    axes.axis('off')


def find_missing(page: str, source: Path) -> list[str]:
    """Return the steps of the page's walks that name nothing in the code."""
    modules = read_modules(source)
    steps = re.findall(r'^\| `([\w.]+)` \|', page.split(BEGIN)[0], re.MULTILINE)
    return [step for step in steps if not _is_there(step, modules, source)]


def _is_there(step: str, modules: dict[str, Module], source: Path) -> bool:
    owner = _owner(step, modules)
    names = step.removeprefix(owner).strip('.').split('.')
    if not owner or names == ['']:
        return bool(owner)
    path = source / owner.split('.')[0] / Path(*owner.split('.'))
    path = path / '__init__.py' if path.is_dir() else path.with_suffix('.py')
    text = path.read_text('utf-8')
    if path.name == '__init__.py':  # offered there, defined elsewhere
        return f"'{names[0]}'" in text
    body: list[ast.stmt] = ast.parse(text).body
    for name in names:
        found = [n for n in body if getattr(n, 'name', '') == name]
        if not found:
            return False
        body = getattr(found[0], 'body', [])
    return True
