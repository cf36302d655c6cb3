# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""States of the linear guide and of the tendon actuator."""

from __future__ import annotations

from typing import NamedTuple


class GuideState(NamedTuple):
    """State of the guide in one status report."""

    position_m: float | None  # position from the negative end of travel [m]; None if not homed
    velocity_m_s: float  # reported speed with the sign of the running move [m/s]
    state: str  # state of the controller: Idle, Run, Hold, Alarm, ...
    received_at_ns: int  # time of arrival on the client's clock [ns]


class TendonState(NamedTuple):
    """State of the tendon actuator in one poll."""

    displacement_m: float  # displacement from the zero, positive when tightened [m]
    velocity_m_s: float  # positive while the tendon is tightened [m/s]
    current_a: float  # motor current, positive when pulling; includes friction [A]
    voltage_v: float  # supply voltage [V]
    temperature_c: float  # temperature of the servo [C]
    received_at_ns: int  # time of arrival on the client's clock [ns]
