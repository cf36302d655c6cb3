# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the bag recorder and the bag player. This module does not import ROS."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.configs import parameter


@dataclass(frozen=True)
class RecorderConfig:
    """Configuration of the bag recorder: output folder, fingers and metadata."""

    bag: str = parameter(
        '',
        'folder of the bag to write; must not exist yet',
    )
    namespaces: tuple[str, ...] = parameter(
        ('',),
        'namespaces of the fingers to record; an empty name is the root namespace',
    )
    metadata: str = parameter(
        '{}',
        'metadata of the recording, as a JSON object',
    )
    rig: bool = parameter(
        True,
        'true if the rig moves the fingers. If false, a hand moves them, and the recorder does '
        'not wait for topics of the rig',
    )
    classifier: bool = parameter(
        False,
        'true if a classifier is running. If false, the topics of a classifier are recorded if '
        'they appear, but the recorder does not wait for them',
    )
    match_timeout_s: float = parameter(
        10.0,
        'longest wait for a publisher of every topic; after that, missing publishers are reported '
        'as an error',
        unit='s',
        range=(0.0, 600.0),
    )


@dataclass(frozen=True)
class PlayerConfig:
    """Configuration of the bag player: recording, finger and rate."""

    bag: str = parameter(
        '',
        'folder of the recording to play',
    )
    namespace: str = parameter(
        '',
        'namespace of the finger to play. If the name is empty, all recorded fingers are played',
    )
    rate: float = parameter(
        1.0,
        'speed relative to the recording',
        unit='1',
        range=(0.001, 1000.0),
    )
    subscriber_timeout_s: float = parameter(
        0.0,
        'longest wait until every topic of the recording has a subscriber',
        unit='s',
        range=(0.0, 600.0),
    )
    start_delay_s: float = parameter(
        1.0,
        'time before the first message, during which nodes discover each other',
        unit='s',
        range=(0.0, 600.0),
    )
