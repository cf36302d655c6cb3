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

"""The amplitudes of the Fourier components of a window of tension."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError
from tactile_features.spectrum_transform import make_plan, Plan, transform

FloatArray = NDArray[np.float64]


def spectrum_names(sample_count: int, rate_hz: float) -> tuple[str, ...]:
    """Return the names of the components of a window, such as ``tension__spectrum__hz_0.333``."""
    return tuple(
        f'tension__spectrum__hz_{k * rate_hz / sample_count:.3f}'
        for k in range(sample_count // 2 + 1)
    )


# Windows at a time, so that their rows stay in the cache.
_BLOCK_WINDOWS = 128
# Energies between which no square has over- or underflowed.
_LEAST, _MOST = 1e-200, 1e300

# The compiled transforms of this process, by the length of their windows.
_compiled: dict[int, Callable[[FloatArray], tuple[FloatArray, FloatArray]]] = {}


def compute_spectrum(tension_n: ArrayLike) -> FloatArray:
    """Return the single-sided amplitudes of the Fourier components after the mean is removed.

    Component ``k`` of ``n`` samples is ``2 / n * |X_k|``, and ``1 / n * |X_k|`` at the Nyquist
    frequency, so that a sine of amplitude A in the middle of bin ``k`` gives A there.
    The component at 0 Hz of a window without its mean is 0, and is stated as such:
    its rounding noise would carry no information.

    Each window takes the same path whether it comes alone or in a batch, so that
    both give the same bits. Even lengths without a prime factor above 5, from 8 to 4096,
    are transformed many at a time, and faster still after `compile_spectrum`; others go one
    by one through NumPy's transform.

    Parameters
    ----------
    tension_n : array_like of shape (..., n)
        Windows of tension [N], ``n >= 2``.

    Returns
    -------
    ndarray of shape (..., n // 2 + 1)
        Amplitudes [N].

    Raises
    ------
    FeatureError
        When there are fewer than two samples or a value is not finite.
    """
    tension = np.asarray(tension_n, dtype=np.float64)
    if tension.ndim == 0 or tension.shape[-1] < 2:
        raise FeatureError(
            f'a spectrum needs windows of at least 2 samples; the shape is {tension.shape}'
        )
    n = tension.shape[-1]
    rows = np.ascontiguousarray(tension).reshape(-1, n)
    plan = make_plan(n)
    out = _transform_each(rows) if plan is None else _transform_all(plan, rows)
    return out.reshape(*tension.shape[:-1], n // 2 + 1)


def compile_spectrum(sample_count: int) -> None:
    """Let `compute_spectrum` take windows of this length through compiled loops from now on.

    The bits stay the same. It is some ten times as fast on a batch and takes seconds to
    compile the first time on a machine (numba keeps the result), so it pays for
    hundreds of thousands of windows; a node or a data set does not need it.

    Raises
    ------
    FeatureError
        When numba is not installed, or the length is none that goes many at a time.
    """
    plan = make_plan(sample_count)
    if plan is None:
        raise FeatureError(f'windows of {sample_count} samples have no compiled spectrum')
    if find_spec('numba') is None:
        raise FeatureError('a compiled spectrum needs numba: pip install numba')
    if sample_count not in _compiled:
        from tactile_features.compiled_spectrum import compile_transform

        _compiled[sample_count] = compile_transform(plan)


def _transform_all(plan: Plan, rows: FloatArray) -> FloatArray:
    out, energy = _run(plan, rows)
    doubtful = np.flatnonzero(~((energy > _LEAST) & (energy < _MOST)))
    if len(doubtful):
        _check_finite(rows[doubtful])
        # Divided by a power of two, which costs no digit; constants have no components.
        peak = np.abs(rows[doubtful]).max(axis=1)
        exponent = np.frexp(peak)[1][:, None]
        scaled, _ = _run(plan, np.ldexp(rows[doubtful], -exponent))
        with np.errstate(over='ignore', under='ignore'):
            out[doubtful] = np.ldexp(scaled, exponent)
        _check_represented(out[doubtful])
    return out


def _run(plan: Plan, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    if plan.sample_count in _compiled:
        return _compiled[plan.sample_count](rows)
    out, energy = np.empty((len(rows), plan.sample_count // 2 + 1)), np.empty(len(rows))
    with np.errstate(all='ignore'):
        for at in range(0, len(rows), _BLOCK_WINDOWS):
            some = slice(at, at + _BLOCK_WINDOWS)
            out[some], energy[some] = transform(plan, rows[some])
    return out, energy


def _transform_each(rows: FloatArray) -> FloatArray:
    _check_finite(rows)
    out = np.empty((len(rows), rows.shape[1] // 2 + 1))
    for row, amplitude in zip(rows, out, strict=True):
        amplitude[:] = _transform_one(row)
    _check_represented(out)
    return out


def _transform_one(tension_n: FloatArray) -> FloatArray:
    n = len(tension_n)
    # The difference to the first sample is exact under a large offset; the mean of
    # the differences then loses nothing to it.
    with np.errstate(over='ignore', invalid='ignore'):
        change = tension_n - tension_n[0]
        change -= change.mean()
        amplitude: FloatArray = np.abs(np.fft.rfft(change)) * (2.0 / n)
    amplitude[0] = 0.0
    if n % 2 == 0:
        amplitude[-1] /= 2.0
    return amplitude


def _check_finite(rows: FloatArray) -> None:
    if not np.isfinite(rows).all():
        raise FeatureError('the tension holds values that are not finite')


def _check_represented(amplitudes: FloatArray) -> None:
    if not np.isfinite(amplitudes).all():
        raise FeatureError('the tension is too large for its spectrum to be represented')
