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

"""The transform of `spectrum_transform`, compiled for windows of one length.

Sixteen windows go side by side. Their rows stand in one array at places that the compiler
knows, so that it proves them independent and takes whole vectors; that is why each length
is compiled for itself. Contraction to fused operations stays off: the bits are NumPy's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
import math
from typing import Any

from numba import njit
import numpy as np
from numpy.typing import NDArray

from tactile_features import spectrum_transform
from tactile_features.spectrum_transform import MAX_STAGES, Plan

FloatArray = NDArray[np.float64]

_LANES = 16
_POSITIVE = 2**62 - 1
_OPTIONS: Any = {'error_model': 'numpy', 'boundscheck': False, 'fastmath': False}

_inline = njit(forceinline=True, **_OPTIONS)
_turn = _inline(spectrum_transform.turn)
_square_nyquist = _inline(spectrum_transform.square_nyquist)
_square_pair = _inline(spectrum_transform.square_pair)
_two = _inline(spectrum_transform.combine_two)
_three = _inline(spectrum_transform.combine_three)
_four = _inline(spectrum_transform.combine_four)
_five = _inline(spectrum_transform.combine_five)


def compile_transform(plan: Plan) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Return `spectrum_transform.transform` for windows of the plan's length, compiled."""
    shape = [(stage.radix, stage.groups, stage.spacing) for stage in plan.stages]
    shape += [(0, 0, 0)] * (MAX_STAGES - len(shape))
    run = _compile(plan.sample_count, len(plan.stages), tuple(shape))
    tables = [np.append(stage.twiddles.ravel(), 0.0) for stage in plan.stages]
    tables += [np.zeros(1)] * (MAX_STAGES - len(tables))
    turns = plan.turns.ravel()

    def transform(tension_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        amplitudes = np.empty((len(tension_n), plan.sample_count // 2 + 1))
        energy = np.empty(len(tension_n))
        run(tension_n, amplitudes, energy, turns, *tables)
        return amplitudes, energy

    transform(np.zeros((1, plan.sample_count)))
    return transform


@cache
def _compile(n: int, count: int, shape: tuple[tuple[int, int, int], ...]) -> Callable[..., None]:
    (r0, g0, s0), (r1, g1, s1), (r2, g2, s2), (r3, g3, s3), (r4, g4, s4), (r5, g5, s5) = shape
    half, top = n // 2, n // 4
    # Real parts, then imaginary ones; the stages go to and fro between two such halves.
    part = half * _LANES
    one, other = 0, 2 * part
    done, power = (one, other) if count % 2 == 0 else (other, one)
    # Squares of the components k, then of those n / 2 - k, for k from 0 to top.
    high = power + (top + 1) * _LANES
    mirror = 4 * part
    centre = 6 * part
    scale = 1.0 / n

    def run(
        tension: Any,
        out: Any,
        energy: Any,
        turns: Any,
        w0: Any,
        w1: Any,
        w2: Any,
        w3: Any,
        w4: Any,
        w5: Any,
    ) -> None:
        z = np.zeros(centre + _LANES)
        for begin in range(0, len(tension), _LANES):
            lanes = min(_LANES, len(tension) - begin)
            for t in range(lanes):
                first = tension[begin + t, 0]
                for j in range(half):
                    z[j * _LANES + t] = tension[begin + t, 2 * j] - first
                    z[part + j * _LANES + t] = tension[begin + t, 2 * j + 1] - first
            _find_centre(z, half, part, other, centre)
            _stage(z, w0, r0, g0, s0, one, other, part, centre)
            if r1:
                _stage(z, w1, r1, g1, s1, other, one, part, -1)
            if r2:
                _stage(z, w2, r2, g2, s2, one, other, part, -1)
            if r3:
                _stage(z, w3, r3, g3, s3, other, one, part, -1)
            if r4:
                _stage(z, w4, r4, g4, s4, one, other, part, -1)
            if r5:
                _stage(z, w5, r5, g5, s5, other, one, part, -1)
            _mirror(z, half, top, part, done, mirror)
            _untangle(z, turns, top, part, done, mirror, power, high, centre)
            for t in range(lanes):
                energy[begin + t] = z[centre + t]
            for q in range((2 * top + 2) * _LANES):
                z[power + q] = math.sqrt(z[power + q]) * scale
            for t in range(lanes):
                for k in range(top + 1):
                    out[begin + t, k] = z[power + k * _LANES + t]
                for k in range(half - top):
                    out[begin + t, half - k] = z[high + k * _LANES + t]

    compiled: Callable[..., None] = njit(cache=True, **_OPTIONS)(run)
    return compiled


@_inline
def _find_centre(z: Any, half: Any, part: Any, spare: Any, centre: Any) -> None:
    for q in range(half * _LANES):
        z[spare + q] = z[q] + z[part + q]
    rows = half
    while rows > 1:
        middle = (rows + 1) // 2
        # The mask tells the compiler that the place is not negative.
        upper = (spare + middle * _LANES) & _POSITIVE
        for q in range((rows - middle) * _LANES):
            z[spare + q] += z[upper + q]
        rows = middle
    for q in range(_LANES):
        z[centre + q] = z[spare + q] / (2 * half)


@_inline
def _stage(
    z: Any,
    table: Any,
    radix: Any,
    groups: Any,
    spacing: Any,
    source: Any,
    target: Any,
    part: Any,
    centre: Any,
) -> None:
    """Run one stage; all but the arrays are known to the compiler, so one branch remains."""
    width = spacing * _LANES
    if radix == 5:
        _stage_five(z, table, groups, width, source, target, part, centre)
    elif radix == 4:
        _stage_four(z, table, groups, width, source, target, part, centre)
    elif radix == 3:
        _stage_three(z, table, groups, width, source, target, part, centre)
    else:
        _stage_two(z, table, groups, width, source, target, part, centre)


@_inline
def _stage_two(
    z: Any, table: Any, groups: Any, width: Any, source: Any, target: Any, part: Any, centre: Any
) -> None:
    step = groups * width
    for p in range(groups):
        w = 2 * p
        c1, s1 = table[w + 0], table[w + 1]
        for q in range(width):
            i = source + p * width + q
            o = target + 2 * p * width + q
            m = z[centre + q] if centre >= 0 else 0.0
            ar, ai = z[i] - m, z[i + part] - m
            br, bi = z[i + step] - m, z[i + step + part] - m
            ar, ai, br, bi = _two(ar, ai, br, bi)
            if groups > 1:
                br, bi = _turn(br, bi, c1, s1)
            z[o], z[o + part] = ar, ai
            z[o + width], z[o + width + part] = br, bi


@_inline
def _stage_three(
    z: Any, table: Any, groups: Any, width: Any, source: Any, target: Any, part: Any, centre: Any
) -> None:
    step = groups * width
    for p in range(groups):
        w = 4 * p
        c1, s1 = table[w + 0], table[w + 1]
        c2, s2 = table[w + 2], table[w + 3]
        for q in range(width):
            i = source + p * width + q
            o = target + 3 * p * width + q
            m = z[centre + q] if centre >= 0 else 0.0
            ar, ai = z[i] - m, z[i + part] - m
            br, bi = z[i + step] - m, z[i + step + part] - m
            cr, ci = z[i + 2 * step] - m, z[i + 2 * step + part] - m
            ar, ai, br, bi, cr, ci = _three(ar, ai, br, bi, cr, ci)
            if groups > 1:
                br, bi = _turn(br, bi, c1, s1)
                cr, ci = _turn(cr, ci, c2, s2)
            z[o], z[o + part] = ar, ai
            z[o + width], z[o + width + part] = br, bi
            z[o + 2 * width], z[o + 2 * width + part] = cr, ci


@_inline
def _stage_four(
    z: Any, table: Any, groups: Any, width: Any, source: Any, target: Any, part: Any, centre: Any
) -> None:
    step = groups * width
    for p in range(groups):
        w = 6 * p
        c1, s1 = table[w + 0], table[w + 1]
        c2, s2 = table[w + 2], table[w + 3]
        c3, s3 = table[w + 4], table[w + 5]
        for q in range(width):
            i = source + p * width + q
            o = target + 4 * p * width + q
            m = z[centre + q] if centre >= 0 else 0.0
            ar, ai = z[i] - m, z[i + part] - m
            br, bi = z[i + step] - m, z[i + step + part] - m
            cr, ci = z[i + 2 * step] - m, z[i + 2 * step + part] - m
            dr, di = z[i + 3 * step] - m, z[i + 3 * step + part] - m
            ar, ai, br, bi, cr, ci, dr, di = _four(ar, ai, br, bi, cr, ci, dr, di)
            if groups > 1:
                br, bi = _turn(br, bi, c1, s1)
                cr, ci = _turn(cr, ci, c2, s2)
                dr, di = _turn(dr, di, c3, s3)
            z[o], z[o + part] = ar, ai
            z[o + width], z[o + width + part] = br, bi
            z[o + 2 * width], z[o + 2 * width + part] = cr, ci
            z[o + 3 * width], z[o + 3 * width + part] = dr, di


@_inline
def _stage_five(
    z: Any, table: Any, groups: Any, width: Any, source: Any, target: Any, part: Any, centre: Any
) -> None:
    step = groups * width
    for p in range(groups):
        w = 8 * p
        c1, s1 = table[w + 0], table[w + 1]
        c2, s2 = table[w + 2], table[w + 3]
        c3, s3 = table[w + 4], table[w + 5]
        c4, s4 = table[w + 6], table[w + 7]
        for q in range(width):
            i = source + p * width + q
            o = target + 5 * p * width + q
            m = z[centre + q] if centre >= 0 else 0.0
            ar, ai = z[i] - m, z[i + part] - m
            br, bi = z[i + step] - m, z[i + step + part] - m
            cr, ci = z[i + 2 * step] - m, z[i + 2 * step + part] - m
            dr, di = z[i + 3 * step] - m, z[i + 3 * step + part] - m
            er, ei = z[i + 4 * step] - m, z[i + 4 * step + part] - m
            ar, ai, br, bi, cr, ci, dr, di, er, ei = _five(ar, ai, br, bi, cr, ci, dr, di, er, ei)
            if groups > 1:
                br, bi = _turn(br, bi, c1, s1)
                cr, ci = _turn(cr, ci, c2, s2)
                dr, di = _turn(dr, di, c3, s3)
                er, ei = _turn(er, ei, c4, s4)
            z[o], z[o + part] = ar, ai
            z[o + width], z[o + width + part] = br, bi
            z[o + 2 * width], z[o + 2 * width + part] = cr, ci
            z[o + 3 * width], z[o + 3 * width + part] = dr, di
            z[o + 4 * width], z[o + 4 * width + part] = er, ei


@_inline
def _mirror(z: Any, half: Any, top: Any, part: Any, done: Any, mirror: Any) -> None:
    """Copy the rows half - k to the rows k of a place that the compiler knows."""
    for k in range(1, top + 1):
        for q in range(_LANES // 4):
            i = done + (half - k) * _LANES + 4 * q
            o = mirror + k * _LANES + 4 * q
            # All are read before one is written, so that they go as vectors.
            ar, br, cr, dr = z[i], z[i + 1], z[i + 2], z[i + 3]
            i += part
            ai, bi, ci, di = z[i], z[i + 1], z[i + 2], z[i + 3]
            z[o], z[o + 1], z[o + 2], z[o + 3] = ar, br, cr, dr
            o += part
            z[o], z[o + 1], z[o + 2], z[o + 3] = ai, bi, ci, di


@_inline
def _untangle(
    z: Any,
    turns: Any,
    top: Any,
    part: Any,
    done: Any,
    mirror: Any,
    power: Any,
    high: Any,
    centre: Any,
) -> None:
    for q in range(_LANES):
        z[power + q] = 0.0
        z[high + q] = _square_nyquist(z[done + q], z[done + part + q])
        z[centre + q] = z[high + q]
    for k in range(1, top + 1):
        cosine, sine = turns[2 * k], turns[2 * k + 1]
        for q in range(_LANES):
            i = done + k * _LANES + q
            j = mirror + k * _LANES + q
            low_square, high_square = _square_pair(
                z[i], z[i + part], z[j], z[j + part], cosine, sine
            )
            z[power + k * _LANES + q] = low_square
            z[high + k * _LANES + q] = high_square
            z[centre + q] += low_square + high_square
