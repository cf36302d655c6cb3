# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scene of a trial: a finger and the plate or object under it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.descriptions.description import Body, Finger, Rig
from tactile_sim.errors import ConvergenceError, DescriptionError
from tactile_sim.physics.finger import layout as at
from tactile_sim.physics.finger.inertia import compute_mass_matrix
from tactile_sim.physics.finger.mechanics import Constants, NO_MASSES
from tactile_sim.physics.finger.solver import advance_trials
from tactile_sim.physics.finger.steps import compute_coefficients
from tactile_sim.physics.surface import build_crown_surface, build_plate_surface, Surface
from tactile_sim.physics.variation import Variation

FloatArray = NDArray[np.float64]

_REST_STEPS_S = (1e-3, 1e-2, 0.1, 1.0, math.inf)
_NO_SURFACE: FloatArray = np.zeros((1, 4))
_FIRST_BEND_RAD = 0.05


@dataclass(frozen=True, eq=False)
class Scene:
    """A finger over a plate (texture), an object (stiffness), a held object (slip) or nothing.

    Attributes
    ----------
    finger, rig
        The description.
    body
        What yields under the fingertip; None for a rigid plate.
    friction, kinetic_friction
        Static coefficient at the fingertip; ratio of the kinetic to it.
    surface
        What the fingertip feels of its shape; None for a level top.
    lead_m
        Coordinate on the surface under the tip at ``guide_m`` and the contact bend [m].
    guide_m, half_width_m
        It is under the tip only within this distance from this position of the guide [m].
    rolls
        A pull moves its shape but not its material at the contact: it rolls on the fingertip.
    drive_stiffness_n_m
        Stiffness of what pulls it [N/m].
    weakening_m, healing_s
        Way of sliding over which friction turns kinetic [m], time over which it recovers [s].
    inertia
        The finger has inertia: it rings where a plate glides under it.
    """

    finger: Finger
    rig: Rig
    body: Body | None
    friction: float
    kinetic_friction: float
    surface: Surface | None
    lead_m: float
    guide_m: float
    half_width_m: float
    rolls: bool = False
    drive_stiffness_n_m: float = math.inf
    weakening_m: float = math.inf
    healing_s: float = 1.0
    inertia: bool = False

    @cached_property
    def constants(self) -> Constants:
        """Constants that all trials share, for the solvers."""
        f = self.finger
        drive = 0.0 if self.rolls else 1 / self.drive_stiffness_n_m
        softening = self.body.softening_m if self.body else 0.0
        return Constants(
            length=f.length_m,
            arm=f.moment_arm_m,
            tendon_stiffness=f.tendon_stiffness_n_m,
            tendon_friction=f.tendon_friction,
            presliding_rad=f.tendon_presliding_m / f.moment_arm_m,
            per_presliding=f.moment_arm_m / f.tendon_presliding_m,
            stiffness=f.bending_stiffness_nm_rad,
            creep_stiffness=f.creep_stiffness_nm_rad,
            damping=f.damping_nm_s_rad,
            mass=f.mass_kg,
            tip_mass=f.tip_mass_kg,
            stop_rad=math.radians(f.bend_stop_deg),
            stop_stiffness=f.stop_stiffness_nm_rad,
            tip_stiffness=f.tip_stiffness_n_m,
            tip_damping=f.tip_damping_n_s_m,
            # The pull works through the drive's spring and the tip's shear in series.
            shear_stiffness=1 / (1 / f.tip_shear_stiffness_n_m + drive),
            per_shear_stiffness=1 / f.tip_shear_stiffness_n_m + drive,
            friction_loss=1 - self.kinetic_friction,
            per_weakening=1 / self.weakening_m,
            inverse_softening=1 / softening if softening > 0 else 0.0,
            crosstalk=self.rig.load_cell.crosstalk,
            masses=self._compute_masses(),
        )

    def _compute_masses(self) -> tuple[float, ...]:
        if not self.inertia:
            return NO_MASSES
        f = self.finger
        bend_rad = math.radians(f.contact_bend_deg)
        return compute_mass_matrix(f.length_m, f.mass_kg, f.tip_mass_kg, bend_rad)

    @cached_property
    def parameters(self) -> tuple[Any, ...]:
        """Constants, springs of the object, surface, its grid, and whether anything yields."""
        springs = [0.0] * (1 + at.MAX_BRANCHES)
        if self.body:
            springs[0] = self.body.stiffness_n_m
            for i, branch in enumerate(self.body.branches):
                springs[1 + i] = branch.stiffness_n_m
        table: FloatArray = _NO_SURFACE
        grid = (0.0, 1.0, 0.0)
        if self.surface is not None:
            table = self.surface.table
            # The last cell's end belongs to it.
            last = math.nextafter(float(len(table)), 0.0)
            grid = (self.surface.origin_m, 1 / self.surface.spacing_m, last)
        return self.constants, tuple(springs), table, grid, self.body is not None

    @cached_property
    def _rest_coefficients(self) -> FloatArray:
        return self.compute_coefficients(_REST_STEPS_S)

    def compute_coefficients(self, steps_s: tuple[float, ...]) -> FloatArray:
        """Coefficients of steps of these lengths; see `steps.compute_coefficients`."""
        branches = self.body.branches if self.body else ()
        return compute_coefficients(
            steps_s,
            self.finger.creep_time_s,
            [branch.relaxation_time_s for branch in branches],
            1 / (2 * math.pi * self.rig.load_cell.low_pass_hz),
            self.healing_s,
        )

    def compute_inputs(
        self, tendon_m: FloatArray, guide_m: FloatArray, pulled_m: FloatArray | float = 0.0
    ) -> FloatArray:
        """Inputs of steps, shape (steps, INPUTS), from where the axes are at their ends [m]."""
        inputs = np.zeros((len(tendon_m), at.INPUTS))
        inputs[:, at.TENDON_INPUT] = tendon_m
        inputs[:, at.GUIDE_INPUT] = guide_m
        inputs[:, at.SHAPE_INPUT if self.rolls else at.MATERIAL_INPUT] = pulled_m
        inputs[:, at.PRESENT_INPUT] = np.abs(guide_m - self.guide_m) <= self.half_width_m
        return inputs

    def start_trials(
        self,
        solver: str,
        variation: Variation,
        inputs: FloatArray,
        state: FloatArray | None = None,
    ) -> FloatArray:
        """Put trials at rest, with nothing sticking.

        Parameters
        ----------
        inputs : ndarray of float, shape (INPUTS,)
        state
            Of another scene, whose finger is to come to rest in this one.

        Returns
        -------
        ndarray of float, shape (TRIAL_ROWS, trials)

        Raises
        ------
        ConvergenceError
            There is no rest.
        """
        count = len(variation.phase)
        fresh = np.zeros((at.TRIAL_ROWS, count))
        fresh[at.MODES] = _FIRST_BEND_RAD
        if state is not None:
            for rows in (at.MODES, at.CREEP):
                fresh[rows : rows + 3] = state[rows : rows + 3]
        bend_rad = math.radians(self.finger.contact_bend_deg)
        length_m = self.finger.length_m
        drop_m = length_m * (1 - math.cos(bend_rad)) / bend_rad
        reach_m = length_m * math.sin(bend_rad) / bend_rad
        fresh[at.CLEARANCE] = drop_m - variation.contact_height_m
        scale = variation.glide_speed
        # A guide that moves too far does so from where it meets the plate.
        fresh[at.OFFSET] = (
            self.lead_m - reach_m - self.guide_m + variation.placement_m
        ) + self.guide_m * (1 - scale)
        fresh[at.SCALE] = scale
        fresh[at.TENDON_ZERO] = -variation.tendon_zero_m
        fresh[at.FRICTION] = self.friction * variation.friction
        fresh[at.FINGER_FACTOR] = variation.finger_stiffness
        fresh[at.OBJECT_FACTOR] = variation.object_stiffness
        failed = np.full(count, -1, dtype=np.int64)
        steps = np.arange(len(_REST_STEPS_S))
        advance_trials(
            solver,
            fresh,
            (self.constants._replace(masses=NO_MASSES), *self.parameters[1:]),  # it rests
            steps,
            inputs,
            np.tile(inputs, (len(steps), 1)),
            self._rest_coefficients,
            (),
            failed,
            grip=0.0,
        )
        if (failed >= 0).any():
            raise ConvergenceError(
                f'the finger of trial {int(np.argmax(failed >= 0))} finds no rest at the start; '
                'check its description and what lies under it'
            )
        return fresh


@lru_cache
def build_scene(
    protocol: str, object_label: str, contact: str, catalogue: Catalogue | None = None
) -> Scene:
    """Compose the scene of a trial.

    Raises
    ------
    DescriptionError
        No such protocol, object or contact.
    """
    catalogue = catalogue or default_catalogue()
    finger, rig = catalogue.finger(contact), catalogue.rig()
    place = rig.placement
    if protocol == 'texture':
        plate = catalogue.plate(object_label)
        surface = build_plate_surface(plate, finger.tip_radius_m, place.tray_depth_m)
        return Scene(
            finger,
            rig,
            None,
            plate.friction,
            1.0,
            surface,
            place.texture_lead_m,
            place.texture_guide_m,
            math.inf,
            inertia=True,
        )
    if protocol == 'stiffness':
        body = catalogue.body(object_label)
        there = body.stiffness_n_m > 0
        return Scene(
            finger,
            rig,
            body if there else None,
            body.friction,
            1.0,
            None,
            0.0,
            place.object_guide_m,
            place.object_half_width_m if there else -1.0,  # nothing is under no place
        )
    if protocol == 'slip':
        held = catalogue.held_object(object_label)
        rolls = held.motion == 'roll'
        crown = build_crown_surface(held.radius_m, finger.tip_radius_m) if rolls else None
        return Scene(
            finger,
            rig,
            held.body,
            held.body.friction,
            held.kinetic_friction,
            crown,
            0.0,
            place.object_guide_m,
            place.object_half_width_m,
            rolls,
            held.drive_stiffness_n_m,
            held.weakening_m,
            held.healing_s,
        )
    raise DescriptionError(
        f"protocol is {protocol!r}; it must be 'texture', 'stiffness' or 'slip'"
    )
