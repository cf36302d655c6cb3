# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One simulated trial, and the shapes of the finger in it, as they are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from tactile_bringup.records import TrialConfig
from tactile_lab.simulation.simulated_trials import plan_trial, PlannedTrial, SimulationPlan
from tactile_ros.errors import TactileError
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.descriptions.description import Finger
from tactile_sim.physics.equations import compute_curve
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import simulate_motion
from tactile_sim.physics.variation import Variation

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """The finger at one moment.

    Attributes
    ----------
    moment : str
        ``at rest``, ``start``, ``middle`` or ``end``, of the phase that is measured.
    at_s : float
        Since the trial's first sample [s].
    curve_m : ndarray of shape (points, 2)
        Centre line in the guide's frame: place along the guide, drop below the base [m].
    """

    moment: str
    at_s: float
    curve_m: FloatArray


@dataclass(frozen=True)
class TrialPicture:
    """Data for the drawing of a trial.

    Attributes
    ----------
    times_s : ndarray of shape (samples,)
        Times since the trial's first sample [s].
    truth : mapping of str to ndarray
        Ground truth of the simulator for this trial only.
    shapes : sequence of Shape
    """

    plan: SimulationPlan
    label: str
    catalogue: Catalogue
    planned: PlannedTrial
    times_s: FloatArray
    truth: Mapping[str, FloatArray]
    shapes: Sequence[Shape]


def simulate_picture(
    plan: SimulationPlan, config: TrialConfig, catalogue: Catalogue
) -> TrialPicture:
    """Simulate the trial that is drawn, and choose the moments at which the finger is."""
    label = _choose_label(plan.protocol, catalogue)
    planned = plan_trial(config, plan.request, catalogue)
    scene = build_scene(plan.protocol, label, plan.contact, catalogue)
    motion = simulate_motion(scene, planned.timeline, Variation.none(1), keep_modes=True)
    if np.isfinite(motion.failed_at_s[0]):
        raise TactileError(
            f'the simulation of a trial on {label}, to draw it, found no equilibrium at '
            f'{motion.failed_at_s[0]:.3f} s; check the description'
        )
    times_s, truth = motion.sample_times_s, motion.truth
    finger = catalogue.finger(plan.contact)
    shapes = []
    for moment, at_s, guide_m in _moments(planned):
        sample = min(int(np.searchsorted(times_s, at_s)), len(times_s) - 1)
        curve_m = compute_curve(finger.length_m, truth['modes_rad'][0, sample])
        shapes.append(Shape(moment, at_s, curve_m + np.array([guide_m, 0.0])))
    alone = {name: values[0] for name, values in truth.items()}
    return TrialPicture(plan, label, catalogue, planned, times_s, alone, shapes)


def _choose_label(protocol: str, catalogue: Catalogue) -> str:
    """Return something on which there is something to see."""
    labels = catalogue.labels(protocol)
    if protocol == 'texture':
        return next((name for name in labels if catalogue.plate(name).groove != 'none'), labels[0])
    if protocol == 'stiffness':
        # The softest; without stiffness there is no object.
        return min(labels, key=lambda name: catalogue.body(name).stiffness_n_m or math.inf)
    return min(labels, key=lambda name: catalogue.held_object(name).body.friction)


def find_measured_phase(planned: PlannedTrial) -> str:
    return next(name for name, _ in planned.phases if name in ('glide', 'hold', 'pull'))


def _moments(planned: PlannedTrial) -> list[tuple[str, float, float]]:
    """Return (moment, time, guide position) of the shapes that are drawn."""
    starts, measured = dict(planned.phases), find_measured_phase(planned)
    begin_s, end_s = starts[measured], starts['release']
    begin_m = planned.timeline.guide_start_m
    end_m = planned.timeline.guide_moves[-1].target_m
    moments = [('at rest', 0.0, begin_m), ('start', begin_s, begin_m)]
    if measured == 'glide':
        # It speeds up and slows down alike: half of the way at half of the time.
        moments.append(('middle', (begin_s + end_s) / 2, (begin_m + end_m) / 2))
    return [*moments, ('end', end_s, end_m)]


def compute_touching_tip(finger: Finger) -> tuple[float, float]:
    """Return reach and drop of the tip when it first touches, bent in an arc [m]."""
    modes_rad = np.array([np.radians(finger.contact_bend_deg), 0.0, 0.0])
    reach_m, drop_m = compute_curve(finger.length_m, modes_rad)[-1]
    return float(reach_m), float(drop_m)


def surface_drop_m(finger: Finger) -> float:
    """Return how far below the base the top of plates and objects is drawn [m].

    The model's drop is that of the tip's lowest point; in the figure the centre line ends
    in the middle of the tip, which moves the top down by its radius and changes nothing else.
    """
    return compute_touching_tip(finger)[1] + finger.tip_radius_m
