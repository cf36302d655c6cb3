# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Repair of bags that were not closed, or are damaged, by writing a closed copy."""

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
    """Result of a repair.

    ``message_count`` is the number of copied messages. ``recovered`` describes which messages of
    an unclosed source may be missing, and ``damage`` describes its damage; both may be None.
    """

    message_count: int
    recovered: str | None
    damage: str | None


def repair_bag(source: Path, target: Path) -> Repair:
    """Copy every complete message of a bag to a new bag, byte for byte.

    The source is not changed. The metadata of the copy contain the SHA-256 digest of the source.
    If the source is damaged, the messages before the damage are copied.

    Raises
    ------
    BagError
        When the source cannot be opened, or the copy cannot be written.
    """
    with TactileBag(source, needs_all=False) as bag:
        metadata = {**bag.metadata, 'repaired_from_sha256': bag.sha256()}
        count = 0
        damage: str | None = None
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
    """Return the QoS settings in words. Older bags contain numbers, which are converted."""
    try:
        profiles = load_yaml(text)
        if all(isinstance(profile['history'], str) for profile in profiles):
            return yaml.safe_dump(profiles, sort_keys=False).rstrip()
        return qos_text(latched=any(profile['durability'] == 1 for profile in profiles))
    except (TactileError, TypeError, KeyError):
        return qos_text(latched=False)
