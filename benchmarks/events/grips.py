# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated trials with their truth, at the sensor's rate or another."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_lab.simulation.simulated_trials import plan_trial, PlannedTrial
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.trials import simulate_motion, SimulatedMotion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import draw_variation, Variation

FloatArray = NDArray[np.float64]

FAST_HZ = 1000.0


@dataclass(frozen=True)
class Grips:
    """Trials of one object in one session.

    ``motion``: the truth. ``tension_n`` (ndarray of shape (trials, samples)): what the sensor
    reads [N].
    """

    planned: PlannedTrial
    motion: SimulatedMotion
    tension_n: FloatArray
    variation: Variation

    @property
    def times_s(self) -> FloatArray:
        return self.motion.sample_times_s


def simulate_grips(
    request: TrialRequest,
    config: TrialConfig,
    label: str,
    count: int,
    seed: int,
    session: int,
    rate_hz: float = 60.0,
) -> Grips:
    """Simulate trials as `tactile simulate` does; above 60 Hz without the sensor's low pass."""
    catalogue = default_catalogue()
    planned = plan_trial(config, request)
    scene = build_scene(request.protocol, label, request.contact, catalogue)
    steps = STEPS_PER_SAMPLE
    cell = scene.rig.load_cell
    if rate_hz != cell.rate_hz:
        cell = dataclasses.replace(cell, rate_hz=rate_hz, low_pass_hz=rate_hz / 2)
        scene = dataclasses.replace(scene, rig=dataclasses.replace(scene.rig, load_cell=cell))
        steps = 1
    variation, generators = draw_variation(
        catalogue, request.contact, request.protocol, label, seed, session, count
    )
    phase = np.floor(variation.phase * steps) / steps
    variation = dataclasses.replace(variation, phase=phase)
    motion = simulate_motion(scene, planned.timeline, variation, steps_per_sample=steps)
    tension_n = read_tension(cell, motion.sensed_n, variation.sensor_bias_n, generators)
    return Grips(planned, motion, tension_n, variation)


def make_block(tension_n: FloatArray, trial: int, rate_hz: float) -> StrainBlock:
    """One trial as one block of a stream in which trials follow each other."""
    first, period_ns = trial * len(tension_n), round(1e9 / rate_hz)
    return StrainBlock(first * period_ns, first, period_ns, tension_n)
