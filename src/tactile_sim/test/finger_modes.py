# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Curvature modes and fine quadrature, by which the finger's equations are checked."""

import numpy as np

FINE_XI, FINE_WEIGHT = (np.longdouble(v) for v in np.polynomial.legendre.leggauss(64))
FINE_XI, FINE_WEIGHT = (FINE_XI + 1) / 2, FINE_WEIGHT / 2
MASS, TIP_MASS = 0.02, 0.007


def shapes(xi):
    return np.stack([xi, xi**2 - xi, 2 * xi**3 - 3 * xi**2 + xi])
