# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scene of a trial: a finger, and the plate or object under it.

The fingertip is a circle in the plane of motion. The path of its lowest point over the profile of
a plate is the greyscale dilation of the profile by this circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.descriptions.description import Body, Finger, Plate, Rig
from tactile_sim.errors import ConvergenceError, DescriptionError
from tactile_sim.physics import layout as at
from tactile_sim.physics.equations import compute_mass_matrix, Constants, NO_MASSES
from tactile_sim.physics.solver import advance_trials
from tactile_sim.physics.steps import compute_coefficients
from tactile_sim.physics.variation import Variation

FloatArray = NDArray[np.float64]

SPACING_M = 1e-5

_REST_STEPS_S = (1e-3, 1e-2, 0.1, 1.0, math.inf)
_NO_SURFACE: FloatArray = np.zeros((1, 4))
_FIRST_BEND_RAD = 0.05


@dataclass(frozen=True)
class Surface:
    """A surface, which is defined by its height and slope at the points of a regular grid.

    ``table`` has one row per cell between two points. Its columns are the height at the left end
    of the cell [m], the change of the height across the cell [m], the slope at the left end [1],
    and the change of the slope across the cell [1].
    """

    origin_m: float
    spacing_m: float
    table: FloatArray

    def sample(self, x_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return height [m], slope [1] and curvature [1/m] at coordinates on the surface.

        Outside the grid, the height is constant.
        """
        cell = (x_m - self.origin_m) / self.spacing_m
        index = np.minimum(np.maximum(np.floor(cell), 0), len(self.table) - 1)
        part = np.minimum(np.maximum(cell - index, 0.0), 1.0)
        height, rise, slope, bend = self.table[index.astype(np.intp)].T
        return height + part * rise, slope + part * bend, bend / self.spacing_m


def build_surface(height_m: FloatArray, origin_m: float, spacing_m: float) -> Surface:
    """Return a surface with the heights ``height_m`` at the points of a regular grid."""
    # The slope at the points is computed by central differences, and interpolated linearly between
    # them. Because it is continuous, Newton's method also finds the balance at a corner.
    slope = np.gradient(height_m, spacing_m)
    slope[0] = slope[-1] = 0.0
    table = np.column_stack([height_m[:-1], np.diff(height_m), slope[:-1], np.diff(slope)])
    return Surface(origin_m, spacing_m, np.ascontiguousarray(table))


def compute_plate_profile(plate: Plate, x_m: FloatArray, tray_depth_m: float) -> FloatArray:
    """Return the height of a plate at the positions ``x_m`` along it [m].

    x is 0 at the edge of the plate, and the height is 0 at its top. Beside the plate is the tray,
    which is ``tray_depth_m`` lower than the top.
    """
    height = np.where((x_m >= 0) & (x_m <= plate.length_m), 0.0, -tray_depth_m)
    if plate.groove == 'none':
        return height
    along = x_m - plate.end_mm * 1e-3
    if plate.groove == 'profile':
        points_m = 1e-3 * np.array(plate.points_mm)
        drawn = np.interp(along, points_m[:, 0], points_m[:, 1])
        return np.where((along >= 0) & (along <= plate.grooved_mm * 1e-3), drawn, height)
    width, depth = plate.width_mm * 1e-3, plate.depth_mm * 1e-3
    # In each pitch, the groove is in the middle. An incomplete pitch at the end has no groove.
    pitch = plate.pitch_mm * 1e-3
    count = int(plate.grooved_mm * 1e-3 / pitch + 1e-9)
    off_centre = np.abs(np.mod(along, pitch) - pitch / 2)
    in_groove = (off_centre < width / 2) & (along >= 0) & (along < count * pitch)
    if plate.groove == 'rectangular':
        bottom = np.full_like(x_m, -depth)
    elif plate.groove == 'triangular':
        bottom = -depth * (1 - off_centre / (width / 2))
    else:
        radius = (width**2 / 4 + depth**2) / (2 * depth)
        inside = np.maximum(radius**2 - off_centre**2, 0.0)
        bottom = radius - depth - np.sqrt(inside)
    return np.where(in_groove, bottom, height)


def dilate_by_circle(height_m: FloatArray, spacing_m: float, radius_m: float) -> FloatArray:
    """Return the height of the lowest point of a circle that rests on a profile.

    For the profile h and the radius R, the height at x is the maximum of
    ``h(x + u) + sqrt(R^2 - u^2) - R`` for all u (greyscale dilation). Beyond its ends, the profile
    is continued with a constant height.
    """
    reach = int(radius_m / spacing_m)
    padded = np.pad(height_m, reach, mode='edge')
    dilated = np.full(len(height_m), -np.inf)
    for shift in range(-reach, reach + 1):
        drop = radius_m - np.sqrt(radius_m**2 - (shift * spacing_m) ** 2)
        part = padded[reach + shift : reach + shift + len(height_m)]
        np.maximum(dilated, part - drop, out=dilated)
    return dilated


@lru_cache
def build_plate_surface(plate: Plate, tip_radius_m: float, tray_depth_m: float) -> Surface:
    """Return the path of a fingertip over a plate in its tray, as a `Surface`."""
    margin = 0.02
    points = round((plate.length_m + 2 * margin) / SPACING_M) + 1
    x_m = -margin + SPACING_M * np.arange(points, dtype=np.float64)
    bare = compute_plate_profile(plate, x_m, tray_depth_m)
    return build_surface(dilate_by_circle(bare, SPACING_M, tip_radius_m), -margin, SPACING_M)


@dataclass(frozen=True, eq=False)
class Scene:
    """A finger above a plate (texture trial), above an object (stiffness trial), or above nothing.

    ``body`` is a soft object under the fingertip, or None for a rigid plate. ``surface`` is the
    surface of the plate or object, or None if it is level. The plate or object is under the
    fingertip only while the guide is within ``half_width_m`` of ``guide_m`` [m]. If the guide is
    at ``guide_m`` and the finger has its contact bend, the tip is above the coordinate ``lead_m``
    of the surface [m]. If ``inertia`` is True, the equations include the inertia of the finger,
    which can therefore oscillate.
    """

    finger: Finger
    rig: Rig
    friction: float
    guide_m: float
    half_width_m: float
    body: Body | None = None
    surface: Surface | None = None
    lead_m: float = 0.0
    inertia: bool = False

    @cached_property
    def constants(self) -> Constants:
        """Constants of the equations, which are equal for all trials of the scene."""
        f = self.finger
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
            shear_stiffness=f.tip_shear_stiffness_n_m,
            per_shear_stiffness=1 / f.tip_shear_stiffness_n_m,
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
        """The scene as a tuple for the solver.

        It has the constants, the stiffnesses of the object, the table of the surface, its grid,
        and True if the object is soft.
        """
        springs = [0.0] * (1 + at.MAX_BRANCHES)
        if self.body:
            springs[0] = self.body.stiffness_n_m
            for i, branch in enumerate(self.body.branches):
                springs[1 + i] = branch.stiffness_n_m
        table: FloatArray = _NO_SURFACE
        grid = (0.0, 1.0, 0.0)
        if self.surface is not None:
            table = self.surface.table
            # Largest coordinate on the grid. It is slightly smaller than the number of cells, so
            # that it belongs to the last cell.
            last = math.nextafter(float(len(table)), 0.0)
            grid = (self.surface.origin_m, 1 / self.surface.spacing_m, last)
        return self.constants, tuple(springs), table, grid, self.body is not None

    @cached_property
    def _rest_coefficients(self) -> FloatArray:
        return self.compute_coefficients(_REST_STEPS_S)

    def compute_coefficients(self, steps_s: tuple[float, ...]) -> FloatArray:
        """Return the coefficients for time steps of these lengths [s].

        `steps.compute_coefficients` describes the result.
        """
        branches = self.body.branches if self.body else ()
        return compute_coefficients(
            steps_s,
            self.finger.creep_time_s,
            [branch.relaxation_time_s for branch in branches],
            1 / (2 * math.pi * self.rig.load_cell.low_pass_hz),
        )

    def compute_inputs(self, tendon_m: FloatArray, guide_m: FloatArray) -> FloatArray:
        """Return the inputs of the solver for time steps, shape (steps, INPUTS).

        ``tendon_m`` and ``guide_m`` are the positions of the axes at the end of each step [m].
        """
        inputs = np.zeros((len(tendon_m), at.INPUTS))
        inputs[:, at.TENDON_INPUT] = tendon_m
        inputs[:, at.GUIDE_INPUT] = guide_m
        inputs[:, at.PRESENT_INPUT] = np.abs(guide_m - self.guide_m) <= self.half_width_m
        return inputs

    def start_trials(
        self,
        variation: Variation,
        inputs: FloatArray,
        state: FloatArray | None = None,
    ) -> FloatArray:
        """Return the initial states of trials at rest, shape (TRIAL_ROWS, trials).

        The state of rest is computed without friction. ``inputs`` has the shape (INPUTS,). If
        ``state`` is passed, the search for rest begins with the bend of the finger in this state
        of another scene.
        Raises `ConvergenceError` when there is no state of rest.
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
        # The scale of the guide's motion varies between trials. It has no effect at ``guide_m``.
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
            fresh,
            # Masses have no effect at rest.
            (self.constants._replace(masses=NO_MASSES), *self.parameters[1:]),
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
                f'the finger of trial {int(np.argmax(failed >= 0))} has no state of rest; '
                'check its description and the plate or object under it'
            )
        return fresh


@lru_cache
def build_scene(
    protocol: str, object_label: str, contact: str, catalogue: Catalogue | None = None
) -> Scene:
    """Return the scene of a trial.

    Raises `DescriptionError` for an unknown protocol, object or contact.
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
            plate.friction,
            place.texture_guide_m,
            math.inf,
            surface=surface,
            lead_m=place.texture_lead_m,
            inertia=True,
        )
    here = place.object_guide_m, place.object_half_width_m
    if protocol == 'stiffness':
        body = catalogue.body(object_label)
        if body.stiffness_n_m == 0:  # there is no object at any position of the guide
            return Scene(finger, rig, body.friction, place.object_guide_m, -1.0)
        return Scene(finger, rig, body.friction, *here, body)
    raise DescriptionError(f"protocol is {protocol!r}; it must be 'texture' or 'stiffness'")
