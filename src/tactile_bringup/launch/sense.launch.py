# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One finger that another node moves: ``ros2 launch tactile_bringup sense.launch.py``."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription


def generate_launch_description():
    # The nodes and the arguments are in hand.launch.py.
    hand = str(Path(__file__).with_name('hand.launch.py'))
    return LaunchDescription(
        [IncludeLaunchDescription(hand, launch_arguments={'fingers': '/'}.items())]
    )
