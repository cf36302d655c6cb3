# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The amplitudes of the Fourier components of a window of tension."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError


def spectrum_names(sample_count: int, rate_hz: float) -> tuple[str, ...]:
    """Return the names of the components of a window, such as ``tension__spectrum__hz_0.333``."""
    return tuple(
        f'tension__spectrum__hz_{k * rate_hz / sample_count:.3f}'
        for k in range(sample_count // 2 + 1)
    )


def compute_spectrum(tension_n: ArrayLike) -> NDArray[np.float64]:
    """Return the single-sided amplitudes of the Fourier components after the mean is removed.

    Component ``k`` of ``n`` samples is ``2 / n * |X_k|``, and ``1 / n * |X_k|`` at the Nyquist
    frequency, so that a sine of amplitude A in the middle of bin ``k`` gives A there.
    The component at 0 Hz of a window without its mean is 0, and is stated as such:
    its rounding noise would carry no information.

    Each window takes the same path whether it comes alone or in a batch, so that
    both give the same bits.

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
    if not np.isfinite(tension).all():
        raise FeatureError('the tension holds values that are not finite')
    n = tension.shape[-1]
    rows = tension.reshape(-1, n)
    out = np.empty((len(rows), n // 2 + 1))
    for row, amplitude in zip(rows, out, strict=True):
        amplitude[:] = _compute_one(np.ascontiguousarray(row))
    if not np.isfinite(out).all():
        raise FeatureError('the tension is too large for its spectrum to be represented')
    return out.reshape(*tension.shape[:-1], n // 2 + 1)


def _compute_one(tension_n: NDArray[np.float64]) -> NDArray[np.float64]:
    n = len(tension_n)
    # The difference to the first sample is exact under a large offset; the mean of
    # the differences then loses nothing to it.
    with np.errstate(over='ignore', invalid='ignore'):
        change = tension_n - tension_n[0]
        change -= change.mean()
        amplitude: NDArray[np.float64] = np.abs(np.fft.rfft(change)) * (2.0 / n)
    amplitude[0] = 0.0
    if n % 2 == 0:
        amplitude[-1] /= 2.0
    return amplitude
