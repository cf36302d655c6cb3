# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Transports of Fast DDS that do not stall a stream when a node joins.

Fast DDS checks the shared-memory port of each participant that joins, and may sleep 333 ms
meanwhile with its locks held (eProsima/Fast-DDS issue 6535): samples of other topics wait,
and motion that watches them is stopped. UDP has no such check. A node therefore takes UDP,
unless the environment chooses transports itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
PROFILES_OF = {'jazzy': PROFILES[1], 'kilted': PROFILES[0], 'lyrical': PROFILES[0]}
"""By ROS distribution: the variable that its Fast DDS reads."""

LOOPBACK = Path(__file__).parents[1] / 'loopback.xml'
"""A Fast DDS profile: UDP on the loopback interface alone."""


def choose_transports(environment: Mapping[str, str], default_range: str) -> dict[str, str]:
    """Return the variables to set before ROS starts; what the user has chosen stays.

    Parameters
    ----------
    environment : mapping of str to str
        Variables of the process.
    default_range : str
        ``ROS_AUTOMATIC_DISCOVERY_RANGE`` where the environment does not set it.
    """
    if any(environment.get(name) for name in PROFILES):
        return {}  # a profile chooses transports and reach
    chosen_range = environment.get(RANGE) or default_range
    if chosen_range != 'LOCALHOST':
        return {} if environment.get(TRANSPORTS) else {TRANSPORTS: 'UDPv4'}
    variable = PROFILES_OF.get(environment.get('ROS_DISTRO', ''))
    if variable is None or 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', ''):
        return {RANGE: chosen_range}  # nothing else surely reads the profile
    # In the range LOCALHOST, ROS adds shared memory itself. The profile confines as well.
    return {RANGE: 'SUBNET', variable: str(LOOPBACK)}
