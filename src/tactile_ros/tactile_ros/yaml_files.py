# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading of untrusted YAML files with PyYAML's safe loader."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

import yaml

from tactile_ros.errors import TactileError

MAX_DEPTH = 32
"""Largest allowed nesting depth. The files of this project need ten levels."""

# If libyaml is installed, its parser is twenty times faster.
_Safe: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_SafeDumper: Any = yaml.SafeDumper


class _Loader(_Safe):
    """PyYAML's safe loader with three changes.

    ``1:30`` is read as a text instead of a sexagesimal number of YAML 1.1. ``1e-3`` is read as a
    number. A mapping in which a key occurs twice is refused.
    """

    def number(self, node: Any, construct: Any) -> Any:
        text = self.construct_scalar(node)
        return text if ':' in text else construct(self, node)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        names: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in names:
                    raise yaml.MarkedYAMLError(
                        problem=f'the key {key.value[:40]!a} occurs twice; remove one',
                        problem_mark=key.start_mark,
                    )
                names.add(key.value)
        return super().construct_mapping(node, deep)


_EXPONENT = re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+\Z')
_Loader.add_implicit_resolver('tag:yaml.org,2002:float', _EXPONENT, list('-+.0123456789'))


class Dumper(_SafeDumper):
    """PyYAML's safe dumper. It also quotes texts that `_Loader` reads as numbers (``1e3``)."""


Dumper.add_implicit_resolver('tag:yaml.org,2002:float', _EXPONENT, list('-+.0123456789'))
_Loader.add_constructor(
    'tag:yaml.org,2002:int', lambda loader, node: loader.number(node, _Safe.construct_yaml_int)
)
_Loader.add_constructor(
    'tag:yaml.org,2002:float', lambda loader, node: loader.number(node, _Safe.construct_yaml_float)
)


def read_text(path: Path, max_bytes: int) -> str:
    """Return the text of a file.

    Raises
    ------
    TactileError
        If it is not a regular file, is larger than ``max_bytes``, or is not UTF-8.
    """
    try:
        if path.exists() and not path.is_file():  # reading a pipe might block
            raise TactileError('it is not a regular file')
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
    """Return the contents of a YAML text: mappings, lists, texts, numbers.

    Raises
    ------
    TactileError
        If the text is not valid YAML, contains aliases, or is nested deeper than `MAX_DEPTH`. With
        aliases, a short text could expand to a huge number of values. Deep nesting crashes the
        loader of libyaml.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent):
                raise TactileError('it contains YAML aliases; write the values instead')
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise TactileError(f'it is nested deeper than {MAX_DEPTH} levels')
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, TypeError) as error:
        raise TactileError(f'it is not valid YAML: {" ".join(str(error).split())[:200]}') from None
