# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grbl's ``$n=v`` settings."""

from __future__ import annotations

import math

from tactile_sim.descriptions.description import Guide
from tactile_sim.devices.grbl.gcode import GcodeError

SOFT_LIMITS, HOMING, HOMING_DIRECTION, HOMING_SLOW, HOMING_FAST, PULL_OFF = 20, 22, 23, 24, 25, 27
REPORT_MASK, STEPS_PER_MM, MAX_RATE, ACCELERATION, TRAVEL = 10, 100, 110, 120, 130


def make_settings(guide: Guide) -> dict[int, float]:
    """Contents of ``$$`` of a Grbl that is set up for this guide."""
    return {
        0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0,
        20: 1, 21: 0, 22: 1, 23: 1, 24: 100.0, 25: 2000.0, 26: 25, 27: guide.pull_off_m * 1e3,
        30: 1000, 31: 0, 32: 0, 100: 1e-3 / guide.step_m, 110: guide.max_speed_m_s * 6e4,
        120: guide.acceleration_m_s2 * 1e3, 130: guide.travel_m * 1e3,
    }  # fmt: skip


def write_setting(settings: dict[int, float], text: str) -> None:
    """Carry out ``n=v``.

    Raises
    ------
    GcodeError
        No such setting, or a value that Grbl refuses.
    """
    number, equals, value = text.partition('=')
    if not equals or not number.isdecimal() or int(number) not in settings:
        raise GcodeError(3)
    try:
        setting = float(value)
    except ValueError:
        raise GcodeError(2) from None
    if not math.isfinite(setting):
        raise GcodeError(2)
    if setting < 0.0:
        raise GcodeError(4)
    if int(number) == SOFT_LIMITS and setting and not settings[HOMING]:
        raise GcodeError(10)
    settings[int(number)] = setting
    if int(number) == HOMING and not setting:
        settings[SOFT_LIMITS] = 0


def format_setting(number: int, value: float) -> str:
    """Write a value as Grbl does."""
    return f'{value:.3f}' if number in (11, 12, 24, 25, 27) or number >= 100 else f'{value:.0f}'
