# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Message classes by their ROS type name, and conversion of fields that many messages have."""

from __future__ import annotations

import dataclasses
from enum import IntEnum
from importlib import import_module
from typing import Any, TypeVar

from tactile_ros.errors import MessageError

_Enum = TypeVar('_Enum', bound=IntEnum)


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
    """Convert a time [ns] to a ``builtin_interfaces/Time``."""
    from builtin_interfaces.msg import Time

    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def time_from_msg(stamp: Any) -> int:
    """Return the nanoseconds of a ``builtin_interfaces/Time``."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def header_to_msg(stamp_ns: int, frame_id: str = '') -> Any:
    """Return a ``std_msgs/Header`` with a time [ns] and the id of a frame."""
    from std_msgs.msg import Header

    return Header(stamp=time_to_msg(stamp_ns), frame_id=frame_id)


def enum_from_msg(kind: type[_Enum], field: str, value: Any) -> _Enum:
    """Return the constant of the enumeration ``kind`` that has this value.

    Raise `MessageError` if there is no such constant. ``field`` is the name of the message field.
    """
    try:
        return kind(int(value))
    except ValueError:
        names = ', '.join(f'{each.value} ({each.name})' for each in kind)
        raise MessageError(f'{field} is {value}; it must be one of {names}') from None


def copy_fields(msg: Any, record: Any, **converted: Any) -> Any:
    """Return an instance of the dataclass ``record`` with the contents of a message.

    ``converted`` has values of fields that were converted. The other fields are copied from the
    fields of the message that have the same name.
    """
    names = [field.name for field in dataclasses.fields(record) if field.name not in converted]
    return record(**{name: getattr(msg, name) for name in names}, **converted)
