# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the safety of the tendon can be in, order, know and end with; see `tendon_safety`."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """See the table of `tendon_safety`."""

    FREE = 'free'
    HOLDING = 'holding'
    RELEASING = 'releasing'


class Order(Enum):
    """What the servo has to do now."""

    FOLLOW = 'follow the goal'
    HOLD = 'hold'
    RELEASE = 'let out to slack'


class Zero(Enum):
    """What is known of the displacement's zero."""

    KNOWN = 'homed, or taken where the sensor read a slack tendon'
    UNCONFIRMED = 'taken where the tendon came to rest; the sensor has not confirmed it'
    UNKNOWN = 'unknown'


class Ending(Enum):
    """Why safety has ended a pull."""

    REACHED = 'the stop tension was reached'
    OVER_LIMIT = 'the limit was exceeded'
    LOST = 'something needed was lost'
    STOPPED = 'it was stopped on request'
