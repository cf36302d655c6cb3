# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording, on its own time: ``ros2 launch tactile_bringup replay.launch.py``."""

from tactile_bringup.launching import launch_description


def generate_launch_description():
    return launch_description('replay')
