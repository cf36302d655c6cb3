# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Configuration of a node as a frozen dataclass, in which each field is a ROS parameter.

The metadata of a field contain ``description``, and optionally ``unit``, ``range`` (its first and
last allowed value), ``choices``, and ``live``, which is True if the parameter can be changed while
the node is configured. If the default of a field is an empty tuple, its elements are strings.
"""

from __future__ import annotations

import dataclasses
from typing import Any


def parameter(default: Any, description: str, **metadata: Any) -> Any:
    """Return a dataclass field that a node declares as a parameter.

    The docstring of this module describes the metadata.
    """
    return dataclasses.field(default=default, metadata={'description': description, **metadata})


def find_violation(field: dataclasses.Field[Any], value: Any) -> str | None:
    """Return a text that states why a value is not allowed for a field; None if it is allowed."""
    if 'range' in field.metadata:
        low, high = field.metadata['range']
        if not low <= value <= high:
            return f'{field.name} is {value}; it must be between {low} and {high}'
    choices = field.metadata.get('choices')
    if choices and value not in choices:
        allowed = ', '.join(str(choice) or 'empty' for choice in choices)
        return f'{field.name} is "{value}"; it must be one of {allowed}'
    return None


def check_parameters(config: Any, error: type[Exception] = ValueError) -> None:
    """Check each field of a configuration against its range and its choices.

    Parameters
    ----------
    config : dataclass instance
        The configuration.
    error : type of Exception
        Exception to raise.

    Raises
    ------
    error
        If a value is not allowed. The message names the field and the allowed values.
    """
    for field in dataclasses.fields(config):
        if violation := find_violation(field, getattr(config, field.name)):
            raise error(violation)
