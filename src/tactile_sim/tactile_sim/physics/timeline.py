# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Timeline of one trial: moves of guide, tendon and held object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from tactile_sim.descriptions.description import Rig
from tactile_sim.errors import DescriptionError
from tactile_sim.physics.motion import Motion, plan_ramp, Segment

_PULL_ACCELERATION_M_S2 = 0.5
_LONGEST_S = 3600.0


@dataclass(frozen=True)
class Move:
    """A trapezoid of one axis: from where it stands to ``target_m``."""

    start_s: float
    target_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Timeline:
    """Moves of the axes in one trial.

    Attributes
    ----------
    guide_moves, tendon_moves
        In order of time; a move starts after the one before it has ended.
    duration_s
        Length of the trial [s].
    guide_start_m
        Guide position at the start [m]; the tendon starts slack, at 0.
    object_moves
        Sideways moves of a held object, from 0; slip protocol only.
    """

    guide_moves: Sequence[Move]
    tendon_moves: Sequence[Move]
    duration_s: float
    guide_start_m: float = 0.060
    object_moves: Sequence[Move] = ()


def plan_timeline(rig: Rig, timeline: Timeline) -> tuple[Motion, Motion, Motion]:
    """Motions of guide, tendon and held object; targets are rounded as the devices round.

    Raises
    ------
    DescriptionError
        The timeline does not fit the rig.
    """
    if not 0.0 <= timeline.guide_start_m <= rig.guide.travel_m:
        raise DescriptionError(f'guide_start_m is {timeline.guide_start_m}; it is off the guide')
    if not 0.0 < timeline.duration_s < _LONGEST_S:
        raise DescriptionError(
            f'duration_s is {timeline.duration_s}; it must be in (0, {_LONGEST_S:g})'
        )
    for move in timeline.guide_moves:
        if not 0.0 <= move.target_m <= rig.guide.travel_m:
            raise DescriptionError(f'the guide cannot go to {move.target_m} m')
    guide = _plan_axis(
        'guide',
        timeline.guide_start_m,
        timeline.guide_moves,
        rig.guide.max_speed_m_s,
        rig.guide.acceleration_m_s2,
        rig.guide.step_m,
    )
    tendon = _plan_axis(
        'tendon',
        0.0,
        timeline.tendon_moves,
        rig.tendon.max_speed_m_s,
        rig.tendon.max_acceleration_m_s2,
        rig.tendon.m_per_count,
    )
    pulled = _plan_axis(
        'held object', 0.0, timeline.object_moves, 1.0, _PULL_ACCELERATION_M_S2, 0.0
    )
    return guide, tendon, pulled


def _plan_axis(
    name: str,
    start_m: float,
    moves: Sequence[Move],
    max_speed_m_s: float,
    acceleration_m_s2: float,
    unit_m: float,
) -> Motion:
    segments: list[Segment] = []
    position, free_s = start_m, -np.inf
    for move in moves:
        if not (math.isfinite(move.start_s) and math.isfinite(move.target_m)):
            raise DescriptionError(
                f'the {name} cannot go to {move.target_m} m at {move.start_s} s; '
                'both must be finite'
            )
        if move.start_s < free_s - 1e-9:
            raise DescriptionError(
                f'the {name} move at {move.start_s} s starts before the one before it ends, '
                f'at {free_s:.3f} s; start it later'
            )
        if not 0.0 < move.speed_m_s <= max_speed_m_s:
            raise DescriptionError(
                f'the {name} cannot move at {move.speed_m_s} m/s; its limit is {max_speed_m_s} m/s'
            )
        target = round(move.target_m / unit_m) * unit_m if unit_m else move.target_m
        ramp = plan_ramp(move.start_s, position, target, move.speed_m_s, acceleration_m_s2)
        segments += ramp
        position = target
        free_s = ramp[-1].end_s if ramp else move.start_s
    return Motion(start_m, segments, position)
