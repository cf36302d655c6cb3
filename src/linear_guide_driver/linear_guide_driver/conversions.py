# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
