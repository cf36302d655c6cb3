# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files.

Launch files and commands read a parameter file with this module and pass each node its own
parameters. This differs from ROS in three ways:

- Unknown names of nodes and parameters are refused before anything starts. ROS ignores them.
- A later layer overrides an earlier one. ROS prefers an exact node name in an earlier layer.
- A relative path in the parameter `models` is relative to the folder of the parameter file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import dataclasses
from difflib import get_close_matches
from pathlib import Path
import re
from typing import Any, NamedTuple

from linear_guide_driver.config import LinearGuideConfig, TendonActuatorConfig
from tactile_bringup.trial_protocols import TrialConfig
from tactile_classifier.config import ClassifierConfig
from tactile_features.config import FeaturesNodeConfig
from tactile_ros.bag_configs import PlayerConfig, RecorderConfig
from tactile_ros.errors import TactileError
from tactile_ros.topics import join_topic
from tactile_ros.yaml_files import load_yaml, read_text
from tendon_sensor_driver.config import TendonSensorConfig

CONFIGS: dict[str, type] = {
    'tendon_sensor': TendonSensorConfig,
    'linear_guide': LinearGuideConfig,
    'tendon_actuator': TendonActuatorConfig,
    'trial_runner': TrialConfig,
    'tactile_features': FeaturesNodeConfig,
    'tactile_classifier': ClassifierConfig,
    'bag_recorder': RecorderConfig,
    'bag_player': PlayerConfig,
}
"""Config class of each node; the keys are the names of the nodes."""

MAX_BYTES = 2**20
"""Largest parameter file that is read [B]."""

_OF_EVERY_NODE = ('autostart', 'use_sim_time', 'start_type_description_service')

NodeParameters = Mapping[str, Mapping[str, Any]]
"""Parameters of several nodes; the keys are the names of the nodes."""


class _Entry(NamedTuple):
    pattern: str
    parameters: Mapping[str, Any]

    @property
    def parts(self) -> list[str]:
        return self.pattern.strip('/').split('/')

    @property
    def node(self) -> str:
        """Name of the node; an empty string if the entry applies to any node."""
        return '' if '*' in self.parts[-1] else self.parts[-1]


class ParameterFile:
    """Parameters in a ROS parameter file; none if ``path`` is None.

    Raises
    ------
    TactileError
        If the file cannot be read or is not a ROS parameter file, if it states a parameter that a
        node of these packages does not have, or if it has a misspelt name of such a node.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self._entries: tuple[_Entry, ...] = ()
        if path is None:
            return
        try:
            document = load_yaml(read_text(path, MAX_BYTES))
        except TactileError as error:
            raise TactileError(f'cannot read the parameters in {path}: {error}') from error
        if not isinstance(document, dict):
            raise TactileError(
                f'{path} is not a ROS parameter file: node names are expected at the top level'
            )
        self._entries = tuple(
            _Entry(pattern, _flat(parameters))
            for pattern, parameters in _find_entries(document, '', path)
        )
        for entry in self._entries:
            self._check(entry)

    def of(self, name: str, namespace: str = '') -> dict[str, Any]:
        """Return the parameters of a node; the path in `models` is absolute."""
        found: dict[str, Any] = {}
        full = join_topic(namespace, name)
        for entry in self._entries:
            if _as_expression(entry.pattern).fullmatch(full):
                found |= {
                    key: value
                    for key, value in entry.parameters.items()
                    if entry.node or has_parameter(name, key)
                }
        if self.path is not None and isinstance(models := found.get('models'), str) and models:
            found['models'] = str((self.path.parent / Path(models).expanduser()).resolve())
        return found

    def fingers(self, namespace: str = '') -> tuple[str, ...]:
        """Return the names of the fingers below a namespace, in the order of the file."""
        found: dict[str, None] = {}
        for entry in self._entries:
            if entry.node not in CONFIGS or len(entry.parts) < 2:
                continue
            *above, finger, _ = entry.parts
            expression = _as_expression('/'.join(above))
            if '*' not in finger and expression.fullmatch(join_topic(namespace, '').rstrip('/')):
                found[finger] = None
        return tuple(found)

    def refuse_others(self, namespaces: Iterable[str]) -> None:
        """Raise `TactileError` if an entry is for a known node, but in another namespace."""
        places = [place.strip('/') for place in namespaces]
        for entry in self._entries:
            expression = _as_expression(entry.pattern)
            if entry.node in CONFIGS and not any(
                expression.fullmatch(join_topic(place, entry.node)) for place in places
            ):
                known = ', '.join(join_topic(place, entry.node) for place in places)
                raise TactileError(
                    f'{self.path} has parameters for {entry.pattern}, which is not started; the '
                    f'nodes are {known}. Correct the name, or remove the entry'
                )

    def _check(self, entry: _Entry) -> None:
        node = entry.node
        if node not in CONFIGS:
            # Other names are allowed, because the entry may be for a node of another package.
            if close := get_close_matches(node, CONFIGS, 1, 0.8):
                raise TactileError(
                    f'{self.path} has parameters for {entry.pattern}; did you mean {close[0]}?'
                )
            return
        for key in entry.parameters:
            if not has_parameter(node, key):
                close = get_close_matches(key, _names(node), 1)
                hint = f'; did you mean {close[0]}?' if close else ''
                raise TactileError(
                    f'{self.path}: {entry.pattern} has the parameter {key}, which {node} does '
                    f'not have{hint}'
                )


def has_parameter(node: str, key: str) -> bool:
    """Return True if a node of these packages has this parameter."""
    return key.startswith('qos_overrides.') or key in _names(node)


def _names(node: str) -> list[str]:
    return [field.name for field in dataclasses.fields(CONFIGS[node])] + [*_OF_EVERY_NODE]


def _flat(parameters: Mapping[Any, Any], above: str = '') -> dict[str, Any]:
    """Return nested parameters as a flat mapping, with ROS's dotted names."""
    flat: dict[str, Any] = {}
    for key, value in parameters.items():
        name = f'{above}{key}'
        flat.update(_flat(value, f'{name}.') if isinstance(value, dict) else {name: value})
    return flat


def _find_entries(
    document: Mapping[Any, Any], above: str, path: Path
) -> Iterator[tuple[str, dict[str, Any]]]:
    for key, content in document.items():
        name = f'{above}/{str(key).strip("/")}'
        if not isinstance(content, dict) or not content:
            raise TactileError(f'{path}: {name} has no ros__parameters below it')
        parameters = content.get('ros__parameters', {})
        if not isinstance(parameters, dict):
            raise TactileError(
                f'{path}: the ros__parameters of {name} must be a mapping of names to values'
            )
        if 'ros__parameters' in content:
            yield name, parameters
        below = {k: v for k, v in content.items() if k != 'ros__parameters'}
        yield from _find_entries(below, name, path)


def _as_expression(pattern: str) -> re.Pattern[str]:
    wildcards = {'*': '/[^/]+', '**': '(?:/[^/]+)*', '': ''}
    parts = pattern.strip('/').split('/')
    return re.compile(''.join(wildcards.get(part, '/' + re.escape(part)) for part in parts))
