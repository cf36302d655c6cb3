# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records to messages."""

from __future__ import annotations

from typing import Any


def joint_state_to_msg(
    joint_name: str, frame_id: str, position_m: float, velocity_m_s: float, stamp_ns: int
) -> Any:
    """Return the ``sensor_msgs/JointState`` of one linear joint; effort stays empty.

    Parameters
    ----------
    joint_name, frame_id : str
    position_m, velocity_m_s : float
        [m], [m/s]
    stamp_ns : int
        ROS time [ns].
    """
    from builtin_interfaces.msg import Time
    from sensor_msgs.msg import JointState

    message = JointState()
    message.header.stamp = Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    message.header.frame_id = frame_id
    message.name = [joint_name]
    message.position = [position_m]
    message.velocity = [velocity_m_s]
    return message
