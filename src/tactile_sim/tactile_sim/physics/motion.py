# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of axes with limited acceleration, and timelines of trials.

The simulated devices and the simulated trials use this module. Its functions accept any unit of
length, such as metres, millimetres or encoder counts. Times are in seconds.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.description import Rig
from tactile_sim.errors import DescriptionError

FloatArray = NDArray[np.float64]

_LONGEST_S = 3600.0


class Segment(NamedTuple):
    """Part of a motion, with constant acceleration. It begins at ``start_s`` [s]."""

    start_s: float
    duration_s: float
    position: float
    velocity: float
    acceleration: float

    @property
    def end_s(self) -> float:
        return self.start_s + self.duration_s

    @property
    def end_position(self) -> float:
        t = self.duration_s
        return self.position + self.velocity * t + self.acceleration * t * t / 2


class Trajectory:
    """Motion of an axis, which consists of segments in the order of time.

    The axis rests at ``start`` before the first segment, at ``target`` after the last one, and
    between segments that do not follow each other immediately.
    """

    def __init__(self, start: float, segments: Sequence[Segment], target: float) -> None:
        parts = [Segment(-math.inf, math.inf, start, 0.0, 0.0)]
        for i, segment in enumerate(segments):
            parts.append(segment)
            last = i + 1 == len(segments)
            if last or segments[i + 1].start_s > segment.end_s + 1e-12:
                rest = target if last else segments[i + 1].position
                parts.append(Segment(segment.end_s, math.inf, rest, 0.0, 0.0))
        self.target = target if segments else start
        self.end_s = segments[-1].end_s if segments else -math.inf
        self._parts = parts
        self._starts = [p.start_s for p in parts]

    @cached_property
    def _start_array(self) -> FloatArray:
        return np.array(self._starts)

    @cached_property
    def _table(self) -> FloatArray:
        finite = np.array([[0.0 if math.isinf(v) else v for v in p] for p in self._parts])
        return np.ascontiguousarray(finite.T)

    @property
    def busy_s(self) -> list[tuple[float, float]]:
        """Start and end of each segment [s]."""
        moving = [part for part in self._parts if not math.isinf(part.duration_s)]
        return [(part.start_s, part.end_s) for part in moving]

    def state_at(self, time_s: float) -> tuple[float, float]:
        """Return position and velocity at a time."""
        part = self._parts[bisect_right(self._starts, time_s) - 1]
        if math.isinf(part.duration_s):
            return part.position, 0.0
        t = time_s - part.start_s
        position = part.position + part.velocity * t + part.acceleration * t * t / 2
        return position, part.velocity + part.acceleration * t

    def states_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities at increasing times, exactly equal to `state_at`."""
        count = len(times_s)
        first, last = (bisect_right(self._starts, times_s[i]) - 1 if count else 0 for i in (0, -1))
        part = self._parts[first]
        if first == last and math.isinf(part.duration_s):
            return np.full(count, part.position), np.zeros(count)
        index = np.searchsorted(self._start_array, times_s, side='right') - 1
        start, _, position, velocity, acceleration = self._table[:, index]
        t = times_s - start
        positions = position + velocity * t + acceleration * t * t / 2
        return positions, velocity + acceleration * t

    def positions_at(self, times_s: FloatArray) -> FloatArray:
        """Return the position at each of the times; the result has the shape of ``times_s``."""
        index = np.searchsorted(self._start_array, times_s, side='right') - 1
        start, _, position, velocity, acceleration = self._table[:, index]
        t = times_s - start
        return np.asarray(position + t * (velocity + t * (acceleration / 2)))


def plan_ramp(
    start_s: float,
    position: float,
    target: float,
    speed: float,
    acceleration: float,
    entry_speed: float = 0.0,
    exit_speed: float = 0.0,
) -> list[Segment]:
    """Return the segments of a motion with a trapezoidal speed profile to ``target``.

    It is the fastest motion with the maximum speed ``speed`` and the maximum ``acceleration``.
    Entry and exit speeds are positive towards the target. The distance must be long enough for the
    change between them. If the entry speed is above ``speed``, it is first reduced.
    """
    distance = abs(target - position)
    if distance == 0.0:
        return []
    sign = math.copysign(1.0, target - position)
    peak = math.sqrt(acceleration * distance + (entry_speed**2 + exit_speed**2) / 2)
    peak = max(min(speed, peak), exit_speed)
    changes = [(entry_speed, peak), (peak, exit_speed)]
    ramps = [abs(after - before) / acceleration for before, after in changes]
    ramp_length = sum(t * (v0 + v1) / 2 for t, (v0, v1) in zip(ramps, changes, strict=True))
    cruise = max(distance - ramp_length, 0.0) / peak
    segments = []
    for duration, (v0, v1) in (
        (ramps[0], changes[0]),
        (cruise, (peak, peak)),
        (ramps[1], changes[1]),
    ):
        if duration > 0.0:
            slope = math.copysign(acceleration, v1 - v0) if v1 != v0 else 0.0
            segments.append(Segment(start_s, duration, position, sign * v0, sign * slope))
            start_s, position = segments[-1].end_s, segments[-1].end_position
    return segments


def plan_stop(
    start_s: float, position: float, velocity: float, acceleration: float
) -> list[Segment]:
    """Return the segments of a motion that brakes from ``velocity`` to rest."""
    if velocity == 0.0:
        return []
    slope = -math.copysign(acceleration, velocity)
    return [Segment(start_s, abs(velocity) / acceleration, position, velocity, slope)]


def plan_move(
    start_s: float,
    position: float,
    velocity: float,
    target: float,
    speed: float,
    acceleration: float,
) -> list[Segment]:
    """Return the segments of a motion to ``target`` that begins with any velocity.

    If the axis cannot stop at the target, it overshoots and returns.
    """
    towards = velocity * (target - position) > 0.0
    if velocity == 0.0:
        return plan_ramp(start_s, position, target, speed, acceleration)
    if towards and velocity**2 <= 2 * acceleration * abs(target - position):
        return plan_ramp(start_s, position, target, speed, acceleration, abs(velocity))
    stop = plan_stop(start_s, position, velocity, acceleration)
    return stop + plan_ramp(stop[0].end_s, stop[0].end_position, target, speed, acceleration)


def plan_legs(
    start_s: float, position: float, legs: Sequence[tuple[float, float]], acceleration: float
) -> list[Segment]:
    """Return the segments of a motion that stops at each of several targets.

    ``legs`` has the target and the maximum speed of each part of the motion.
    """
    segments: list[Segment] = []
    for target, speed in legs:
        segments += plan_ramp(start_s, position, target, speed, acceleration)
        position, start_s = target, segments[-1].end_s if segments else start_s
    return segments


def move_duration_s(distance_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Return the duration of a move over a distance that begins and ends at rest [s]."""
    segments = plan_ramp(0.0, 0.0, abs(distance_m), speed_m_s, acceleration_m_s2)
    return segments[-1].end_s if segments else 0.0


@dataclass(frozen=True)
class Move:
    """A move of one axis to ``target_m``, which begins at ``start_s``."""

    start_s: float
    target_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Timeline:
    """Moves of guide and tendon in one trial.

    A move of an axis must start after its previous move has ended. The guide is at
    ``guide_start_m`` [m] before its first move. The tendon begins at 0, where it is slack.
    """

    guide_moves: Sequence[Move]
    tendon_moves: Sequence[Move]
    duration_s: float
    guide_start_m: float = 0.060


def plan_timeline(rig: Rig, timeline: Timeline) -> tuple[Trajectory, Trajectory]:
    """Return the trajectories of guide and tendon in one trial.

    Targets are rounded to steps of the guide and to counts of the servo, as in the real devices.
    Raises `DescriptionError` when the timeline does not fit the rig.
    """
    if not 0.0 <= timeline.guide_start_m <= rig.guide.travel_m:
        raise DescriptionError(f'guide_start_m is {timeline.guide_start_m}, outside the guide')
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
    return guide, tendon


def _plan_axis(
    name: str,
    start_m: float,
    moves: Sequence[Move],
    max_speed_m_s: float,
    acceleration_m_s2: float,
    unit_m: float,
) -> Trajectory:
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
                f'the {name} move at {move.start_s} s starts before the previous one ends, '
                f'at {free_s:.3f} s; start it later'
            )
        if not 0.0 < move.speed_m_s <= max_speed_m_s:
            raise DescriptionError(
                f'the {name} cannot move at {move.speed_m_s} m/s; its limit is {max_speed_m_s} m/s'
            )
        target = round(move.target_m / unit_m) * unit_m
        ramp = plan_ramp(move.start_s, position, target, move.speed_m_s, acceleration_m_s2)
        segments += ramp
        position = target
        free_s = ramp[-1].end_s if ramp else move.start_s
    return Trajectory(start_m, segments, position)
