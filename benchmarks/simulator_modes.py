# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The finger's equations once more, with as many curvature modes as asked for.

Written apart from `tactile_sim.physics.finger`, in matrices and one trial at a time,
to tell what three modes leave out and whether both are the same equations. Without tendon friction
and creep.
"""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from tactile_sim.descriptions.description import Finger
from tactile_sim.physics.finger.bent_line import GRAVITY_M_S2
from tactile_sim.physics.surface import Surface

FloatArray = NDArray[np.float64]
Positions = Callable[[FloatArray], FloatArray]

_NODES = 10
_TOLERANCE_NM = 1e-9
_ITERATIONS = 60


class ModeLine:
    """The finger as an elastic line with any number of modes.

    Parameters
    ----------
    finger
        Its tendon friction and creep are not simulated.
    modes
        How many Legendre polynomials make up its curvature.
    """

    def __init__(self, finger: Finger, modes: int) -> None:
        points, weights = legendre.leggauss(_NODES)
        self._finger = finger
        # Slope angle at xi of each mode: the integral of P_i(2 xi - 1) from 0 to xi.
        self._slopes = np.stack(
            [legendre.legval(points, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(modes)]
        )
        self._weights = weights / 2
        beyond = 1 - (points + 1) / 2
        self._loads_n = GRAVITY_M_S2 * (finger.mass_kg * beyond + finger.tip_mass_kg)
        self._shares = 1 / (2 * np.arange(modes) + 1)

    def place_tip(self, bends_rad: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Drop and reach of the tip [m], and their derivatives by the modes, shape (2, modes)."""
        angle = bends_rad @ self._slopes
        sine, cosine = self._weights * np.sin(angle), self._weights * np.cos(angle)
        length_m = self._finger.length_m
        tip_m = length_m * np.array([sine.sum(), cosine.sum()])
        by_modes = length_m * np.stack([self._slopes @ cosine, -(self._slopes @ sine)])
        return tip_m, by_modes, length_m * np.stack([sine, cosine])

    def simulate(
        self,
        surface: Surface,
        clearance_m: float,
        offset_m: float,
        friction: float,
        guide_positions: Positions,
        tendon_positions: Positions,
        times_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Tension and normal force at the ends of the steps, by backward Euler [N].

        Parameters
        ----------
        surface, clearance_m, offset_m, friction
            As in `mujoco_twin.TwinContact`.
        guide_positions, tendon_positions
            Positions [m] at an array of times [s].
        times_s : ndarray of float, shape (steps + 1,)
            Between which the steps lie [s].

        Raises
        ------
        FloatingPointError
            Newton's method found no balance: take shorter steps.
        """
        f = self._finger
        guide_m, tendon_m = guide_positions(times_s), tendon_positions(times_s)
        bends = np.zeros(len(self._shares))
        slider_m, squeezed_m = offset_m + guide_m[0] + f.length_m, 0.0
        tension_n, force_n = np.zeros((2, len(times_s) - 1))
        for step in range(1, len(times_s)):
            rate = 1 / (times_s[step] - times_s[step - 1])
            damper = f.tip_damping_n_s_m * rate
            start = bends.copy()
            for _ in range(_ITERATIONS):
                tip_m, tip_1, parts_m = self.place_tip(bends)
                place_m = offset_m + guide_m[step] + tip_m[1]
                height, incline, bend = (float(v) for v in surface.sample(np.array(place_m)))
                push = (f.tip_stiffness_n_m + damper) * (tip_m[0] - clearance_m + height)
                normal = max(push - damper * squeezed_m, 0.0)
                stiff = f.tip_stiffness_n_m + damper if normal > 0.0 else 0.0
                stuck = f.tip_shear_stiffness_n_m * (place_m - slider_m)
                rub = min(max(stuck, -friction * normal), friction * normal)
                slides = abs(stuck) > friction * normal
                stretch = tendon_m[step] - f.moment_arm_m * bends[0]
                pull = f.tendon_stiffness_n_m * max(stretch, 0.0)
                along, across = tip_1[0] + incline * tip_1[1], tip_1[1] - incline * tip_1[0]
                elastic = self._shares * (f.bending_stiffness_nm_rad + rate * f.damping_nm_s_rad)
                error = elastic * bends - self._shares * rate * f.damping_nm_s_rad * start
                error -= self._slopes @ (self._loads_n * parts_m[1])
                error[0] -= f.moment_arm_m * pull
                error += normal * along + rub * across
                if np.abs(error).max() < _TOLERANCE_NM:
                    break
                of_z, of_x = normal - rub * incline, normal * incline + rub
                curved = parts_m[0] * (self._loads_n - of_z) - parts_m[1] * of_x
                slope = np.diag(elastic) + (self._slopes * curved) @ self._slopes.T
                if stretch > 0.0:
                    slope[0, 0] += f.tendon_stiffness_n_m * f.moment_arm_m**2
                normal_1 = stiff * along
                rub_1 = math.copysign(friction, stuck) * normal_1
                if not slides:
                    rub_1 = f.tip_shear_stiffness_n_m * tip_1[1]
                slope += np.outer(along, normal_1) + np.outer(across, rub_1)
                slope += bend * np.outer(normal * tip_1[1] - rub * tip_1[0], tip_1[1])
                bends = bends - np.linalg.solve(slope, error).clip(-0.2, 0.2)
            else:
                raise FloatingPointError(
                    f'no balance at {times_s[step]:.4f} s; take shorter steps'
                )
            tension_n[step - 1], force_n[step - 1] = pull, normal
            slider_m = place_m - rub / f.tip_shear_stiffness_n_m
            squeezed_m = (normal + damper * squeezed_m) / (f.tip_stiffness_n_m + damper)
        return tension_n, force_n
