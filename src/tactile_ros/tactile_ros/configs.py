# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Configuration of a node: a frozen dataclass in which each field is a parameter.

Metadata of a field: ``description``, and optionally ``unit``; ``range``, including both ends;
``choices``; and ``live``, True if the parameter may change at any time. The elements of a tuple
whose default is empty are strings.
"""

from __future__ import annotations

import dataclasses
from typing import Any


def parameter(default: Any, description: str, **metadata: Any) -> Any:
    """Return a dataclass field that a node declares as a parameter; see this module."""
    return dataclasses.field(default=default, metadata={'description': description, **metadata})


def find_violation(field: dataclasses.Field[Any], value: Any) -> str | None:
    """Return why a value is not allowed for a field, with the allowed values, or None."""
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
