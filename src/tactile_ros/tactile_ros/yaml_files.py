# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted YAML files, by PyYAML's safe loader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tactile_ros.errors import TactileError

MAX_DEPTH = 32
"""Deepest nesting; what is read here needs ten levels."""

# The parser of libyaml reads twenty times faster, where it is installed.
_Safe: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class _Loader(_Safe):
    """The safe loader, without the numbers to base 60 of YAML 1.1: ``1:30`` is a text."""

    def number(self, node: Any, construct: Any) -> Any:
        text = self.construct_scalar(node)
        return text if ':' in text else construct(self, node)


_Loader.add_constructor(
    'tag:yaml.org,2002:int', lambda loader, node: loader.number(node, _Safe.construct_yaml_int)
)
_Loader.add_constructor(
    'tag:yaml.org,2002:float', lambda loader, node: loader.number(node, _Safe.construct_yaml_float)
)


def read_text(path: Path, max_bytes: int) -> str:
    """Return the text of a file; `TactileError` when it is none, too large or not UTF-8."""
    try:
        if path.exists() and not path.is_file():  # a pipe would wait for its other end
            raise TactileError('it is no file')
        with path.open('rb') as file:
            data = file.read(max_bytes + 1)
        if len(data) > max_bytes:
            raise TactileError(f'it is larger than {max_bytes} bytes')
        return data.decode()
    except UnicodeDecodeError:
        raise TactileError('it is not UTF-8') from None
    except OSError as error:
        raise TactileError(f'{error.strerror}') from error


def load_yaml(text: str) -> Any:
    """Return what a YAML text holds: mappings, lists, texts, numbers.

    An alias lets a few bytes stand for any number of values, and libyaml's loader crashes on a
    text that is nested too deeply; so both are a `TactileError` before the values are built.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent):
                raise TactileError('it has YAML aliases; write the values themselves')
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise TactileError(f'it is nested deeper than {MAX_DEPTH} levels')
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, TypeError) as error:
        raise TactileError(f'it is no YAML: {" ".join(str(error).split())[:200]}') from None
