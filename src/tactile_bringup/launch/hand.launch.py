# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Any fingers of a hand that moves itself: ``ros2 launch tactile_bringup hand.launch.py``."""

from tactile_bringup.launching import launch_description


def generate_launch_description():
    return launch_description('hand')
