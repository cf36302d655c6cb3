# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The finger's shape, for pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def compute_curve(length_m: float, modes_rad: FloatArray, points: int = 65) -> FloatArray:
    """The finger's centre line.

    Parameters
    ----------
    modes_rad : ndarray of float, shape (3,)
        q0, q1, q2 [rad].

    Returns
    -------
    ndarray of float, shape (points, 2)
        Reach and drop from the base to the tip [m].
    """
    fine = np.linspace(0.0, 1.0, 8 * (points - 1) + 1)
    q0, q1, q2 = modes_rad
    middle = (fine[1:] + fine[:-1]) / 2
    slope = q0 * middle + q1 * (middle**2 - middle)
    slope += q2 * (2 * middle**3 - 3 * middle**2 + middle)
    steps = np.stack([np.cos(slope), np.sin(slope)], axis=1) * length_m / len(middle)
    curve = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.asarray(curve[::8], dtype=np.float64)
