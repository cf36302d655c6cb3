# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rig for the stiffness protocol: ``ros2 launch tactile_bringup stiffness.launch.py``."""

from tactile_bringup.launching import launch_description


def generate_launch_description():
    return launch_description('stiffness')
