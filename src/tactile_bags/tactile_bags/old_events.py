# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trial events of earlier releases: they gain the fields that were added since."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from functools import lru_cache
from typing import Any

from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

from tactile_bags.message_definitions import message_definitions
from tactile_bags.recorded_topics import EVENT, message_store

ADDED_FIELDS: dict[str, Any] = {'mounting_id': ''}
"""Fields that were added to the end of the event since its first release, and their defaults."""


def find_event_upgrade(type_hash: str) -> Callable[[bytes], bytes] | None:
    """Return what turns events of an earlier definition into today's; None: it is not known.

    Parameters
    ----------
    type_hash : str
        Of the definition that was recorded (RIHS01).
    """
    for count in range(1, len(ADDED_FIELDS) + 1):
        store = _make_old_store(tuple(ADDED_FIELDS)[-count:])
        if store.hash_rihs01(EVENT) == type_hash:
            return lambda data, store=store: _upgrade(data, store)  # type: ignore[misc]
    return None


@lru_cache
def _make_old_store(missing: tuple[str, ...]) -> Typestore:
    lines = [
        line
        for line in message_definitions()['TrialEvent'].splitlines()
        if not any(f' {name} ' in line.partition('#')[0] for name in missing)
    ]
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg('\n'.join(lines), EVENT))
    return store


def _upgrade(data: bytes, store: Typestore) -> bytes:
    old: Any = store.deserialize_cdr(data, EVENT)
    fields = {field.name: getattr(old, field.name) for field in dataclasses.fields(old)}
    event = message_store().types[EVENT](**{**ADDED_FIELDS, **fields})
    return bytes(message_store().serialize_cdr(event, EVENT))
