# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``texture_spectrum``: the amplitudes of the Fourier components of a window of tension."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import (
    DETRENDS,
    Feature,
    FeatureSet,
    FloatArray,
    WINDOWS,
    WindowSamples,
)
from tactile_features.types import PHASE_GLIDE, SET_TEXTURE_SPECTRUM

_BLOCK_WINDOWS = 128
"""Number of windows that are transformed together, so that they stay in the cache."""


class TextureSpectrum(FeatureSet):
    """Amplitudes over a fixed time of the glide.

    ``spectrum_detrend='mean'`` without a window function gives the features in the paper.
    """

    name = SET_TEXTURE_SPECTRUM
    version = 2
    phase = PHASE_GLIDE
    can_be_early = True
    cut = ('texture_crop_start_s', 'max_gap_samples')
    options = ('spectrum_detrend', 'spectrum_window')
    count_field = 'texture_samples'

    def describe(self, sample_count: int, rate_hz: float) -> tuple[Feature, ...]:
        return tuple(
            Feature(f'tension__spectrum__hz_{k * rate_hz / sample_count:.3f}', 'N')
            for k in range(sample_count // 2 + 1)
        )

    def compute(self, samples: WindowSamples) -> FloatArray:
        config = self.config
        return compute_spectrum(samples.tension_n, config.spectrum_detrend, config.spectrum_window)


def compute_spectrum(
    tension_n: ArrayLike, detrend: str = 'mean', window: str = 'none'
) -> FloatArray:
    """Compute the single-sided amplitudes of the Fourier components.

    Component ``k`` of ``n`` samples is ``2 / n * |X_k|``; at the Nyquist frequency, it is
    ``1 / n * |X_k|``. A sine of amplitude A whose frequency is the centre of bin ``k`` gives A in
    this bin. If there is a window function, its sum replaces ``n``. The component at 0 Hz is set
    to 0, because it contains only the offset of the sensor or rounding errors.

    A single window gives the same bits as the same window in a batch.

    Parameters
    ----------
    tension_n : array_like of shape (..., n)
        Windows of tension [N]; ``n >= 2``.
    detrend : str
        Trend to subtract before the transform, as in `scipy.signal.detrend`: ``none``,
        ``mean``, or ``linear`` for the least-squares line. ``none`` differs from ``mean``
        only with a window function, because the component at 0 Hz is set to 0.
    window : str
        Window function: ``none``, or ``hann`` for the periodic one of
        `scipy.signal.get_window`.

    Returns
    -------
    ndarray of shape (..., n // 2 + 1)
        Amplitudes [N].

    Raises
    ------
    FeatureError
        When there are too few samples, a value is not finite, or an amplitude is too
        large to be represented.
    """
    tension = np.asarray(tension_n, dtype=np.float64)
    n = tension.shape[-1] if tension.ndim else 0
    if n < 2:
        raise FeatureError(
            f'a spectrum needs windows of at least 2 samples; the shape is {tension.shape}'
        )
    if detrend not in DETRENDS or window not in WINDOWS:
        raise FeatureError(
            f'detrend is "{detrend}" and window "{window}"; they must be one of '
            f'{", ".join(DETRENDS)} and of {", ".join(WINDOWS)}'
        )
    rows = np.ascontiguousarray(tension).reshape(-1, n)
    amplitude = np.empty((len(rows), n // 2 + 1))
    # Indices relative to the middle are exact, and their sum of squares is exact up to 2**53.
    index = np.arange(n) - (n - 1) / 2.0
    square = n * (n * n - 1) / 12.0
    weight = np.sin(np.pi * np.arange(n) / n) ** 2 if window == 'hann' else None
    # If there is no window function, the mean affects only the component at 0 Hz.
    is_raw = detrend == 'none' and weight is not None
    with np.errstate(over='ignore', invalid='ignore'):
        for at in range(0, len(rows), _BLOCK_WINDOWS):
            some = rows[at : at + _BLOCK_WINDOWS]
            if is_raw:
                change = some.copy()
            else:
                # With a large offset, differences to the first sample are exact.
                change = some - some[:, :1]
                change -= change.mean(axis=1, keepdims=True)
                # A steep line leaves rounding errors, which the second pass removes.
                for _ in range(2 if detrend == 'linear' else 0):
                    # A matrix product would not have the same order of summation for all batches.
                    slope = np.add.reduce(change * index, axis=1, keepdims=True) / square
                    change -= slope * index
                    change -= change.mean(axis=1, keepdims=True)
            if weight is not None:
                change *= weight
            np.abs(np.fft.rfft(change), out=amplitude[at : at + _BLOCK_WINDOWS])
        amplitude *= 2.0 / (n if weight is None else weight.sum())
    amplitude[:, 0] = 0.0
    if n % 2 == 0:
        amplitude[:, -1] /= 2.0
    if not np.isfinite(amplitude).all():
        if np.isfinite(rows).all():
            raise FeatureError('the tension is too large for its spectrum to be represented')
        raise FeatureError('the tension has values that are not finite')
    return amplitude.reshape(*tension.shape[:-1], n // 2 + 1)
