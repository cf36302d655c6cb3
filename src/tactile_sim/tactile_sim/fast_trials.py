# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many trials at once, without devices and without waiting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_sim.description import Rig
from tactile_sim.errors import DescriptionError
from tactile_sim.load_cell_device import (
    GRAVITY_M_S2,
    compute_reading_kg,
    interpolate_tension,
)
from tactile_sim.motion import Motion, Segment, move_duration_s, plan_ramp
from tactile_sim.mounting import build_mount, draw_variation, make_seeds
from tactile_sim.plant import Plant, Variation

__all__ = [
    'Move',
    'SimulatedTrials',
    'Timeline',
    'move_duration_s',
    'simulate_motion',
    'simulate_trials',
]

FloatArray = NDArray[np.float64]

STEP_S = 4e-4


@dataclass(frozen=True)
class Move:
    """A trapezoid of one axis: from where it stands to ``target_m``."""

    start_s: float
    target_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Timeline:
    """What guide and tendon do in one trial.

    Attributes
    ----------
    guide_moves, tendon_moves
        In order of time; a move starts after the one before it has ended.
    duration_s
        Length of the trial [s].
    guide_start_m
        Where the guide stands at the start; the tendon starts slack, at 0 [m].
    """

    guide_moves: Sequence[Move]
    tendon_moves: Sequence[Move]
    duration_s: float
    guide_start_m: float = 0.060


@dataclass(frozen=True)
class SimulatedTrials:
    """Trials as the load cell recorded them.

    Attributes
    ----------
    tension_n : ndarray of float, shape (trials, samples)
        What the load cell's lines say, in newtons.
    sample_times_s : ndarray of float, shape (samples,)
        Time of each sample since the start of the timeline, by the true clock [s].
    truth : mapping of str to ndarray, shape (trials, samples)
        ``tension_n`` without noise, ``contact_force_n`` [N] and ``bend_rad`` [rad].
    """

    tension_n: FloatArray
    sample_times_s: FloatArray
    truth: Mapping[str, FloatArray]


def simulate_trials(
    protocol: str,
    object_label: str,
    contact: str,
    timeline: Timeline,
    count: int,
    seed: int,
) -> SimulatedTrials:
    """Simulate ``count`` trials of one object; trial i depends on seed and i alone.

    Raises
    ------
    DescriptionError
        No such protocol, object or contact, or the timeline does not fit the rig.
    ConvergenceError
        A step of the physics found no solution.
    """
    if count < 1:
        raise DescriptionError(f'count is {count}; it must be at least 1')
    rig = build_mount(protocol, object_label, contact)[1]
    seeds = make_seeds(protocol, object_label, contact, seed, count)
    generators = [np.random.default_rng(s) for s in seeds]
    variation = draw_variation(rig.variation, generators)
    times_s, truth = simulate_motion(protocol, object_label, contact, timeline, variation)
    noise = np.stack([generator.standard_normal(len(times_s)) for generator in generators])
    reading_kg = compute_reading_kg(rig.load_cell, truth['tension_n'], noise)
    return SimulatedTrials(reading_kg * GRAVITY_M_S2, times_s, truth)


def simulate_motion(
    protocol: str,
    object_label: str,
    contact: str,
    timeline: Timeline,
    variation: Variation,
    step_s: float = STEP_S,
) -> tuple[FloatArray, Mapping[str, FloatArray]]:
    """The physics of ``simulate_trials`` for given variations: sample times and truth."""
    finger, rig, mount = build_mount(protocol, object_label, contact)
    guide, tendon = plan_timeline(rig, timeline)
    lag_s = variation.phase * rig.load_cell.period_s
    start = -lag_s
    plant = Plant(
        finger, rig, mount, variation, guide.positions_at(start), tendon.positions_at(start)
    )
    period_s = rig.load_cell.period_s
    samples = int(timeline.duration_s / period_s + 1e-9) + 1
    sample_times_s: FloatArray = period_s * np.arange(samples, dtype=np.float64)
    names = ('tension_n', 'contact_force_n', 'bend_rad')
    rows: dict[str, list[FloatArray]] = {name: [] for name in names}
    before = {name: getattr(plant, name) for name in names}
    taken = 0
    for step in range(int(np.ceil(timeline.duration_s / step_s)) + 1):
        if step:
            times = step * step_s - lag_s
            plant.step(guide.positions_at(times), tendon.positions_at(times), step_s)
        after = {name: getattr(plant, name) for name in names}
        while taken < len(sample_times_s) and sample_times_s[taken] <= step * step_s + 1e-12:
            for name in names:
                rows[name].append(
                    interpolate_tension(
                        (step - 1) * step_s,
                        before[name],
                        step * step_s,
                        after[name],
                        sample_times_s[taken],
                    )
                )
            taken += 1
        before = after
    truth = {name: np.ascontiguousarray(np.array(rows[name]).T) for name in names}
    return sample_times_s[:taken], truth


def plan_timeline(rig: Rig, timeline: Timeline) -> tuple[Motion, Motion]:
    """Motions of guide and tendon; targets are rounded as the devices round them."""
    if not 0.0 <= timeline.guide_start_m <= rig.guide.travel_m:
        raise DescriptionError(f'guide_start_m is {timeline.guide_start_m}; it is off the guide')
    if not 0.0 < timeline.duration_s < 3600.0:
        raise DescriptionError(f'duration_s is {timeline.duration_s}; it must be in (0, 3600)')
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
) -> Motion:
    segments: list[Segment] = []
    position, free_s = start_m, -np.inf
    for move in moves:
        if move.start_s < free_s - 1e-9:
            raise DescriptionError(
                f'the {name} move at {move.start_s} s starts before the one before it ends, '
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
    return Motion(start_m, segments, position)
