# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of tactile recordings: MCAP, as rosbag2 writes them, without rosbag2."""

from tactile_bringup.bag_reader import BagMessage, TactileBag
from tactile_bringup.bag_writer import FACTS_KEY, BagWriter
from tactile_bringup.recorded_topics import (
    AUDIT,
    CLASSIFICATION,
    DIAGNOSTICS,
    EVENT,
    EVENT_TOPIC,
    FEATURES,
    FEATURES_TOPIC,
    JOINT_STATE,
    RUNNING_FEATURES_TOPIC,
    SLIP,
    STRAIN,
    STRAIN_TOPIC,
    TARE,
    WRENCH,
    RecordedTopic,
    classification_topic,
    join_topic,
    message_store,
    recorded_topics,
    running_topic,
)

__all__ = [
    'AUDIT',
    'CLASSIFICATION',
    'DIAGNOSTICS',
    'EVENT',
    'EVENT_TOPIC',
    'FACTS_KEY',
    'FEATURES',
    'FEATURES_TOPIC',
    'JOINT_STATE',
    'RUNNING_FEATURES_TOPIC',
    'SLIP',
    'STRAIN',
    'STRAIN_TOPIC',
    'TARE',
    'WRENCH',
    'BagMessage',
    'BagWriter',
    'RecordedTopic',
    'TactileBag',
    'classification_topic',
    'join_topic',
    'message_store',
    'recorded_topics',
    'running_topic',
]
