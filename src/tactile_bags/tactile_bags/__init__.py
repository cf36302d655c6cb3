# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of tactile recordings: MCAP files as rosbag2 writes them, without rosbag2."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Audit': 'tactile_bags.audit',
    'BagError': 'tactile_bags.errors',
    'BagMessage': 'tactile_bags.bag_reader',
    'BagWriter': 'tactile_bags.bag_writer',
    'METADATA_KEY': 'tactile_bags.bag_writer',
    'RecordedBag': 'tactile_bags.recorded_bag',
    'Signal': 'tactile_bags.trial',
    'TactileBag': 'tactile_bags.bag_reader',
    'Trial': 'tactile_bags.trial',
    'audit_bag': 'tactile_bags.audit',
    'message_store': 'tactile_bags.message_types',
    'repair_bag': 'tactile_bags.bag_repair',
    'replay_through_core': 'tactile_bags.replay',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Imported on first use, so that programs without bags do not import rosbags.
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
