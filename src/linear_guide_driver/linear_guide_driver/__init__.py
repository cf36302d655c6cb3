# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Moves the linear guide (Grbl) and the tendon actuator (Dynamixel) as ROS 2 actions."""
