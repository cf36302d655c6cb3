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
