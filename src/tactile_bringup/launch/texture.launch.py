# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rig for the texture protocol: ``ros2 launch tactile_bringup texture.launch.py``."""

from tactile_bringup.launching import launch_description


def generate_launch_description():
    return launch_description('texture')
