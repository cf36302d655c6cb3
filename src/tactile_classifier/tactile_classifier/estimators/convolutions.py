# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random convolutions of a signal, the features of MiniRocket, in NumPy.

Dempster, Schmidt and Webb (2021), "MiniRocket", KDD, doi:10.1145/3447548.3467231. There are 84
kernels. Each has nine weights; three weights are 2, and six are -1. Each kernel is applied to the
signal at several dilations. A feature is the fraction of samples at which the result exceeds a
bias. The weights of a kernel add up to zero. The level of a signal therefore affects the result
only at its ends, where the kernel extends beyond the signal and uses zeros.

Convolutions are computed in single precision, with additions in the same order as in the library
aeon: rounding can change the number of samples above a bias.
`compiled_convolutions` performs the same additions with numba, with identical results.
"""

from __future__ import annotations

import dataclasses
from itertools import combinations
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError

TAPS = 9
MIN_SAMPLES = TAPS
"""Minimum number of samples of a signal: the length of a kernel without dilation."""

KERNELS = np.array(list(combinations(range(TAPS), 3)))
"""Positions of the three weights of 2 in each of the 84 kernels."""

MAX_CHANNELS = 9
"""Maximum number of channels that a kernel adds up."""

ADDED = (0, 1, 2, 3, 5, 6, 7, 8)
"""Order in which the weights of -1 are added, after the weight in the middle."""

LARGEST = float(np.finfo(np.float32).max) / (12 * MAX_CHANNELS)
"""Largest absolute value of a signal whose sums cannot overflow in single precision. The
magnitudes of the nine weights of a kernel add up to 12, and a kernel adds up to nine channels."""

MANY_SIGNALS = 16
"""Minimum number of signals for which the compiled loops are loaded. Loading numba takes 0.5 s and
178 MB. The loops are therefore used for training and evaluation, but not in a node, which has one
window at a time."""

_PAIRS, _pair_of = np.unique(KERNELS[:, :2], axis=0, return_inverse=True)
_PAIR_OF = _pair_of.ravel()  # the shape of _pair_of differs between versions of NumPy

Single = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class RandomConvolutions:
    """Kernels with dilations and biases, fitted to signals of one length.

    ``counts`` is the number of biases per kernel at each dilation. ``biases`` has one value for
    each feature [unit of the signal]; the order is by dilation, then by kernel, as in aeon.
    ``sources``, shape (dilations, 84, 9), contains the channels that each kernel adds up, padded
    with -1.
    """

    samples: int
    channels: int
    dilations: Indices
    counts: Indices
    biases: Single
    sources: Indices

    def transform(self, signals: npt.ArrayLike) -> Matrix:
        """Return the features, shape (trials, features), of signals (trials, channels, samples).

        The features of a signal do not depend on other signals in the batch. Raises DatasetError
        if a signal is not finite in single precision, or the shape differs from the fit.
        """
        x = to_single(signals)
        if x.shape[1:] != (self.channels, self.samples):
            raise DatasetError(
                f'the signals have {x.shape[1]} channels of {x.shape[2]} samples, but the '
                f'convolutions were fitted to {self.channels} channels of {self.samples} samples'
            )
        return self.compute(x)

    def compute(self, x: Single) -> Matrix:
        """Like `transform`, without checking the shape of the signals."""
        count_above = load_loops(len(x)).count_above
        values = np.empty((len(x), len(self.biases)))
        ends = len(KERNELS) * np.cumsum(self.counts)
        parts = np.split(self.biases, ends[:-1])
        for i, (biases, end) in enumerate(zip(parts, ends, strict=True)):
            shares = np.empty((len(x), len(KERNELS), self.counts[i]))
            rows = biases.reshape(len(KERNELS), -1)
            count_above(x, self.dilations[i], i % 2, rows, self.sources[i], shares)
            values[:, end - len(biases) : end] = shares.reshape(len(x), -1)
        return values

    def sum_chosen(self, x: Single, rows: Indices, at: int) -> Single:
        """Apply each kernel to the signal chosen for it; return the sums, shape (84, samples).

        ``rows`` contains the index of the signal for each kernel; ``at`` is the index of the
        dilation.
        """
        sums = np.empty((len(KERNELS), self.samples), dtype=np.float32)
        load_loops(len(x)).add_chosen(x, rows, self.dilations[at], self.sources[at], sums)
        return sums


def to_single(signals: npt.ArrayLike) -> Single:
    """Check signals of shape (trials, channels, samples); return them in single precision."""
    with np.errstate(over='ignore'):
        x = np.asarray(signals).astype(np.float32)
    if x.ndim != 3 or not x.size or x.shape[2] < MIN_SAMPLES:
        raise DatasetError(
            f'the signals have shape {x.shape}; random convolutions need '
            f'(trials, channels, samples) with {MIN_SAMPLES} samples or more'
        )
    if not np.abs(x).max() < LARGEST:
        raise DatasetError('the signals contain values that are not finite in single precision')
    return x


def load_loops(signals: int) -> Any:
    """Return the module with the compiled loops, or this module.

    This module is returned if numba is not installed, or if there are few signals and the compiled
    loops are not loaded yet.
    """
    compiled = 'tactile_classifier.estimators.compiled_convolutions'
    if signals < MANY_SIGNALS and compiled not in sys.modules:
        return sys.modules[__name__]
    try:
        from tactile_classifier.estimators import compiled_convolutions
    except ImportError:  # numba is not installed
        return sys.modules[__name__]
    return compiled_convolutions


def _shift(x: Single, dilation: int) -> tuple[Single, Single]:
    """Return the common part of all kernels, and the contribution of each weight of 2.

    The first array, shape (channels, samples), is the convolution with nine weights of -1. The
    second, shape (channels, 9, samples), is three times the sample at each weight. The signal is
    zero beyond its ends.
    """
    (channels, samples), edge = x.shape, (TAPS // 2) * dilation
    padded = np.zeros((channels, samples + 2 * edge), dtype=np.float32)
    padded[:, edge : edge + samples] = x
    under = np.empty((channels, TAPS, samples), dtype=np.float32)
    for tap in range(TAPS):
        under[:, tap] = padded[:, tap * dilation :][:, :samples]
    common = -x
    for tap in ADDED:
        common -= under[:, tap]
    return common, np.float32(3) * under


def add_chosen(x: Any, rows: Any, dilation: Any, sources: Any, sums: Any) -> None:
    """Compute the sums of each kernel; see `compiled_convolutions.add_chosen`."""
    for i, (a, b, c) in enumerate(KERNELS):
        common, extra = _shift(x[rows[i]], int(dilation))
        sums[i] = 0.0
        for channel in sources[i][sources[i] >= 0]:
            one, two, three = extra[channel][[a, b, c]]
            sums[i] += common[channel] + ((one + two) + three)


def count_above(
    x: Any, dilation: Any, parity: Any, biases: Any, sources: Any, shares: Any
) -> None:
    """Compute the fraction of samples above each bias; see `compiled_convolutions.count_above`."""
    channels, samples = x.shape[1:]
    edge, pairs = (TAPS // 2) * int(dilation), len(_PAIRS)
    for trial, signal in enumerate(x):
        common, extra = _shift(signal, int(dilation))
        # ((common + one) + two) + three, as in the compiled loops; kernels share the first two.
        two = common[:, np.newaxis] + extra[:, _PAIRS[:, 0]]
        two += extra[:, _PAIRS[:, 1]]
        two, three = two.reshape(channels * pairs, samples), extra.reshape(-1, samples)
        sums = two.take(sources[:, 0] * pairs + _PAIR_OF, axis=0)
        sums += three.take(sources[:, 0] * TAPS + KERNELS[:, 2], axis=0)
        for source in sources.T[1:channels]:
            used = np.flatnonzero(source >= 0)
            term = two.take(source[used] * pairs + _PAIR_OF[used], axis=0)
            term += three.take(source[used] * TAPS + KERNELS[used, 2], axis=0)
            sums[used] += term
        for first, cut in ((parity, 0), (1 - parity, edge)):
            inside = sums[first::2, cut : samples - cut]
            above = inside[:, np.newaxis] > biases[first::2, :, np.newaxis]
            counts = above.view(np.uint8).sum(axis=2, dtype=np.uint32)
            shares[trial, first::2] = counts / inside.shape[1]
