# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted YAML: plain values only, of bounded size and depth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tactile_ros.errors import TactileError

MAX_DEPTH = 32
"""Deepest nesting; what is read here needs ten levels."""

# The parser of libyaml reads twenty times faster, where it is installed.
_LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def read_text(path: Path, max_bytes: int) -> str:
    """Return the text of a file.

    Raises
    ------
    TactileError
        When it is too large, unreadable or not UTF-8.
    """
    try:
        with path.open('rb') as file:
            data = file.read(max_bytes + 1)
        if len(data) > max_bytes:
            raise TactileError(f'it is larger than {max_bytes} bytes')
        return data.decode()
    except UnicodeDecodeError:
        raise TactileError('it is not UTF-8') from None
    except OSError as error:
        raise TactileError(f'{error.strerror}') from error


def parse_plain_yaml(text: str) -> Any:
    """Return what a YAML text holds: mappings, lists, texts, numbers.

    An alias lets a few bytes stand for any number of values, and a parser goes as deep as
    the text tells it to; so neither is accepted before the values are built. Tags cannot
    name anything but plain values, and make no objects.

    Raises
    ------
    TactileError
        When it is no YAML, has aliases or is nested too deeply.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            if isinstance(event, yaml.AliasEvent):
                raise TactileError('it has YAML aliases; write the values themselves')
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
                if depth > MAX_DEPTH:
                    raise TactileError(f'it is nested deeper than {MAX_DEPTH} levels')
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
        return yaml.load(text, Loader=_LOADER)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, TypeError) as error:
        raise TactileError(f'it is no YAML: {" ".join(str(error).split())[:200]}') from None
