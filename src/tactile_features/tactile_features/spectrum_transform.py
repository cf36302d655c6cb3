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

"""A real Fourier transform across windows: the same operations for one window as for many.

A window of n real samples is taken as n / 2 complex ones, transformed in stages of radix 5,
4, 3 and 2 (Stockham's order, which needs no permutation), and untangled. All of it is
elementary arithmetic on rows, in which each window has a place of its own; so a window's
bits depend neither on its neighbours nor on who runs the operations, NumPy here or the
compiled loops of `compiled_spectrum`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MAX_STAGES = 6
_MAX_SAMPLES = 4096
_MIN_SAMPLES = 8

_SIN_60 = 0.8660254037844386
_COS_72, _SIN_72 = 0.30901699437494745, 0.9510565162951535
_COS_144, _SIN_144 = -0.8090169943749475, 0.5877852522924731


@dataclass(frozen=True)
class Stage:
    """One stage: ``spacing`` transforms of ``radix`` beside each other, ``groups`` times.

    Attributes
    ----------
    twiddles : ndarray of shape (groups, radix - 1, 2)
        Cosine and sine of the turns after it.
    """

    radix: int
    groups: int
    spacing: int
    twiddles: FloatArray


@dataclass(frozen=True)
class Plan:
    """The stages for windows of one length, and the turns that untangle the result.

    Attributes
    ----------
    turns : ndarray of shape (n // 4 + 1, 2)
        Cosine and sine.
    """

    sample_count: int
    stages: tuple[Stage, ...]
    turns: FloatArray


@lru_cache(maxsize=32)
def make_plan(sample_count: int) -> Plan | None:
    """Return the plan for windows of a length, or None where it is not one of ours.

    Ours are 2 to the power of a, times 3 to that of b, times 5 to that of c, with a of at
    least 1, from 8 to 4096 samples.
    """
    if sample_count % 2 or not _MIN_SAMPLES <= sample_count <= _MAX_SAMPLES:
        return None
    stages = []
    left, spacing = sample_count // 2, 1
    for radix in (5, 4, 3, 2):
        while left % radix == 0:
            groups = left // radix
            turns = np.outer(np.arange(groups), np.arange(1, radix)) % left
            stages.append(Stage(radix, groups, spacing, _turn(turns, left)))
            left, spacing = groups, spacing * radix
    if left > 1 or len(stages) > MAX_STAGES:
        return None
    turns = np.arange(sample_count // 4 + 1)
    return Plan(sample_count, tuple(stages), _turn(turns, sample_count))


def _turn(steps: NDArray[np.int_], whole: int) -> FloatArray:
    angle = 2.0 * np.pi / whole * steps
    return np.stack([np.cos(angle), -np.sin(angle)], axis=-1)


def transform(plan: Plan, tension_n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return amplitudes and the energy of windows; not finite where squares overflow.

    Parameters
    ----------
    tension_n : ndarray of shape (windows, n)

    Returns
    -------
    amplitudes : ndarray of shape (windows, n // 2 + 1)
    energy : ndarray of shape (windows,)
        Sum of the squares of twice the transform; 0 for a constant window, and too small
        to be trusted where squares vanish.
    """
    count, half = len(tension_n), plan.sample_count // 2
    rows = np.ascontiguousarray(tension_n.T).reshape(half, 2, count)
    z = np.ascontiguousarray(rows.transpose(1, 0, 2))
    z -= z[0, 0].copy()
    z -= _find_mean(z)
    for stage in plan.stages:
        z = _run_stage(stage, z.reshape(2, stage.radix, stage.groups, -1))
    power = _untangle(plan, z.reshape(2, half, count))
    return (np.sqrt(power) * (1.0 / plan.sample_count)).T, power.sum(axis=0)


def _find_mean(z: FloatArray) -> FloatArray:
    """Return the mean of each window, added in halves.

    It may be a little off: a constant has no component but the one at 0 Hz.
    """
    total = z[0] + z[1]
    while len(total) > 1:
        middle = (len(total) + 1) // 2
        total[: len(total) - middle] += total[middle:]
        total = total[:middle]
    return np.asarray(total[0] / (2 * z.shape[1]))


def _run_stage(stage: Stage, z: FloatArray) -> FloatArray:
    inputs = [z[part, j] for j in range(stage.radix) for part in range(2)]
    outputs = BUTTERFLIES[stage.radix](*inputs)
    out = np.empty((2, stage.groups, stage.radix, z.shape[-1]))
    for k in range(stage.radix):
        real, imaginary = outputs[2 * k], outputs[2 * k + 1]
        if k > 0 and stage.groups > 1:
            cosine, sine = stage.twiddles[:, k - 1, :1], stage.twiddles[:, k - 1, 1:]
            real, imaginary = turn(real, imaginary, cosine, sine)
        out[0, :, k], out[1, :, k] = real, imaginary
    return out


def _untangle(plan: Plan, z: FloatArray) -> FloatArray:
    """Return the squares of twice the transform, shape (n // 2 + 1, windows)."""
    half = plan.sample_count // 2
    power = np.empty((half + 1, z.shape[-1]))
    power[0] = 0.0
    power[half] = square_nyquist(z[0, 0], z[1, 0])
    top = half // 2
    near, far = z[:, 1 : top + 1], z[:, half - top :][:, ::-1]
    turns = plan.turns[1 : top + 1]
    low, high = square_pair(near[0], near[1], far[0], far[1], turns[:, :1], turns[:, 1:])
    # The middle comes as its own mirror; then the lower of both stands.
    power[half - top : half] = high[::-1]
    power[1 : top + 1] = low
    return power


# What follows works on numbers and on arrays alike.


def turn(real: Any, imaginary: Any, cosine: Any, sine: Any) -> Any:
    """Return a complex number times another."""
    return real * cosine - imaginary * sine, real * sine + imaginary * cosine


def square_nyquist(real: Any, imaginary: Any) -> Any:
    """Return the square of the last component, whose amplitude is not doubled."""
    return (real - imaginary) * (real - imaginary)


def square_pair(ar: Any, ai: Any, br: Any, bi: Any, cosine: Any, sine: Any) -> Any:
    """Return the squares of twice components k and n / 2 - k, from both of the half transform."""
    even_r, even_i = ar + br, ai - bi
    sr, si = ai + bi, br - ar
    odd_r, odd_i = sr * cosine - si * sine, sr * sine + si * cosine
    low_r, low_i = even_r + odd_r, even_i + odd_i
    high_r, high_i = even_r - odd_r, even_i - odd_i
    return low_r * low_r + low_i * low_i, high_r * high_r + high_i * high_i


def combine_two(ar: Any, ai: Any, br: Any, bi: Any) -> Any:
    """Return the transform of two numbers."""
    return ar + br, ai + bi, ar - br, ai - bi


def combine_three(ar: Any, ai: Any, br: Any, bi: Any, cr: Any, ci: Any) -> Any:
    """Return the transform of three numbers."""
    sr, si = br + cr, bi + ci
    ur, ui = ar - 0.5 * sr, ai - 0.5 * si
    vr, vi = _SIN_60 * (bi - ci), _SIN_60 * (cr - br)
    return ar + sr, ai + si, ur + vr, ui + vi, ur - vr, ui - vi


def combine_four(ar: Any, ai: Any, br: Any, bi: Any, cr: Any, ci: Any, dr: Any, di: Any) -> Any:
    """Return the transform of four numbers."""
    er, ei, fr, fi = ar + cr, ai + ci, ar - cr, ai - ci
    gr, gi, hr, hi = br + dr, bi + di, bi - di, dr - br
    return er + gr, ei + gi, fr + hr, fi + hi, er - gr, ei - gi, fr - hr, fi - hi


def combine_five(
    ar: Any,
    ai: Any,
    br: Any,
    bi: Any,
    cr: Any,
    ci: Any,
    dr: Any,
    di: Any,
    er: Any,
    ei: Any,
) -> Any:
    """Return the transform of five numbers."""
    pr, pi, qr, qi = br + er, bi + ei, cr + dr, ci + di
    sr, si, tr, ti = br - er, bi - ei, cr - dr, ci - di
    ur, ui = ar + _COS_72 * pr + _COS_144 * qr, ai + _COS_72 * pi + _COS_144 * qi
    vr, vi = ar + _COS_144 * pr + _COS_72 * qr, ai + _COS_144 * pi + _COS_72 * qi
    wr, wi = _SIN_72 * sr + _SIN_144 * tr, _SIN_72 * si + _SIN_144 * ti
    xr, xi = _SIN_144 * sr - _SIN_72 * tr, _SIN_144 * si - _SIN_72 * ti
    return (
        ar + pr + qr,
        ai + pi + qi,
        ur + wi,
        ui - wr,
        vr + xi,
        vi - xr,
        vr - xi,
        vi + xr,
        ur - wi,
        ui + wr,
    )


BUTTERFLIES: dict[int, Callable[..., Any]] = {
    2: combine_two,
    3: combine_three,
    4: combine_four,
    5: combine_five,
}
