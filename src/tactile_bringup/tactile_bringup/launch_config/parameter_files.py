# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files, read as ROS reads them: which of their entries are for which node."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
import re
from typing import Any

from tactile_bags.plain_yaml import parse_plain_yaml, read_text
from tactile_bags.recorded_topics import join_topic
from tactile_ros.errors import TactileError

OLD_CLASSIFIER = re.compile(r'/(texture|stiffness)(_flexion|_abduction)?_classifier$')
"""Classifier nodes of version 0.1, one a model."""

MAX_BYTES = 2**20
"""Longest file of parameters that is read [byte]."""


def read_parameters(
    path: Path, names: Iterable[str], namespace: str = '', *, others_allowed: bool = False
) -> dict[str, dict[str, Any]]:
    """Return what a ROS parameter file sets for some nodes, by node name.

    Parameters
    ----------
    path : Path
    names : iterable of str
        Names of the nodes, without their namespace.
    namespace : str
        Namespace of all of them.
    others_allowed : bool
        Pass over entries that are for none of these nodes.

    Raises
    ------
    TactileError
        When the file is not of ROS's form, or an entry is for none of these nodes.
    """
    try:
        document = parse_plain_yaml(read_text(path, MAX_BYTES))
    except TactileError as error:
        raise TactileError(f'cannot read the parameters in {path}: {error}') from error
    if not isinstance(document, dict):
        raise TactileError(f'{path} is no ROS parameter file: node names are expected on top')
    full_names = {name: join_topic(namespace, name) for name in names}
    found: dict[str, dict[str, Any]] = {}
    for pattern, parameters in _entries(document, '', path):
        if OLD_CLASSIFIER.search(pattern):
            raise TactileError(
                f'{path} has parameters for {pattern}; the classifier of a finger is now called '
                'tactile_classifier and needs no parameters of windows'
            )
        expression = _as_expression(pattern)
        matching = [name for name, full in full_names.items() if expression.fullmatch(full)]
        if not matching and not others_allowed:
            raise TactileError(
                f'{path} has parameters for {pattern}; there are {", ".join(full_names.values())}'
            )
        for name in matching:
            found.setdefault(name, {}).update(_flat(parameters))
    return found


def _flat(parameters: Mapping[Any, Any], above: str = '') -> dict[str, Any]:
    """Return nested parameters under the names that ROS gives them, with points between."""
    flat: dict[str, Any] = {}
    for key, value in parameters.items():
        name = f'{above}{key}'
        flat.update(_flat(value, f'{name}.') if isinstance(value, dict) else {name: value})
    return flat


def _entries(
    document: Mapping[Any, Any], above: str, path: Path
) -> Iterator[tuple[str, dict[str, Any]]]:
    for key, content in document.items():
        name = f'{above}/{str(key).strip("/")}'
        if not isinstance(content, dict) or not content:
            raise TactileError(f'{path}: {name} has no ros__parameters below it')
        parameters = content.get('ros__parameters', {})
        if not isinstance(parameters, dict):
            raise TactileError(f'{path}: the ros__parameters of {name} have no names')
        if parameters:
            yield name, parameters
        below = {k: v for k, v in content.items() if k != 'ros__parameters'}
        yield from _entries(below, name, path)


def _as_expression(pattern: str) -> re.Pattern[str]:
    wildcards = {'*': '/[^/]+', '**': '(?:/[^/]+)*'}
    parts = pattern.strip('/').split('/')
    return re.compile(''.join(wildcards.get(part, '/' + re.escape(part)) for part in parts))
