# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds where the tendon is just taut: lets it go slack, then winds in slowly."""

from __future__ import annotations

from collections.abc import Callable

from linear_guide_driver.errors import MotionFailedError, MotionRefusedError
from linear_guide_driver.records import TendonState

POLLS = 3
"""In a row that must agree on taut or slack: one sample may be noise."""

SLACK_SHARE = 0.5
"""Share of the taut tension below which the tendon counts as slack."""

Wind = Callable[[int, Callable[[TendonState], bool]], TendonState]
"""Winds in (1) or out (-1) as far as homing may, until the function says so, and holds."""


def find_taut(
    wind: Wind, read_tension: Callable[[], float | None], taut_tension_n: float
) -> TendonState:
    """Return the first state in which the tendon was taut; it is held a little further in.

    Parameters
    ----------
    wind : callable
        See `Wind`.
    read_tension : callable
        Returns the present tension [N]; None when no valid sample arrives.
    taut_tension_n : float
        [N]

    Raises
    ------
    MotionRefusedError, MotionFailedError, MotionStoppedError
    """
    present_n = read_tension()
    if present_n is None:
        raise MotionRefusedError(
            'Homing needs the tendon sensor and no valid strain sample arrives; start the sensor.'
        )
    slack_n = SLACK_SHARE * taut_tension_n
    if present_n > slack_n:
        _seek(wind, -1, read_tension, lambda n: n <= slack_n, 'slack; tare the sensor')
    return _seek(
        wind, 1, read_tension, lambda n: n >= taut_tension_n, 'taut; look after the tendon'
    )


def _seek(
    wind: Wind,
    direction: int,
    read_tension: Callable[[], float | None],
    is_there: Callable[[float], bool],
    what: str,
) -> TendonState:
    there: list[TendonState] = []

    def until(state: TendonState) -> bool:
        tension_n = read_tension()
        if tension_n is not None and is_there(tension_n):
            there.append(state)
        else:
            there.clear()
        return len(there) >= POLLS

    end = wind(direction, until)
    if len(there) < POLLS:
        raise MotionFailedError(
            f'Homing failed at {end.displacement_m:.4f} m: the tendon did not become {what}.'
        )
    return there[0]
