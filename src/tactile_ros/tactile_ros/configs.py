# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fields of a node's configuration: a frozen dataclass, each field of it a parameter.

The metadata of a field: ``description`` and, where they apply, ``unit``, ``range`` (both ends
included), ``choices``; ``live``, when it may change at any time; ``element``, the type within a
tuple that is empty by default, where it is not str.
"""

from __future__ import annotations

import dataclasses
from typing import Any


def parameter(default: Any, description: str, **metadata: Any) -> Any:
    """Return a field of a configuration that a node declares as a parameter."""
    return dataclasses.field(default=default, metadata={'description': description, **metadata})


def find_objection(field: dataclasses.Field[Any], value: Any) -> str:
    """Return why a field cannot have a value, and what it can have; empty when it can."""
    if 'range' in field.metadata:
        low, high = field.metadata['range']
        if not low <= value <= high:
            return f'{field.name} is {value}; it must be between {low} and {high}'
    choices = field.metadata.get('choices')
    if choices and value not in choices:
        allowed = ', '.join(str(choice) or 'empty' for choice in choices)
        return f'{field.name} is "{value}"; it must be one of {allowed}'
    return ''


def check_parameters(config: Any, error: type[Exception] = ValueError) -> None:
    """Check each field of a configuration against its range and its choices.

    Raises
    ------
    error
        When a value is not allowed; names it and what is.
    """
    for field in dataclasses.fields(config):
        if objection := find_objection(field, getattr(config, field.name)):
            raise error(objection)
