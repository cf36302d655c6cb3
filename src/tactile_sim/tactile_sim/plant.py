# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Finger, tendon and contact as one degree of freedom, for many trials at once.

The finger is an arc of constant curvature with total bend angle q, clamped level; gravity
and the contact pull on it by virtual work. Every step is implicit (backward Euler) and its
residual rises with q, so Newton's method inside a bracket finds the one solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_sim.description import Body, Finger, Rig
from tactile_sim.errors import ConvergenceError
from tactile_sim.surface import Surface

FloatArray = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
TOLERANCE_NM = 1e-9
MAX_ITERATIONS = 200
_NEWTON_ALONE = 6
_SETTLING_S = 1e12
_LOWEST_RAD, _HIGHEST_RAD = -1.0, 3.0
_TINY_RAD = 1e-3  # below it, series instead of quotients that cancel


@dataclass(frozen=True)
class Variation:
    """How each trial differs from the description; arrays of shape (trials,)."""

    contact_height_m: FloatArray
    placement_m: FloatArray
    friction: FloatArray
    stiffness: FloatArray
    phase: FloatArray

    @classmethod
    def none(cls, count: int = 1) -> Variation:
        """Trials exactly as described."""
        return cls(
            np.zeros(count), np.zeros(count), np.ones(count), np.ones(count), np.zeros(count)
        )


@dataclass(frozen=True)
class Mount:
    """What lies under the finger.

    Attributes
    ----------
    body
        Its material.
    surface
        What the fingertip feels of its shape; None for a level top.
    lead_m
        Coordinate on the surface under the tip at ``guide_m`` and the contact bend [m].
    guide_m
        Guide position at which the tip is over it [m].
    half_width_m
        It is under the tip only within this distance from ``guide_m`` [m].
    """

    body: Body
    surface: Surface | None
    lead_m: float
    guide_m: float
    half_width_m: float


def compute_tip(length_m: float, bend_rad: FloatArray) -> tuple[FloatArray, ...]:
    """Drop and reach of the tip of a constant-curvature arc, with two derivatives.

    Returns
    -------
    tuple of ndarray
        z, z', z'', x, x', x'' for z = L (1 - cos q) / q and x = L sin q / q [m, m/rad, m/rad^2].
    """
    tiny = np.abs(bend_rad) < _TINY_RAD
    some_tiny = tiny.any()
    q = np.where(tiny, _TINY_RAD, bend_rad) if some_tiny else bend_rad
    sine, cosine = length_m * np.sin(q), length_m * np.cos(q)
    z, x = (length_m - cosine) / q, sine / q
    dz, dx = (sine - z) / q, (cosine - x) / q
    ddz, ddx = (cosine - 2 * dz) / q, -(sine + 2 * dx) / q
    if some_tiny:
        q, ell = bend_rad, length_m
        z = np.where(tiny, ell * q * (1 / 2 - q * q / 24), z)
        dz = np.where(tiny, ell * (1 / 2 - q * q / 8), dz)
        ddz = np.where(tiny, -ell * q / 4, ddz)
        x = np.where(tiny, ell * (1 - q * q / 6), x)
        dx = np.where(tiny, -ell * q / 3, dx)
        ddx = np.where(tiny, -ell / 3, ddx)
    return z, dz, ddz, x, dx, ddx


def compute_gravity_moment(
    finger: Finger, bend_rad: FloatArray, tip: tuple[FloatArray, ...]
) -> FloatArray:
    """Moment of the weight on the bend angle [N m], given `compute_tip`'s answer.

    The arc's mean drop is (L - x) / q; its derivative is (-x' - (L - x) / q) / q.
    """
    _, dz, _, x, dx, _ = tip
    tiny = np.abs(bend_rad) < _TINY_RAD
    some_tiny = tiny.any()
    q = np.where(tiny, _TINY_RAD, bend_rad) if some_tiny else bend_rad
    mean_slope = ((x - finger.length_m) / q - dx) / q
    if some_tiny:
        series = finger.length_m * (1 / 6 - bend_rad * bend_rad / 40)
        mean_slope = np.where(tiny, series, mean_slope)
    moment: FloatArray = finger.mass_kg * mean_slope + finger.tip_mass_kg * dz
    return GRAVITY_M_S2 * moment


class Plant:
    """State of a batch of trials, moved on by ``step``.

    Parameters
    ----------
    finger, rig, mount
        The description.
    variation
        Per trial; its arrays give the batch its shape (trials,).
    guide_m, tendon_m
        Where guide and tendon are at the start; the finger starts in equilibrium [m].

    Attributes
    ----------
    bend_rad, tension_n, contact_force_n : ndarray of float, shape (trials,)
        Bend angle q, tension at the sensor, and normal force at the fingertip.
    """

    def __init__(
        self,
        finger: Finger,
        rig: Rig,
        mount: Mount,
        variation: Variation,
        guide_m: FloatArray | float,
        tendon_m: FloatArray | float,
    ) -> None:
        count = len(variation.placement_m)
        self._finger, self._rig = finger, rig
        self.bend_rad: FloatArray = np.full(count, 0.05)
        self.tension_n: FloatArray = np.zeros(count)
        self.contact_force_n: FloatArray = np.zeros(count)
        self._creep_rad: FloatArray = np.zeros(count)
        self._last_bend_rad: FloatArray = self.bend_rad
        self.exchange(mount, variation, guide_m, tendon_m)

    def exchange(
        self,
        mount: Mount,
        variation: Variation,
        guide_m: FloatArray | float,
        tendon_m: FloatArray | float,
        finger: Finger | None = None,
    ) -> None:
        """Put something else under the finger; all comes to rest where it is."""
        self._finger = finger or self._finger
        self._mount = mount
        z, _, _, x, _, _ = compute_tip(
            self._finger.length_m, np.array([np.radians(self._finger.contact_bend_deg)])
        )
        self._clearance_m = z[0] - variation.contact_height_m
        self._offset_m = mount.lead_m - mount.guide_m - x[0] + variation.placement_m
        self._friction: FloatArray = mount.body.friction * variation.friction
        self._stiffness = mount.body.stiffness_n_m * variation.stiffness
        self._branch_stiffness = mount.body.branch_stiffness_n_m * variation.stiffness
        count = len(variation.placement_m)
        self._indent_m: FloatArray = np.zeros(count)
        self._place_m: FloatArray = self._offset_m + guide_m + x[0]
        self._last_bend_rad = self.bend_rad
        self.step(guide_m, tendon_m, _SETTLING_S)

    def step(
        self, guide_m: FloatArray | float, tendon_m: FloatArray | float, step_s: float
    ) -> None:
        """Move on by one step, at whose end guide and tendon are where they are told.

        Raises
        ------
        ConvergenceError
            No equilibrium was found; the state is not to be used any more.
        """
        self._prepare(guide_m, tendon_m, step_s)
        q, (_, _, tension, force, place, compressed) = self._solve()
        self._last_bend_rad = self.bend_rad
        creep = step_s / self._finger.creep_time_s
        self._creep_rad = (self._creep_rad + creep * q) / (1 + creep)
        relax = step_s / self._mount.body.relaxation_time_s
        surface_m = np.maximum(self._rest_m + compressed, 0.0)
        self._indent_m = (self._indent_m + relax * surface_m) / (1 + relax)
        self.bend_rad, self.tension_n, self.contact_force_n = q, tension, force
        self._place_m = place

    def _prepare(
        self, guide_m: FloatArray | float, tendon_m: FloatArray | float, step_s: float
    ) -> None:
        finger, rig, mount = self._finger, self._rig, self._mount
        self._step_s, self._tendon_m = step_s, tendon_m
        self._guide_offset_m = self._offset_m + guide_m
        creep = finger.creep_stiffness_nm_rad / (1 + step_s / finger.creep_time_s)
        self._bending = finger.bending_stiffness_nm_rad + creep
        self._creep_moment = creep * self._creep_rad
        # Object and fingertip in series: N = k max(0, indentation - rest).
        branch = self._branch_stiffness / (1 + step_s / mount.body.relaxation_time_s)
        material = self._stiffness + branch
        series = finger.tip_stiffness_n_m * material / (finger.tip_stiffness_n_m + material)
        # An object that is not under the tip feels no force, and goes on relaxing.
        present = np.abs(guide_m - mount.guide_m) <= mount.half_width_m
        self._contact_n_m = np.where(present, series, 0.0)
        self._rest_m = branch * self._indent_m / np.maximum(material, 1e-9)
        self._share = np.where(present, 1 - series / finger.tip_stiffness_n_m, 0.0)
        self._wrap = finger.tendon_friction * np.maximum(self.bend_rad, 0.0)
        self._stop_rad = np.radians(finger.bend_stop_deg)
        self._tendon_rate = finger.moment_arm_m / (step_s * rig.tendon_friction_speed_m_s)
        self._slide_rate = 1 / (step_s * rig.friction_speed_m_s)

    def _evaluate(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """Residual moment, its slope, tension, contact force, place, compression of the object."""
        finger, arm = self._finger, self._finger.moment_arm_m
        tip = compute_tip(finger.length_m, q)
        z, dz, ddz, x, dx, ddx = tip
        tension = finger.tendon_stiffness_n_m * np.maximum(self._tendon_m - arm * q, 0.0)
        drag = np.tanh(self._tendon_rate * (q - self.bend_rad))
        pulling = tension * np.exp(-self._wrap * drag)
        damping = finger.damping_nm_s_rad / self._step_s
        stop = finger.stop_stiffness_nm_rad * np.maximum(q - self._stop_rad, 0.0)
        residual = (
            damping * (q - self.bend_rad)
            + self._bending * q
            - self._creep_moment
            + stop
            - compute_gravity_moment(finger, q, tip)
            - arm * pulling
        )
        slope = (
            damping
            + self._bending
            + np.where(stop > 0.0, finger.stop_stiffness_nm_rad, 0.0)
            + np.where(tension > 0.0, finger.tendon_stiffness_n_m * arm * arm, 0.0)
            + arm * pulling * self._wrap * (1 - drag * drag) * self._tendon_rate
        )
        place = self._guide_offset_m + x
        indentation = z - self._clearance_m - self._rest_m
        gain, dgain = dz, ddz
        if self._mount.surface is not None:
            height, incline, curve = self._mount.surface.sample(place)
            indentation = indentation + height
            gain = dz + incline * dx
            dgain = ddz + incline * ddx + curve * dx * dx
        force = self._contact_n_m * np.maximum(indentation, 0.0)
        touching = force > 0.0
        if touching.any():
            rub = np.tanh(self._slide_rate * (place - self._place_m))
            lever = gain + self._friction * rub * dx
            stick = self._friction * (1 - rub * rub) * self._slide_rate * dx * dx
            residual = residual + force * lever
            slope = slope + np.where(touching, self._contact_n_m * gain * lever, 0.0)
            slope = slope + force * (dgain + self._friction * rub * ddx + stick)
        return residual, slope, tension, force, place, np.maximum(indentation, 0.0) * self._share

    def _solve(self) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        q = 2 * self.bend_rad - self._last_bend_rad
        q = np.minimum(np.maximum(q, _LOWEST_RAD), _HIGHEST_RAD)
        low, high = np.full_like(q, _LOWEST_RAD), np.full_like(q, _HIGHEST_RAD)
        for iteration in range(MAX_ITERATIONS):
            evaluation = self._evaluate(q)
            residual, slope = evaluation[:2]
            # A trial that has converged stays put, whatever the rest of the batch needs.
            open_ = ~(np.abs(residual) <= TOLERANCE_NM)
            if not open_.any():
                return q, evaluation
            low = np.where(residual < 0.0, q, low)
            high = np.where(residual > 0.0, q, high)
            trial, middle = q - residual / slope, (low + high) / 2
            inside = (trial > low) & (trial < high)
            # Friction is steep at rest and flat beyond: there Newton's method alone may creep.
            if iteration >= _NEWTON_ALONE and iteration % 2:
                trial = middle
            q = np.where(open_, np.where(inside, trial, middle), q)
        raise ConvergenceError(
            f'no equilibrium of the finger within {MAX_ITERATIONS} iterations: residual '
            f'{residual[open_][0]:.3g} N m in trial {int(np.argmax(open_))}'
        )
