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

"""The sliding sums, compiled: the same operations in the same order as in `sliding`.

Bins go in groups of known width that stand in one array, so that the compiler proves them
independent and takes them side by side. Nothing is contracted to fused operations.
"""

from __future__ import annotations

import math
from typing import Any, TYPE_CHECKING

from numba import njit
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tactile_features.sliding import SlidingKernel, SlidingState

FloatArray = NDArray[np.float64]

# Wide enough that the loops are not unrolled, which would keep them from the vector registers.
_WIDTH = 96
_SUMS = 4 * _WIDTH
_POSITIVE = 2**62 - 1


def slide(
    kernel: SlidingKernel, state: SlidingState, tension: FloatArray, out: FloatArray
) -> None:
    """Take samples: see `tactile_features.sliding`."""
    width, n = kernel.cosine.shape
    for first in range(0, width, _WIDTH):
        some = slice(first, min(first + _WIDTH, width))
        count = some.stop - some.start
        # Per place cosine beside sine; then the four sums, and room for the magnitudes.
        table = np.zeros((n, 2, _WIDTH))
        table[:, 0, :count] = kernel.cosine[some].T
        table[:, 1, :count] = kernel.sine[some].T
        sums = np.zeros((5, _WIDTH))
        sums[:4, :count] = state.sums[some].T
        last = state.last.copy()
        place, anchor = _take(
            tension,
            last,
            table.ravel(),
            sums.ravel(),
            kernel.scale[some],
            state.place,
            state.anchor,
            out[:, some],
        )
        state.sums[some] = sums[:4, :count].T
    state.place, state.anchor, state.last = place, anchor, last


@njit(cache=True, error_model='numpy', boundscheck=False, fastmath=False)
def _take(
    tension: Any,
    last: Any,
    table: Any,
    sums: Any,
    scale: Any,
    place: Any,
    anchor: Any,
    out: Any,
) -> Any:
    n = len(last)
    for t in range(len(tension)):
        if place == 0:
            anchor = tension[t]
        change = tension[t] - last[place]
        fresh = tension[t] - anchor
        last[place] = tension[t]
        row = (place * 2 * _WIDTH) & _POSITIVE
        for q in range(_WIDTH):
            cosine, sine = table[row + q], table[row + _WIDTH + q]
            sums[q] += change * cosine
            sums[_WIDTH + q] += change * sine
            sums[2 * _WIDTH + q] += fresh * cosine
            sums[3 * _WIDTH + q] += fresh * sine
        place += 1
        if place == n:
            place = 0
            for q in range(2 * _WIDTH):
                sums[q] = sums[2 * _WIDTH + q]
                sums[2 * _WIDTH + q] = 0.0
        for q in range(_WIDTH):
            real, imaginary = sums[q], sums[_WIDTH + q]
            sums[_SUMS + q] = math.sqrt(real * real + imaginary * imaginary)
        for q in range(len(scale)):
            out[t, q] = sums[_SUMS + q] * scale[q]
    return place, anchor
