# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture trials simulated in MuJoCo, in which the finger is a chain of hinges.

Geometry, elasticity, damping, weight, tendon and contact law are the same as in `tactile_sim`. The
finger only bends at the hinges. Tendon friction and creep are not modelled, so trials of
`tactile_sim` must be simulated without them for a comparison.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
import time
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.description import Finger
from tactile_sim.physics.equations import GRAVITY_M_S2
from tactile_sim.physics.scene import Surface

FloatArray = NDArray[np.float64]
Positions = Callable[[FloatArray], FloatArray]

_NEVER_M = 1e3  # end of the tendon's dead band; so high that the tendon never pushes
_POINT_KG_M2 = 1e-12  # MuJoCo requires moments of inertia above zero


@dataclass(frozen=True)
class TwinContact:
    """The plate under the finger in one trial.

    ``clearance_m`` is the drop of the tip at which it touches the surface at height 0 [m].
    ``offset_m`` is the position of the clamp of the finger along the surface when the guide is at
    position 0 [m].
    """

    surface: Surface
    clearance_m: float
    offset_m: float
    friction: float


class TipState(NamedTuple):
    """Contact of tip and plate.

    It contains the normal force and the friction of the plate on the tip [N], the position on the
    plate at which the tip sticks, and the compression of the rubber of the tip [m].
    """

    normal_n: float
    friction_n: float
    slider_m: float
    squeezed_m: float


@dataclass(frozen=True)
class TwinResult:
    """One simulated trial: time, tension and vertical force on the tip at the start of each step.

    ``elapsed_s`` is the processor time of the whole loop, in which the contact is computed in
    Python. ``step_elapsed_s`` is the processor time of the same number of MuJoCo steps with
    constant forces [s of one core].
    """

    times_s: FloatArray
    tension_n: FloatArray
    contact_force_n: FloatArray
    elapsed_s: float
    step_elapsed_s: float


def write_finger_mjcf(finger: Finger, step_s: float, hinges: int) -> str:
    """Describe the finger as a chain of hinges in MuJoCo's format.

    The hinges are in the middle of equal segments, so the end links are half as long as the
    others. With n hinges on a finger of length L and bending stiffness EI, each hinge has the
    stiffness n EI / L. In MuJoCo, z points up; a positive hinge angle bends the finger down.
    """
    segment_m = finger.length_m / hinges
    tip = _write_inertial(0.0, finger.tip_mass_kg, 0.0)
    chain = f'<body name="tip" pos="{segment_m / 2!r} 0 0">{tip}</body>'
    for index in reversed(range(hinges)):
        last = index == hinges - 1
        length_m = segment_m / 2 if last else segment_m
        mass_kg = finger.mass_kg * length_m / finger.length_m
        place_m = segment_m / 2 if index == 0 else segment_m
        chain = (
            f'<body pos="{place_m!r} 0 0">'
            f'<joint name="h{index}" type="hinge" axis="0 1 0"'
            f' stiffness="{hinges * finger.bending_stiffness_nm_rad!r}"'
            f' damping="{hinges * finger.damping_nm_s_rad!r}"/>'
            f'{_write_inertial(length_m / 2, mass_kg, mass_kg * length_m**2 / 12)}{chain}</body>'
        )
    joints = ''.join(
        f'<joint joint="h{index}" coef="{finger.moment_arm_m!r}"/>' for index in range(hinges)
    )
    return (
        f'<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/>'
        f'<option timestep="{step_s!r}" integrator="implicitfast"'
        f' gravity="0 0 {-GRAVITY_M_S2!r}"/>'
        f'<worldbody>{chain}</worldbody>'
        f'<tendon><fixed name="tendon" stiffness="{finger.tendon_stiffness_n_m!r}"'
        f' springlength="0 {_NEVER_M!r}">{joints}</fixed></tendon></mujoco>'
    )


def _write_inertial(place_m: float, mass_kg: float, inertia_kg_m2: float) -> str:
    across = max(inertia_kg_m2, _POINT_KG_M2)
    return (
        f'<inertial pos="{place_m!r} 0 0" mass="{max(mass_kg, _POINT_KG_M2)!r}"'
        f' diaginertia="{_POINT_KG_M2!r} {across!r} {across!r}"/>'
    )


def compute_chain_tip(finger: Finger, bend_rad: float, hinges: int) -> tuple[float, float]:
    """Return how far the tip of the chain drops and reaches if all hinge angles are equal [m].

    The distance between this tip and the tip of an arc decreases with 1 / hinges^2. With 11
    hinges, it is 9 micrometres in drop and 25 micrometres in reach. On steep grooves, this changes
    samples of the tension by up to a fifth of their alternating part. Therefore, in a comparison
    the plate must be placed relative to the tip of the chain.
    """
    slope_rad = bend_rad * np.arange(hinges + 1) / hinges
    share_m = np.full(hinges + 1, finger.length_m / hinges)
    share_m[[0, -1]] /= 2
    return float(share_m @ np.sin(slope_rad)), float(share_m @ np.cos(slope_rad))


def press_tip(
    finger: Finger,
    contact: TwinContact,
    drop_m: float,
    place_m: float,
    tip: TipState,
    step_s: float,
) -> TipState:
    """Return the contact after one step.

    ``drop_m`` is how far the tip is below its straight position, and ``place_m`` is its position
    on the surface [m]. ``tip`` is the contact before the step.
    """
    indentation_m = drop_m - contact.clearance_m + _sample(contact.surface, place_m)[0]
    # The rubber is a spring and damper in parallel. It never pulls, and recovers without load.
    damper_n_m = finger.tip_damping_n_s_m / step_s
    both_n_m = finger.tip_stiffness_n_m + damper_n_m
    held_n = damper_n_m * tip.squeezed_m
    normal_n = max(both_n_m * indentation_m - held_n, 0.0)
    limit_n = contact.friction * normal_n
    stuck_n = finger.tip_shear_stiffness_n_m * (place_m - tip.slider_m)
    friction_n = min(max(stuck_n, -limit_n), limit_n)
    return TipState(
        normal_n,
        friction_n,
        place_m - friction_n / finger.tip_shear_stiffness_n_m,
        (normal_n + held_n) / both_n_m,
    )


def _sample(surface: Surface, place_m: float) -> tuple[float, float]:
    """Return height [m] and slope [1] at one position, like `Surface.sample`."""
    cell = (place_m - surface.origin_m) / surface.spacing_m
    index = min(max(math.floor(cell), 0), len(surface.table) - 1)
    part = min(max(cell - index, 0.0), 1.0)
    height_m, rise_m, slope, bend = surface.table[index].tolist()
    return height_m + part * rise_m, slope + part * bend


def simulate_twin(
    finger: Finger,
    contact: TwinContact,
    guide_positions: Positions,
    tendon_positions: Positions,
    duration_s: float,
    step_s: float,
    hinges: int,
) -> TwinResult:
    """Simulate one texture trial; the finger starts straight and at rest.

    The clamp is fixed and the plate moves, which is equivalent at constant speed. During the ramps
    of the guide, the inertia of 18 g at 0.5 m/s^2 would add 9 mN. Tendon friction and creep of the
    finger are not simulated. Guide and tendon are given as positions [m] at an array of times [s].

    Raises `FloatingPointError` if the motion diverges because the step is much too long. Smaller
    errors due to a long step are not detected.
    """
    model = mujoco.MjModel.from_xml_string(write_finger_mjcf(finger, step_s, hinges))
    data = mujoco.MjData(model)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, 'tip')
    steps = round(duration_s / step_s)
    times_s: FloatArray = step_s * np.arange(steps, dtype=np.float64)
    places_m = (contact.offset_m + guide_positions(times_s)).tolist()
    windings_m = tendon_positions(times_s).tolist()
    spring, length = model.tendon_lengthspring[0], data.ten_length
    tip_place, tip_force = data.xpos[body], data.xfrc_applied[body]
    out = np.zeros((2, steps))
    tip = TipState(0.0, 0.0, places_m[0] + finger.length_m, 0.0)
    start_s = time.process_time()
    for step in range(steps):
        spring[0] = windings_m[step]
        mujoco.mj_step1(model, data)
        reach_m, drop_m = float(tip_place[0]), -float(tip_place[2])
        place_m = places_m[step] + reach_m
        tip = press_tip(finger, contact, drop_m, place_m, tip, step_s)
        slope = _sample(contact.surface, place_m)[1]
        tip_force[0] = -(tip.friction_n + tip.normal_n * slope)
        tip_force[2] = tip.normal_n - tip.friction_n * slope
        mujoco.mj_step2(model, data)
        tension_n = finger.tendon_stiffness_n_m * max(windings_m[step] - float(length[0]), 0.0)
        out[:, step] = tension_n, tip.normal_n
    elapsed_s = time.process_time() - start_s
    # MuJoCo does not raise an exception, but warns and restarts from rest.
    if any(warning.number for warning in data.warning) or not np.isfinite(out).all():
        raise FloatingPointError(
            f'MuJoCo diverged with steps of {step_s * 1e3:g} ms: use shorter steps'
        )
    start_s = time.process_time()
    mujoco.mj_step(model, data, nstep=steps)
    step_elapsed_s = time.process_time() - start_s
    return TwinResult(times_s, *out, elapsed_s, step_elapsed_s)
