# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fingers of a hand, from a list of names or a hand file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
import re
from typing import Any

from tactile_bags.plain_yaml import parse_plain_yaml, read_text
from tactile_ros.errors import TactileError

_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
_MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class Finger:
    """One finger of a hand, as far as it was described.

    Attributes
    ----------
    name : str
        Namespace of its nodes.
    sensor_port, sensor_topic, phases : str
        Empty: not said.
    models : Path or None
    parameters : mapping
        By node name, then by parameter name.
    slip : bool or None
        Whether its slip detector runs; None: not said.
    """

    name: str
    sensor_port: str = ''
    models: Path | None = None
    phases: str = ''
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    slip: bool | None = None
    sensor_topic: str = ''


def parse_finger_names(text: str) -> tuple[str, ...]:
    """Return the names in a list such as ``index,middle``.

    Raises
    ------
    TactileError
        When one is no name for a namespace, or is there twice.
    """
    names = tuple(name.strip() for name in text.split(',') if name.strip())
    for name in names:
        if not _NAME.fullmatch(name):
            raise TactileError(
                f'"{name}" is no name for a finger: letters, digits and _ only, and no digit first'
            )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise TactileError(f'the finger {", ".join(twice)} is named twice')
    return names


def read_hand(path: Path, wanted: Iterable[str] = ()) -> tuple[Finger, ...]:
    """Return the fingers that a file describes: those that are wanted, or all.

    The file holds ``fingers:`` and below it, by name, any of ``sensor_port``,
    ``sensor_topic``, ``models`` (a path, relative to the file), ``phases``, ``slip`` (true or
    false) and ``parameters`` (by node name).

    Raises
    ------
    TactileError
        When the file cannot be read, has another form, or lacks a wanted finger.
    """
    try:
        document = parse_plain_yaml(read_text(path, _MOST_BYTES))
    except TactileError as error:
        raise TactileError(f'cannot read the hand in {path}: {error}') from error
    described = document.get('fingers') if isinstance(document, dict) else None
    if not isinstance(described, dict) or not described or set(document) != {'fingers'}:
        raise TactileError(f'{path} is no hand file: it must hold "fingers:", and names below it')
    names = parse_finger_names(','.join(str(name) for name in described))
    fingers = {
        name: _finger(name, content, path)
        for name, content in zip(names, described.values(), strict=True)
    }
    missing = [name for name in wanted if name not in fingers]
    if missing:
        raise TactileError(
            f'{path} does not describe {", ".join(missing)}, only {", ".join(fingers)}'
        )
    return tuple(fingers[name] for name in (wanted or fingers))


def _finger(name: str, content: Any, path: Path) -> Finger:
    content = {} if content is None else content
    if not isinstance(content, dict):
        raise TactileError(f'{path}: {name} must hold names and values')
    known = ('sensor_port', 'sensor_topic', 'models', 'phases', 'slip', 'parameters')
    if 'model' in content:
        raise TactileError(f'{path}: model of {name} is now called models; rename it')
    unknown = [str(key) for key in content if key not in known]
    if unknown:
        raise TactileError(
            f'{path}: {name} has {", ".join(unknown)}; it can have {", ".join(known)}'
        )
    for key in ('sensor_port', 'sensor_topic', 'models', 'phases'):
        if not isinstance(content.get(key, ''), str):
            raise TactileError(f'{path}: {key} of {name} must be text')
    slip = content.get('slip')
    if slip is not None and not isinstance(slip, bool):
        raise TactileError(f'{path}: slip of {name} must be true or false')
    parameters = content.get('parameters', {})
    if not isinstance(parameters, dict) or not all(
        isinstance(of_node, dict) for of_node in parameters.values()
    ):
        raise TactileError(
            f'{path}: the parameters of {name} must stand below the name of their node'
        )
    models = content.get('models')
    return Finger(
        name,
        sensor_port=content.get('sensor_port', ''),
        models=path.parent / models if models else None,
        phases=content.get('phases', ''),
        parameters={str(node): dict(of_node) for node, of_node in parameters.items()},
        slip=slip,
        sensor_topic=content.get('sensor_topic', ''),
    )
