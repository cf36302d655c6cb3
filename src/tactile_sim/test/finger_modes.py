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

"""Curvature modes and fine quadrature, by which the finger's equations are checked."""

import numpy as np

FINE_XI, FINE_WEIGHT = (np.longdouble(v) for v in np.polynomial.legendre.leggauss(64))
FINE_XI, FINE_WEIGHT = (FINE_XI + 1) / 2, FINE_WEIGHT / 2
MASS, TIP_MASS = 0.02, 0.007


def shapes(xi):
    return np.stack([xi, xi**2 - xi, 2 * xi**3 - 3 * xi**2 + xi])
