# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import pytest

from tactile_ros.process import choose_transports, PROFILES, TRANSPORTS

FAST = 'rmw_fastrtps_cpp'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
JAZZY = {'ROS_DISTRO': 'jazzy', 'RMW_IMPLEMENTATION': FAST}


@pytest.mark.parametrize(
    ('distro', 'variable'),
    [('jazzy', 'FASTRTPS_DEFAULT_PROFILES_FILE'), ('kilted', 'FASTDDS_DEFAULT_PROFILES_FILE')],
)
def test_on_this_computer_alone_a_profile_keeps_to_the_loopback_interface(distro, variable):
    ros = {'ROS_DISTRO': distro, 'RMW_IMPLEMENTATION': FAST}
    asked = {**ros, RANGE: 'LOCALHOST'}
    for chosen in (choose_transports(asked, 'SUBNET'), choose_transports(ros, 'LOCALHOST')):
        profile = chosen.pop(variable)
        assert chosen == {RANGE: 'SUBNET'}  # with LOCALHOST, ROS would also use shared memory
        elements = ElementTree.parse(profile).iter()
        addresses = {e.text for e in elements if e.tag.endswith('address')}
        assert addresses == {'127.0.0.1'}
        assert Path(profile).is_absolute()


@pytest.mark.parametrize(
    'ros',
    [
        {'ROS_DISTRO': 'jazzy'},
        {'ROS_DISTRO': 'jazzy', 'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'},
        {'ROS_DISTRO': 'humble', 'RMW_IMPLEMENTATION': FAST},
        {'RMW_IMPLEMENTATION': FAST},
    ],
)
def test_what_does_not_surely_read_the_profile_keeps_the_range(ros):
    assert choose_transports(ros, 'LOCALHOST') == {RANGE: 'LOCALHOST'}


@pytest.mark.parametrize(
    ('environment', 'default_range', 'chosen'),
    [
        ({}, 'SUBNET', {TRANSPORTS: 'UDPv4'}),
        ({RANGE: 'SUBNET'}, 'LOCALHOST', {TRANSPORTS: 'UDPv4'}),
        # If the user has chosen profiles or transports, no transport is selected.
        *(({profile: 'x', **JAZZY}, 'LOCALHOST', {}) for profile in PROFILES),
        ({TRANSPORTS: 'LARGE_DATA'}, 'SUBNET', {}),
        ({TRANSPORTS: 'LARGE_DATA'}, 'LOCALHOST', {RANGE: 'LOCALHOST'}),
    ],
)
def test_on_a_network_udp_is_chosen_unless_the_user_has_chosen(environment, default_range, chosen):
    assert choose_transports(environment, default_range) == chosen
