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

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import rfft

from tactile_features.errors import FeatureError

FloatArray = NDArray[np.float64]

_BLOCK_WINDOWS = 128
"""Windows at a time, so that they stay in the cache."""


def spectrum_names(sample_count: int, rate_hz: float) -> tuple[str, ...]:
    """Return the names of the components of a window, such as ``tension__spectrum__hz_0.333``."""
    return tuple(
        f'tension__spectrum__hz_{k * rate_hz / sample_count:.3f}'
        for k in range(sample_count // 2 + 1)
    )


def compute_spectrum(tension_n: ArrayLike) -> FloatArray:
    """Return the single-sided amplitudes of the Fourier components after the mean is removed.

    Component ``k`` of ``n`` samples is ``2 / n * |X_k|``, and ``1 / n * |X_k|`` at the Nyquist
    frequency, so that a sine of amplitude A in the middle of bin ``k`` gives A there.
    The component at 0 Hz is set to 0: without the mean it holds rounding errors only.

    A window gives the same bits alone and in a batch.

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
        When there are fewer than two samples, a value is not finite, or an amplitude is too
        large to be represented.
    """
    tension = np.asarray(tension_n, dtype=np.float64)
    if tension.ndim == 0 or tension.shape[-1] < 2:
        raise FeatureError(
            f'a spectrum needs windows of at least 2 samples; the shape is {tension.shape}'
        )
    n = tension.shape[-1]
    rows = np.ascontiguousarray(tension).reshape(-1, n)
    amplitude = np.empty((len(rows), n // 2 + 1))
    with np.errstate(over='ignore', invalid='ignore'):
        for at in range(0, len(rows), _BLOCK_WINDOWS):
            some = slice(at, at + _BLOCK_WINDOWS)
            # Under a large offset the difference to the first sample is exact.
            change = rows[some] - rows[some, :1]
            change -= change.mean(axis=1, keepdims=True)
            np.abs(rfft(change), out=amplitude[some])
        amplitude *= 2.0 / n
    amplitude[:, 0] = 0.0
    if n % 2 == 0:
        amplitude[:, -1] /= 2.0
    if not np.isfinite(amplitude).all():
        if np.isfinite(rows).all():
            raise FeatureError('the tension is too large for its spectrum to be represented')
        raise FeatureError('the tension holds values that are not finite')
    return amplitude.reshape(*tension.shape[:-1], n // 2 + 1)
