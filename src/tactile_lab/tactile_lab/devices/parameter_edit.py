# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Single values set in a ROS parameter file; everything else, comments too, stays as it is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from tactile_bags.yaml_files import load_yaml, read_text
from tactile_lab.output import write_atomically
from tactile_ros.errors import TactileError

MAX_BYTES = 2**20
"""Longest file that is edited [byte]."""

_PARAMETERS = 'ros__parameters'


def set_parameters(path: Path, node: str, values: Mapping[str, float]) -> None:
    """Set parameters of a node in its file, at once; make the file if there is none.

    Raises
    ------
    TactileError
        When the file cannot be read, edited or written.
    """
    try:
        text = read_text(path, MAX_BYTES) if path.exists() else ''
        write_atomically(path, edit_parameters(text, node, values))
    except OSError as error:
        raise TactileError(f'cannot write {path}: {error.strerror}') from error
    except TactileError as error:
        raise TactileError(f'cannot set parameters in {path}: {error}') from error


def edit_parameters(text: str, node: str, values: Mapping[str, float]) -> str:
    """Return the text of a parameter file with some values of a node set.

    Raises
    ------
    TactileError
        When it is no parameter file, or this would change anything else in it.
    """
    before = load_yaml(text)
    if before is not None and not isinstance(before, dict):
        raise TactileError('it is no ROS parameter file: node names are expected on top')
    new = text
    for name, value in values.items():
        new = _edit(new, node, name, repr(float(value)))
    wanted = _expected(before or {}, node, values)
    try:
        is_right = load_yaml(new) == wanted
    except TactileError:
        is_right = False
    if not is_right:
        lines = ', '.join(f'{name}: {float(value)!r}' for name, value in values.items())
        raise TactileError(f'its form is not known here; set under {node} by hand: {lines}')
    return new


def _expected(before: dict[str, object], node: str, values: Mapping[str, float]) -> object:
    keys = [k for k in before if str(k).strip('/') == node]
    if len(keys) > 1:
        raise TactileError(f'it has {" and ".join(map(str, keys))}; keep one of them')
    key = keys[0] if keys else node
    content = before.get(key) or {}
    parameters = content.get(_PARAMETERS) or {} if isinstance(content, dict) else {}
    if not isinstance(content, dict) or not isinstance(parameters, dict):
        raise TactileError(f'{key} has no {_PARAMETERS} below it')
    numbers = {name: float(value) for name, value in values.items()}
    return {**before, key: {**content, _PARAMETERS: {**parameters, **numbers}}}


def _edit(text: str, node: str, name: str, value: str) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    of_node = _find(root, node)
    parameters = _find(of_node, _PARAMETERS)
    if not isinstance(parameters, yaml.MappingNode) or not parameters.value:
        end = '' if not text or text.endswith('\n') else '\n'
        return f'{text}{end}{node}:\n  {_PARAMETERS}:\n    {name}: {value}\n'
    old = _find(parameters, name)
    if old is not None:
        return text[: old.start_mark.index] + value + text[old.end_mark.index :]
    mark = parameters.value[0][0].start_mark
    if parameters.flow_style:
        return f'{text[: mark.index]}{name}: {value}, {text[mark.index :]}'
    return f'{text[: mark.index]}{name}: {value}\n{" " * mark.column}{text[mark.index :]}'


def _find(parent: yaml.Node | None, name: str) -> yaml.Node | None:
    if not isinstance(parent, yaml.MappingNode):
        return None
    return next((v for k, v in parent.value if str(k.value).strip('/') == name), None)
