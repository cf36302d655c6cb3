# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readers that extract tension and stamp from messages on a topic.

Messages are read by field names alone, so messages of rclpy and of the rosbags library both
fit.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.records import AXES, NORM, TendonSensorConfig


class ReadingError(TendonSensorError):
    """A message holds no tension."""


class TopicReading(NamedTuple):
    """One message.

    Attributes
    ----------
    stamp_ns
        Stamp of its header [ns]; None when it has no header, or a stamp of zero.
    tension_n
        Tension, scaled [N]; not finite when the message says so.
    wrench
        Fx, Fy, Fz [N], Tx, Ty, Tz [N m] in the axes of the message; None for a message of one
        value, and where the tension is the length of the force.
    """

    stamp_ns: int | None
    tension_n: float
    wrench: list[float] | None = None


def read_wrench_stamped(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``geometry_msgs/WrenchStamped``."""
    reading = read_wrench(message.wrench, config)
    return reading._replace(stamp_ns=_read_stamp(message))


def read_wrench(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``geometry_msgs/Wrench``."""
    force, torque = message.force, message.torque
    wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    if config.axis == NORM:
        return TopicReading(None, config.scale * math.hypot(*wrench[:3]))
    return TopicReading(None, config.scale * wrench[AXES.index(config.axis)], wrench)


def read_value(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``std_msgs/Float64`` or ``std_msgs/Float32``."""
    return TopicReading(None, config.scale * float(message.data))


def read_joint_state(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``sensor_msgs/JointState``: the effort of a joint, found by name.

    Raises
    ------
    ReadingError
        When there is no such joint, or it has no effort.
    """
    names = list(message.name)
    joint = config.joint or (names[0] if len(names) == 1 else '')
    if joint not in names:
        known = ', '.join(names) or 'none'
        if joint:
            raise ReadingError(f'there is no joint {joint}, only {known}; set "joint"')
        raise ReadingError(f'the joints are {known}; name one of them in "joint"')
    index = names.index(joint)
    if index >= len(message.effort):
        raise ReadingError(
            f'the joint {joint} has no effort; have its driver or joint_state_broadcaster '
            'publish the effort'
        )
    return TopicReading(_read_stamp(message), config.scale * float(message.effort[index]))


READERS: dict[str, Callable[[Any, TendonSensorConfig], TopicReading]] = {
    'geometry_msgs/msg/WrenchStamped': read_wrench_stamped,
    'geometry_msgs/msg/Wrench': read_wrench,
    'std_msgs/msg/Float64': read_value,
    'std_msgs/msg/Float32': read_value,
    'sensor_msgs/msg/JointState': read_joint_state,
}
"""Reader of each supported message type, by the name of the type."""


def _read_stamp(message: Any) -> int | None:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) or None
