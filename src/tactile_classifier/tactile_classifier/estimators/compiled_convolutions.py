# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loops of random convolutions, compiled by numba. `convolutions` contains the NumPy version.

The result of each addition is rounded to single precision. Additions must not be reordered, and
must not be combined with multiplications to fused operations.
"""

from __future__ import annotations

from typing import Any

from numba import njit
import numpy as np

from tactile_classifier.estimators.convolutions import ADDED, KERNELS, TAPS

_OPTIONS: Any = {
    'cache': True,
    'nogil': True,
    'error_model': 'numpy',
    'boundscheck': False,
    'fastmath': False,
}


@njit(**_OPTIONS)
def _shift(x: Any, dilation: Any, common: Any, extra: Any) -> None:
    """Compute the terms from which `_add` computes the sums of all kernels.

    The signal ``x`` has shape (channels, samples). The results are written to ``common`` and
    ``extra``. ``common``, shape (channels, samples), is the convolution with nine weights of -1.
    ``extra``, shape (channels, 9, samples), is three times the sample at each weight; adding it
    changes this weight from -1 to 2. The signal is zero beyond its ends. All arrays are float32.
    """
    channels, samples = x.shape
    extra[:] = 0.0
    for channel in range(channels):
        for tap in range(TAPS):
            by = (tap - TAPS // 2) * dilation
            for t in range(max(0, -by), min(samples, samples - by)):
                extra[channel, tap, t] = x[channel, t + by]
        for t in range(samples):
            common[channel, t] = -x[channel, t]
        for tap in ADDED:
            for t in range(samples):
                common[channel, t] -= extra[channel, tap, t]
        for tap in range(TAPS):
            for t in range(samples):
                extra[channel, tap, t] *= np.float32(3)


@njit(**_OPTIONS)
def _add(common: Any, extra: Any, source: Any, kernel: Any, fitting: Any, sums: Any) -> None:
    """Compute the sums of one kernel over its channels, shape (samples,)."""
    a, b, c = kernel[0], kernel[1], kernel[2]
    sums[:] = 0.0
    for channel in source:
        if channel < 0:
            break
        base, one, two, three = (
            common[channel],
            extra[channel, a],
            extra[channel, b],
            extra[channel, c],
        )
        if fitting:
            for t in range(len(sums)):
                sums[t] += base[t] + ((one[t] + two[t]) + three[t])
        else:
            for t in range(len(sums)):
                sums[t] += ((base[t] + one[t]) + two[t]) + three[t]


@njit(**_OPTIONS)
def add_chosen(x: Any, rows: Any, dilation: Any, sources: Any, sums: Any) -> None:
    """Apply each kernel to the signal chosen for it; write to ``sums``, shape (kernels, samples).

    The signals ``x`` have shape (trials, channels, samples), float32. For each kernel, ``rows``
    contains the index of its signal, and ``sources`` its channels.
    """
    channels, samples = x.shape[1:]
    common = np.empty((channels, samples), dtype=np.float32)
    extra = np.empty((channels, TAPS, samples), dtype=np.float32)
    for i in range(len(KERNELS)):
        _shift(x[rows[i]], dilation, common, extra)
        _add(common, extra, sources[i], KERNELS[i], True, sums[i])


@njit(**_OPTIONS)
def count_above(
    x: Any, dilation: Any, parity: Any, biases: Any, sources: Any, shares: Any
) -> None:
    """Compute the fraction of samples above each bias; write it to ``shares``.

    ``shares`` has shape (trials, kernels, biases). Kernels whose index modulo two equals
    ``parity`` use all samples. The other kernels use only samples at which the whole kernel is
    inside the signal. See `add_chosen` for the other arguments.
    """
    channels, samples = x.shape[1:]
    edge = (TAPS // 2) * dilation
    common = np.empty((channels, samples), dtype=np.float32)
    extra = np.empty((channels, TAPS, samples), dtype=np.float32)
    sums = np.empty(samples, dtype=np.float32)
    for trial in range(len(x)):
        _shift(x[trial], dilation, common, extra)
        for i in range(len(KERNELS)):
            _add(common, extra, sources[i], KERNELS[i], False, sums)
            cut = 0 if i % 2 == parity else edge
            used = sums[cut : samples - cut]
            for j in range(biases.shape[1]):
                bias = biases[i, j]
                count = np.uint32(0)
                for t in range(len(used)):
                    # Without the conversion, the sum has 64 bits and takes twice as long.
                    count = np.uint32(count + np.uint32(used[t] > bias))
                shares[trial, i, j] = count / len(used)
