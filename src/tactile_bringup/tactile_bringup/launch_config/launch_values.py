# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The values of a launch file's arguments, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tactile_bringup.launch_config.launch_arguments import LAUNCH_FILES
from tactile_bringup.launch_config.parameter_files import read_parameters
from tactile_ros.errors import TactileError

NodeParameters = Mapping[str, Mapping[str, Any]]
"""Parameters by the name of the node."""


class LaunchValues:
    """Values by argument; what is not given has its default.

    Parameters
    ----------
    name : str
        Name of the launch file, without ``.launch.py``.
    given : mapping of str to str

    Raises
    ------
    TactileError
        When an argument is not known or is not one of its choices.
    """

    def __init__(self, name: str, given: Mapping[str, str]) -> None:
        arguments = {argument.name: argument for argument in LAUNCH_FILES[name]}
        self._values = {argument.name: argument.default for argument in arguments.values()}
        for key, value in given.items():
            if key not in arguments:
                raise TactileError(f'{name} has no argument {key}, only {", ".join(arguments)}')
            choices = arguments[key].choices
            if choices and value not in choices:
                raise TactileError(f'{key} is "{value}"; it must be one of {", ".join(choices)}')
            self._values[key] = value

    def __getitem__(self, key: str) -> str:
        return self._values[key]

    def path(self, key: str) -> Path | None:
        """Return a value as a path; None when it is empty."""
        return Path(self._values[key]).expanduser() if self._values[key] else None

    def parameters(self, names: Iterable[str], namespace: str) -> NodeParameters:
        """Return what the file ``params_file`` has for some nodes in a namespace."""
        path = self.path('params_file')
        if path is None:
            return {}
        return read_parameters(path, names, namespace, others_allowed=True)


def merge_parameters(*layers: NodeParameters) -> dict[str, dict[str, Any]]:
    """Return the parameters of all layers; of the same parameter, the last layer's."""
    merged: dict[str, dict[str, Any]] = {}
    for layer in layers:
        for node, parameters in layer.items():
            merged.setdefault(node, {}).update(parameters)
    return merged
