# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the recorder and the player of bags, free of ROS."""

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
        'namespaces of the fingers to record; empty: the root',
    )
    metadata: str = parameter(
        '{}',
        'metadata of the recording, as a JSON object',
    )
    rig: bool = parameter(
        True,
        'the rig moves the fingers; false: a hand does, and no topic of the rig is waited for',
    )
    classifier: bool = parameter(
        False,
        'a classifier runs; false: its topics are recorded when they come, and not waited for',
    )
    match_timeout_s: float = parameter(
        10.0,
        'time for every topic to get a publisher; then those without are reported as an error',
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
        'only the finger in this namespace; empty: all that were recorded',
    )
    rate: float = parameter(
        1.0,
        'how many times as fast as it was recorded',
        unit='1',
        range=(0.001, 1000.0),
    )
    subscriber_timeout_s: float = parameter(
        0.0,
        'how long to wait until every topic of the recording has a subscriber',
        unit='s',
        range=(0.0, 600.0),
    )
    start_delay_s: float = parameter(
        1.0,
        'time before the first message, for the nodes to find each other',
        unit='s',
        range=(0.0, 600.0),
    )
