# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Decoding of messages of another release with the definitions that their bag contains."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import StoredTopic
from tactile_bags.message_types import message_store


def store_of_definition(topic: StoredTopic, type_hash: str) -> Typestore | None:
    """Return the message types that a bag contains for a topic, or None if they are unusable.

    The definition must match ``type_hash``. Definitions that contain arrays of fixed length or
    messages without fields are refused: a few bytes of such a message could be decoded to any
    number of values.
    """
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores  # slow to import

    if topic.definition_format != 'ros2msg':
        return None
    store = get_typestore(Stores.EMPTY)
    try:
        types = get_types_from_msg(topic.definition, topic.type_name)
        for _, fields in types.values():
            if not fields or any(kind == Nodetype.ARRAY for _, (kind, _) in fields):
                return None
        store.register(types)
        return store if store.hash_rihs01(topic.type_name) == type_hash else None
    except Exception:  # invalid text can raise any error
        return None


def complete_message(message: Any, type_name: str, stored: Typestore) -> Any:
    """Convert a message that has the definition of a bag to the installed definition.

    If the definition of the bag does not have a field, the field gets the default of its type.
    Raises `BagError` when a field has another type in the bag.
    """
    installed = message_store()
    there = dict(stored.fielddefs[type_name][1])
    values = {}
    for name, desc in installed.fielddefs[type_name][1]:
        if name not in there:
            values[name] = _default(desc)
        elif there[name] != desc:
            raise BagError(f'{name} of {type_name} has another type in the recording')
        else:
            values[name] = _complete(getattr(message, name), desc, stored)
    return installed.types[type_name](**values)


def _complete(value: Any, desc: Any, stored: Typestore) -> Any:
    kind, detail = desc
    if kind == Nodetype.NAME:
        return complete_message(value, detail, stored)
    if kind == Nodetype.SEQUENCE and detail[0][0] == Nodetype.NAME:
        return [complete_message(each, detail[0][1], stored) for each in value]
    return value


def _default(desc: Any) -> Any:
    kind, detail = desc
    if kind == Nodetype.SEQUENCE:
        of_numbers = detail[0][0] == Nodetype.BASE and detail[0][1][0] != 'string'
        return np.empty(0) if of_numbers else []
    if kind == Nodetype.NAME:
        installed = message_store()
        fields = installed.fielddefs[detail][1]
        return installed.types[detail](**{name: _default(field) for name, field in fields})
    if kind == Nodetype.ARRAY:
        return [_default(detail[0])] * detail[1]
    return {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}.get(detail[0], 0)
