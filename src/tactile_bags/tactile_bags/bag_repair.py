# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A closed copy of a bag that was never closed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from tactile_bags.bag_reader import TactileBag
from tactile_bags.bag_writer import BagWriter
from tactile_bags.errors import BagDamageError
from tactile_bags.message_types import qos_text
from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import load_yaml


@dataclass(frozen=True)
class Repair:
    """Messages in the copy of a bag, its fault, and why part of it could not be read, or empty."""

    message_count: int
    recovered: str
    damage: str


def repair_bag(source: Path, target: Path) -> Repair:
    """Copy every whole message of a bag into a new one, byte for byte.

    The bag itself is not touched. The copy's metadata say that it is one, and of which data.

    Raises
    ------
    BagError
        When the bag cannot be opened at all, or the copy not be written.
    """
    with TactileBag(source, needs_all=False) as bag:
        metadata = {**bag.metadata, 'repaired_from_sha256': bag.sha256()}
        count, damage = 0, ''
        with BagWriter(target, metadata) as writer:
            for topic in bag.stored_topics:
                writer.add_stored_topic(replace(topic, qos=_usable_qos(topic.qos)))
            try:
                for message in bag.messages():
                    writer.write_raw(message.topic, message.received_at_ns, message.data)
                    count += 1
            except BagDamageError as error:
                damage = str(error)
                writer.add_metadata({'repair_is_partial': True})
        return Repair(count, bag.recovered, damage)


def _usable_qos(text: str) -> str:
    """Return quality of service in words; older bags have numbers."""
    try:
        profiles = load_yaml(text)
        if all(isinstance(profile['history'], str) for profile in profiles):
            return yaml.safe_dump(profiles, sort_keys=False).rstrip()
        return qos_text(latched=any(profile['durability'] == 1 for profile in profiles))
    except (TactileError, TypeError, KeyError):
        return qos_text(latched=False)
