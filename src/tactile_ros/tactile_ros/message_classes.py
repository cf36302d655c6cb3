# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Message classes by their ROS type name, and times in messages."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def message_class(type_name: str) -> Any:
    """Return the class of a type such as ``sensor_msgs/msg/JointState``.

    Raises
    ------
    LookupError
        If this message type is not installed.
    """
    package, kind, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.{kind}'), name)
    except (ImportError, AttributeError) as error:
        raise LookupError(f'the message type {type_name} is not installed') from error


def time_to_msg(stamp_ns: int) -> Any:
    """Return the ``builtin_interfaces/Time`` of a time [ns]."""
    from builtin_interfaces.msg import Time

    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)
