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

"""``texture_spectrum``: the amplitudes of the Fourier components of a window of tension."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import rfft

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import (
    Feature,
    FeatureSet,
    FloatArray,
    WindowSamples,
)
from tactile_features.records import PHASE_GLIDE, SET_TEXTURE_SPECTRUM

_BLOCK_WINDOWS = 128
"""Windows at a time, so that they stay in the cache."""


class TextureSpectrum(FeatureSet):
    """Amplitudes over a fixed time of the glide: those of the paper."""

    name = SET_TEXTURE_SPECTRUM
    version = 2
    phase = PHASE_GLIDE
    has_parts = True
    cut = ('texture_crop_start_s', 'max_gap_samples')
    count_field = 'texture_samples'

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        return tuple(Feature(name, 'N') for name in spectrum_names(sample_count, rate_hz))

    def compute(self, samples: WindowSamples) -> FloatArray:
        return compute_spectrum(samples.tension_n)

    def compute_part(self, samples: WindowSamples, sample_count: int) -> FloatArray:
        return compute_running_spectrum(samples.tension_n, sample_count)


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


def compute_running_spectrum(tension_n: ArrayLike, sample_count: int) -> FloatArray:
    """Return the amplitudes of part of a window at the frequencies of the whole one.

    The mean of the samples is removed and the rest of the window filled with zeros, so
    that component ``k`` means the same frequency as in `compute_spectrum` of
    ``sample_count`` samples. Amplitudes are scaled by the samples that are there:
    ``2 / n * |X_k|``, and ``1 / n * |X_k|`` at the Nyquist frequency. A sine of
    amplitude A whose periods fill the ``n`` samples gives A at its own frequency, and
    leaks to frequencies in between, the more the shorter the part is.

    Parameters
    ----------
    tension_n : array_like of shape (..., n)
        Tension [N], ``2 <= n <= sample_count``.
    sample_count : int
        Samples in the whole window.

    Returns
    -------
    ndarray of shape (..., sample_count // 2 + 1)
        Amplitudes [N].

    Raises
    ------
    FeatureError
        When the number of samples does not fit or a value is not finite.
    """
    tension = np.asarray(tension_n, dtype=np.float64)
    n = tension.shape[-1] if tension.ndim else 0
    if not 2 <= n <= sample_count:
        raise FeatureError(
            f'part of a window of {sample_count} samples must have 2 to {sample_count} samples; '
            f'the shape is {tension.shape}'
        )
    if not np.isfinite(tension).all():
        raise FeatureError('the tension holds values that are not finite')
    rows = tension.reshape(-1, n)
    out = np.empty((len(rows), sample_count // 2 + 1))
    # Row by row, so that a window gives the same bits alone and in a batch.
    for row, amplitude in zip(rows, out, strict=True):
        with np.errstate(over='ignore', invalid='ignore'):
            change = row - row[0]  # exact under a large offset, see compute_spectrum
            change -= change.mean()
            amplitude[:] = np.abs(np.fft.rfft(change, sample_count)) * (2.0 / n)
    out[:, 0] = 0.0
    if sample_count % 2 == 0:
        out[:, -1] /= 2.0
    if not np.isfinite(out).all():
        raise FeatureError('the tension is too large for its spectrum to be represented')
    return out.reshape(*tension.shape[:-1], sample_count // 2 + 1)
