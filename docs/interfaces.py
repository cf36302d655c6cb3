# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generate docs/interfaces.md from the definitions of the messages and actions."""

from __future__ import annotations

from pathlib import Path
import re

_FIELD = re.compile(
    r'^(?P<type>[\w/]+(\[\])?) +(?P<name>\w+)(=(?P<value>\S+))? *(# *(?P<comment>.*))?$'
)
_PARTS = {'msg': ('',), 'action': ('goal', 'result', 'feedback')}

INTRODUCTION = """\
# Messages and actions of `tactile_msgs`

Generated from the definitions in `src/tactile_msgs` by `docs/generate.py`. Units are SI; the
unit of a field is in brackets.
"""


def build_page(package: Path) -> str:
    """Return the page on all messages and actions in ``package``, the folder of tactile_msgs."""
    parts = [INTRODUCTION]
    for kind, title in (('msg', 'Messages'), ('action', 'Actions')):
        parts.append(f'## {title}\n')
        parts += [_build_section(path, kind) for path in sorted((package / kind).iterdir())]
    return '\n'.join(parts)


def _build_section(path: Path, kind: str) -> str:
    lines = [f'### {path.stem}', '']
    halves = path.read_text(encoding='utf-8').split('\n---\n')
    for part, text in zip(_PARTS[kind], halves, strict=True):
        about, fields, constants = _parse(text)
        if part:
            lines += [f'**{part}** {about}'.strip(), '']
        elif about:
            lines += [about, '']
        if fields:
            lines += ['| field | type | meaning |', '|---|---|---|', *fields, '']
        if constants:
            lines += ['| constant | value | meaning |', '|---|---|---|', *constants, '']
    return '\n'.join(lines)


def _parse(text: str) -> tuple[str, list[str], list[str]]:
    """Return the comment above the first field, the rows of fields and the rows of constants.

    The meaning of a field or constant is the comment at the end of its line, or if there is none,
    the comment lines above it.
    """
    about: list[str] = []
    fields: list[str] = []
    constants: list[str] = []
    above: list[str] = []  # comment lines since the last blank line, field or constant
    for line in map(str.strip, text.splitlines()):
        if not line:
            above = []
            continue
        if line.startswith('#'):
            above.append(line.lstrip('# '))
            if not fields and not constants:
                about.append(above[-1])
            continue
        match = _FIELD.match(line)
        if match is None:
            raise ValueError(f'cannot read {line!r}')
        meaning = match['comment'] or ' '.join(above).rstrip('.')
        above = []
        if match['value'] is None:
            fields.append(f'| `{match["name"]}` | {match["type"]} | {meaning} |')
        else:
            constants.append(f'| `{match["name"]}` | `{match["value"]}` | {meaning} |')
    return ' '.join(about), fields, constants
