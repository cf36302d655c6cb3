# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of tactile recordings: MCAP, as rosbag2 writes them, without rosbag2."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'AUDIT': 'recorded_topics',
    'Audit': 'audit',
    'BagError': 'errors',
    'BagMessage': 'bag_reader',
    'BagWriter': 'bag_writer',
    'CLASSIFICATION': 'recorded_topics',
    'CLASSIFICATION_TOPIC': 'recorded_topics',
    'EVENT': 'recorded_topics',
    'EVENT_TOPIC': 'recorded_topics',
    'METADATA_KEY': 'bag_writer',
    'FEATURES': 'recorded_topics',
    'FEATURES_TOPIC': 'recorded_topics',
    'JOINT_STATE': 'recorded_topics',
    'MODELS': 'recorded_topics',
    'MODELS_TOPIC': 'recorded_topics',
    'PARTIAL_CLASSIFICATION_TOPIC': 'recorded_topics',
    'PARTIAL_FEATURES_TOPIC': 'recorded_topics',
    'RecordedBag': 'recorded_bag',
    'RecordedTopic': 'recorded_topics',
    'Recording': 'recording',
    'SLIP': 'recorded_topics',
    'SPECIFICATIONS': 'recorded_topics',
    'SPECIFICATIONS_TOPIC': 'recorded_topics',
    'STRAIN': 'recorded_topics',
    'STRAIN_TOPIC': 'recorded_topics',
    'Signal': 'trial',
    'SourceError': 'sources.files',
    'SourceOptions': 'sources.files',
    'TARE': 'recorded_topics',
    'TactileBag': 'bag_reader',
    'Trial': 'trial',
    'WRENCH': 'recorded_topics',
    'audit_bag': 'audit',
    'join_topic': 'recorded_topics',
    'message_store': 'recorded_topics',
    'repair_bag': 'bag_repair',
    'replay_through_core': 'replay',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use, so that who needs no bag does not import rosbags.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
