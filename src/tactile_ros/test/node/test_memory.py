# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Memory that a lifecycle node needs if discovery is limited to this computer."""

import os
import subprocess
import sys

import pytest

from tactile_ros.process import choose_transports, PROFILES_OF

PROGRAM = """
import os, rclpy
from rclpy.lifecycle import LifecycleNode

def anonymous_kib():
    with open('/proc/self/smaps_rollup') as smaps:
        return next(int(line.split()[1]) for line in smaps if line.startswith('Anonymous'))

rclpy.init()
nodes = [LifecycleNode(f'node_{i}') for i in range(10)]  # the first ones load libraries
before = anonymous_kib()
nodes += [LifecycleNode(f'more_{i}') for i in range(5)]
print((anonymous_kib() - before) / 5)
os._exit(0)
"""


def test_a_lifecycle_node_takes_little_memory():
    """The Fast DDS profile reduces the queues of a node, which need 1 MB by default."""
    asked = {name: os.environ.get(name, '') for name in ('ROS_DISTRO', 'RMW_IMPLEMENTATION')}
    chosen = choose_transports({**asked, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, 'SUBNET')
    if PROFILES_OF.get(asked['ROS_DISTRO']) not in chosen:
        pytest.skip('the profile is for Fast DDS')
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM],
        env={**os.environ, **chosen},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert float(done.stdout) < 1200  # KiB
