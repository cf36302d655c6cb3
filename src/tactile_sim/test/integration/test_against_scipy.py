# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compare the simulation with a solution of the same equations by SciPy's stiff solver.

The reference uses the constants, the surface and the motions of the package. It differs from
the package in the following methods:

- Integrals along the finger have 16 nodes instead of 4, and are differentiated by complex steps.
- Friction along the tendon's path (capstan equation) is integrated instead of expanded in a
  series.
- Creep of the finger, relaxation of the object and damping of the fingertip are differential
  equations instead of exact solutions and finite differences.
- Dry friction is a slider that creeps quickly under any force beyond its limit, instead of a
  return map.
- Time steps are adaptive (Radau).
"""

from typing import NamedTuple

import numpy as np
import pytest
from scenery import run
from scipy.integrate import solve_ivp

from tactile_sim.physics import layout as at
from tactile_sim.physics.equations import GRAVITY_M_S2
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.variation import Variation

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)
XI, WEIGHT = (_POINTS + 1) / 2, _WEIGHTS / 2
SHAPES = np.stack([XI, XI**2 - XI, 2 * XI**3 - 3 * XI**2 + XI])
LEGENDRE = np.stack([np.ones_like(XI), 2 * XI - 1, 6 * XI**2 - 6 * XI + 1])
SHARE = 1 / np.array([1.0, 3.0, 5.0])
STEPS = 1e-30j * np.eye(3)
# Viscosities of the friction sliders, which creep under a force beyond the friction limit. With
# ten times these values, the differences in the tests below double.
TIP_VISCOSITY_N_S_M, TENDON_VISCOSITY_S = 1e-5, 1e-7


class Forces(NamedTuple):
    rates: np.ndarray
    tension_n: float
    normal_n: float


class Reference:
    """The equations of the finger as a system of ordinary differential equations.

    The variables are the modes q (3), the creep of the modes (3), the slider of the tip, the
    slider of the tendon, the compression of the tip, the relaxing branches of the object and, in
    a scene with inertia, the velocities of the modes (3).
    """

    def __init__(self, scene, state, tendon_m, guide_m):
        self.scene, self.c = scene, scene.constants
        self.clearance = state[at.CLEARANCE]
        self.offset, self.friction = state[at.OFFSET], state[at.FRICTION]
        self.tendon_m, self.guide_m = tendon_m, guide_m
        # Distances along the guide are measured from this position, because the solver's tolerance
        # is relative.
        self.started_m = state[at.TIP_SLIDER]
        branches = scene.body.branches if scene.body else ()
        self.branch_n_m = np.array([b.stiffness_n_m for b in branches])
        self.branch_s = np.array([b.relaxation_time_s for b in branches])
        self.mass = self._weigh(np.radians(scene.finger.contact_bend_deg))

    def _weigh(self, bend_rad):
        """Return the mass matrix of a finger that is bent to a circular arc.

        It is a sum over 2000 points, whose positions are differentiated by complex steps.
        """
        xi = (np.arange(2000) + 0.5) / 2000
        shapes = np.stack([xi, xi**2 - xi, 2 * xi**3 - 3 * xi**2 + xi])
        angle = (np.array([bend_rad, 0.0, 0.0]) + STEPS) @ shapes
        parts = np.stack([np.cos(angle), np.sin(angle)]) * self.c.length / 2000
        places = (np.cumsum(parts, axis=2) - parts / 2).imag / 1e-30
        tip = parts.sum(axis=2).imag / 1e-30
        along = np.einsum('cik,cjk->ij', places, places) * self.c.mass / 2000
        return along + self.c.tip_mass * np.einsum('ci,cj->ij', tip, tip)

    def start(self, state):
        sliders = state[[at.TIP_SLIDER, at.TENDON_SLIDER, at.SQUEEZED]]
        branches = state[at.BRANCHES : at.BRANCHES + len(self.branch_n_m)]
        sliders[0] -= self.started_m
        swing = np.zeros(3 if self.scene.inertia else 0)
        return np.concatenate([state[at.MODES : at.MODES + 6], sliders, branches, swing])

    def evaluate(self, time_s, y):
        c, q, creep = self.c, y[:3], y[3:6]
        tip_slider, tendon_slider, squeezed = y[6:9]
        relaxed = y[9 : 9 + len(self.branch_n_m)]
        velocity = y[9 + len(self.branch_n_m) :]
        swinging = velocity[:0]
        # Row i of an array is evaluated with a tiny imaginary step in mode i. The real parts are
        # the values, and the imaginary parts are the derivatives with respect to the modes.
        angle = (q + STEPS) @ SHAPES
        drop = c.length * np.sin(angle) @ WEIGHT
        reach = c.length * np.cos(angle) @ WEIGHT
        beyond = c.mass * (1 - XI) + c.tip_mass
        work = GRAVITY_M_S2 * c.length * np.sin(angle) @ (WEIGHT * beyond)
        z_i, x_i = drop.imag / 1e-30, reach.imag / 1e-30
        place = self.offset + self.guide_m(time_s) + reach.real[0]
        height = incline = rise = 0.0
        if (surface := self.scene.surface) is not None:
            height, incline, _ = (float(v[0]) for v in surface.sample(place[None]))
            # `sample` returns a slope that is rounded at corners. ``rise`` is the exact slope of
            # the height within a cell of the table.
            cell = int((place - surface.origin_m) / surface.spacing_m)
            rise = surface.table[cell, 1] / surface.spacing_m
        indentation = drop.real[0] - self.clearance + height
        stretch = self.tendon_m(time_s) - c.arm * q[0]
        tension = c.tendon_stiffness * max(stretch, 0.0)
        ahead = (q[0] - tendon_slider) / c.presliding_rad
        loss = np.exp(-c.tendon_friction * q[0] * ahead * XI)
        shear = c.shear_stiffness * (place - self.started_m - tip_slider)
        normal_i, along_i = z_i + incline * x_i, x_i - incline * z_i
        moments = (
            SHARE * (-c.stiffness * q - c.creep_stiffness * (q - creep))
            + work.imag / 1e-30
            + c.arm * tension * (LEGENDRE * loss) @ WEIGHT
            - shear * along_i
        )
        damping = np.diag(c.damping * SHARE)
        if self.scene.body is None:
            # On a rigid plate, the whole indentation compresses the tip. The damper of the tip
            # therefore acts directly on the modes.
            nearing_i = z_i + rise * x_i
            drift = rise * (self.guide_m(time_s + 1e-6) - self.guide_m(time_s - 1e-6)) / 2e-6
            spring = c.tip_stiffness * indentation + c.tip_damping * drift
            damping = damping + c.tip_damping * np.outer(normal_i, nearing_i)
            rates = np.linalg.solve(damping, moments - spring * normal_i)
            if self.scene.inertia:
                rates = velocity
                left = moments - spring * normal_i - damping @ velocity
                swinging = np.linalg.solve(self.mass, left)
            squeezing = float(nearing_i @ rates) + drift
            force = spring + c.tip_damping * float(nearing_i @ rates)
            relaxing = relaxed
        else:
            material = self.scene.body.stiffness_n_m + self.branch_n_m.sum()
            rest = float(self.branch_n_m @ relaxed)
            yielded = max(indentation - squeezed, 0.0)
            pressed = 2 * yielded / (1 + np.sqrt(1 + 2 * c.inverse_softening * yielded))
            force = max(material * pressed - rest, 0.0)
            pressed = pressed if force > 0.0 else rest / material
            squeezing = (force - c.tip_stiffness * squeezed) / c.tip_damping
            rates = np.linalg.solve(damping, moments - force * normal_i)
            relaxing = (pressed - relaxed) / self.branch_s
        limit = self.friction * max(force, 0.0)
        beyond_n = shear - min(max(shear, -limit), limit)
        over = (ahead - min(max(ahead, -1.0), 1.0)) * c.presliding_rad
        creeping = (q - creep) / self.scene.finger.creep_time_s
        sliding = [beyond_n / TIP_VISCOSITY_N_S_M, over / TENDON_VISCOSITY_S, squeezing]
        whole = np.concatenate([rates, creeping, sliding, relaxing, swinging])
        return Forces(whole, tension, force)

    def solve(self, state, times_s, tolerance):
        scale = np.full(len(self.start(state)), 1e-9)
        solution = solve_ivp(
            lambda t, y: self.evaluate(t, y).rates,
            (0.0, times_s[-1]),
            self.start(state),
            method='Radau',
            t_eval=times_s,
            rtol=tolerance,
            atol=scale * 1e-3,
            max_step=2e-3,
        )
        assert solution.success, solution.message
        rows = [self.evaluate(t, y) for t, y in zip(solution.t, solution.y.T, strict=True)]
        assert min(r.normal_n for r in rows) > 0.0, 'it knows no loss of contact'
        return np.array([(r.tension_n, r.normal_n) for r in rows]).T


def compare(scene, tendon_m, guide_m, duration_s, step_s, tolerance):
    """Return the differences of tension and normal force, relative to their standard deviation."""
    steps = round(duration_s / step_s)
    times_s = step_s * np.arange(steps + 1)
    result = run(scene, step_s, tendon_m(times_s), guide_m(times_s), tolerance_nm=1e-10)
    assert result.failed.tolist() == [-1]
    zero = np.zeros(1)
    inputs = scene.compute_inputs(tendon_m(zero), guide_m(zero))[0]
    state = scene.start_trials(Variation.none(), inputs)[:, 0]
    every = steps // 100
    reference = Reference(scene, state, tendon_m, guide_m)
    exact = reference.solve(state, times_s[::every], tolerance)[:, 1:]
    mine = result.rows[[at.TENSION, at.FORCE], 0, ::every][:, 1:]
    return np.abs(mine - exact) / exact.std(axis=1, keepdims=True)


def smooth(times_s, duration_s):
    """Return values that rise from 0 to 1 in ``duration_s`` with continuous acceleration."""
    part = np.clip(times_s / duration_s, 0.0, 1.0)
    return part**3 * (10 - 15 * part + 6 * part**2)


def test_gliding_over_a_groove():
    duration_s = 0.1
    difference = compare(
        build_scene('texture', 'R3', 'flexion'),
        lambda t: 0.0052 + 0.0 * t,
        lambda t: 0.0655 + 0.003 * smooth(t, duration_s),
        duration_s,
        1e-5,
        1e-6,
    )
    assert np.median(difference, axis=1).max() < 1e-4
    assert np.quantile(difference, 0.9, axis=1).max() < 3e-4
    # In the middle of the groove, the contact changes from one edge to the other. The path of the
    # tip has a corner there, so the differences are large for half a millisecond.
    assert difference.max() < 5e-3


@pytest.mark.parametrize('label', ['rubber_shell', 'sponge'])
def test_pressing_on_an_object(label):
    duration_s = 0.3
    difference = compare(
        build_scene('stiffness', label, 'flexion'),
        lambda t: 0.0047 + 0.0004 * smooth(t, 0.15) - 0.0003 * smooth(t - 0.2, 0.1),
        lambda t: 0.060 + 0.0 * t,
        duration_s,
        2e-5,
        1e-9,
    )
    assert difference.max() < 1e-4
