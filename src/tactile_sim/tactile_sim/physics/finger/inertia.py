# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The inertia of the finger in its three modes."""

from __future__ import annotations

import math

import numpy as np


def compute_mass_matrix(
    length_m: float, mass_kg: float, tip_mass_kg: float, bend_rad: float
) -> tuple[float, ...]:
    """Mass matrix of the modes of a finger bent to an arc [kg m^2].

    M_ij = mass * integral of r_i . r_j along the finger + tip mass * r_i . r_j at the tip,
    where r_i is the derivative of the place on the line by mode i.

    Returns
    -------
    tuple of 6
        In the order 00, 01, 02, 11, 12, 22.
    """
    points, weights = np.polynomial.legendre.leggauss(12)
    nodes = [(float(p + 1) / 2, float(w) / 2) for p, w in zip(points, weights, strict=True)]
    sums = [0.0] * 6
    for xi, share in [*((xi, mass_kg * weight) for xi, weight in nodes), (1.0, tip_mass_kg)]:
        moved = [[0.0, 0.0] for _ in range(3)]
        for part, weight in nodes:
            s = xi * part
            step_m = length_m * xi * weight
            sine, cosine = math.sin(bend_rad * s), math.cos(bend_rad * s)
            for place, slope in zip(moved, (s, s * s - s, 2 * s**3 - 3 * s * s + s), strict=True):
                place[0] -= step_m * slope * sine
                place[1] += step_m * slope * cosine
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        for k, (i, j) in enumerate(pairs):
            sums[k] += share * (moved[i][0] * moved[j][0] + moved[i][1] * moved[j][1])
    return tuple(sums)
