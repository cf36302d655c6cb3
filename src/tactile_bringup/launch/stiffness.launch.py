# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig for the stiffness protocol: ``ros2 launch tactile_bringup stiffness.launch.py``."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription


def generate_launch_description():
    # The nodes and the arguments are in rig.launch.py.
    rig = str(Path(__file__).with_name('rig.launch.py'))
    return LaunchDescription(
        [IncludeLaunchDescription(rig, launch_arguments={'protocol': 'stiffness'}.items())]
    )
