# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Table of the simulator's constants: key, value and source of each line of its YAML files."""

from __future__ import annotations

from pathlib import Path
import re

_LINE = re.compile(r'^(?P<indent> *)(?P<key>\w+):\s*(?P<value>[^#]*?)\s*(#\s*(?P<source>.*))?$')
FILES = ('finger_flexion', 'finger_abduction', 'rig', 'plates', 'objects')


def build_tables(config: Path) -> str:
    """Return a Markdown table for each YAML file.

    The comment at the top of the file is the paragraph above its table.
    """
    return '\n'.join(_build_table(config / f'{name}.yaml') for name in FILES)


def replace_tables(page: str, name: str, tables: str) -> str:
    """Return the page with new tables between two lines that are comments with this name."""
    begin, end = f'<!-- {name}: begin -->', f'<!-- {name}: end -->'
    before, rest = page.split(begin)
    return f'{before}{begin}\n{tables}{end}{rest.split(end)[1]}'


def _build_table(path: Path) -> str:
    heading, rows, parents = [], [], ['']
    for line in path.read_text(encoding='utf-8').splitlines():
        text = line.strip()
        if text.startswith('#') and not rows:
            heading.append(text.lstrip('# '))
            continue
        if not text or text.startswith('{'):
            if text:  # this line has the value of the key in the line above
                rows[-1] = (rows[-1][0], text.strip('{}'), rows[-1][2])
            continue
        if text.startswith('#'):  # this line continues the comment of the line above
            key, value, source = rows[-1]
            rows[-1] = (key, value, f'{source} {text.lstrip("# ")}')
            continue
        match = _LINE.match(line)
        if match is None:
            raise ValueError(f'{path.name}: cannot read {line!r}')
        depth = len(match['indent']) // 2
        parents[depth:] = [match['key']]
        rows.append(('.'.join(parents), match['value'].strip('{}'), match['source'] or ''))
    lines = [f'**{path.name}.** {" ".join(heading)}', '', '| | | source |', '|---|---|---|']
    lines += [f'| `{key}` | {value} | {source} |' for key, value, source in rows]
    return '\n'.join(lines) + '\n'
