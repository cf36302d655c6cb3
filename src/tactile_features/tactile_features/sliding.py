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

"""Spectra of the window that ends at every sample: running features, spectrograms, slip."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.util import find_spec
import sys

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.errors import FeatureError

FloatArray = NDArray[np.float64]

# Compiling, or loading what was compiled, pays from here on [samples].
_COMPILE_FROM = 500_000
# Products at a time, so that they stay in the cache.
_PART_NUMBERS = 16_000


@dataclass(frozen=True)
class SlidingKernel:
    """What does not change from sample to sample, for bins of a window of n samples.

    Attributes
    ----------
    cosine, sine : ndarray of shape (bins, n)
        Of the angle of each bin at each place in a window's length of time.
    scale : ndarray of shape (bins,)
        From the magnitude of a sum to the amplitude.
    """

    cosine: FloatArray
    sine: FloatArray
    scale: FloatArray


@dataclass
class SlidingState:
    """What is carried from sample to sample.

    Attributes
    ----------
    place : int
        How many samples of the current length n have come.
    anchor : float
        First of them [N]: what the fresh sums are taken from.
    last : ndarray of shape (n,)
        The last n samples, by place.
    sums : ndarray of shape (bins, 4)
        Cosine and sine sums of the last n samples, and the fresh ones of this length.
    """

    place: int
    anchor: float
    last: FloatArray
    sums: FloatArray


def sliding_spectrum(
    tension_n: ArrayLike, sample_count: int, bins: Iterable[int] | None = None
) -> FloatArray:
    """Return the amplitudes of every window of a signal: one window a sample.

    Row ``i`` is `compute_spectrum` of ``tension_n[i:i + sample_count]``, but for rounding,
    at a small part of its cost. For a signal that comes in pieces see `SlidingSpectrum`,
    which gives the same bits.

    Parameters
    ----------
    tension_n : array_like of shape (samples,)
        Evenly sampled tension without gaps [N].
    sample_count : int
        Samples in a window, at least 2.
    bins : iterable of int, optional
        Which components, from 0 to ``sample_count // 2``; all of them by default.

    Returns
    -------
    ndarray of shape (max(0, samples - sample_count + 1), bins)
        Amplitudes [N].

    Raises
    ------
    FeatureError
        When the window is too short, a bin does not exist or a value is not finite.
    """
    return SlidingSpectrum(sample_count, bins).add(tension_n)


@dataclass
class SlidingSpectrum:
    """The spectrum of the last ``sample_count`` samples, after every sample.

    With ``W`` the n-th root of one, ``Y_k(t)`` the sum of ``x_j W^(k j)`` over the last n
    samples j has the magnitude of their Fourier component k, since ``W^(k n) = 1``; a
    sample changes it by ``(x_t - x_(t-n)) W^(k t)``. So that rounding does not add up, the
    same sum is begun afresh every n samples, from their differences to the first of
    them, and takes the place of the running one when n have come. The error is then that
    of two windows, however long the signal: about 1e-15 of the largest amplitude in
    them, and an offset costs nothing.

    The same samples give the same bits in every grouping.

    Parameters
    ----------
    sample_count : int
        Samples in a window, at least 2.
    bins : iterable of int, optional
        Which components, from 0 to ``sample_count // 2``; all of them by default.

    Raises
    ------
    FeatureError
        When the window is too short or a bin does not exist.
    """

    sample_count: int
    bins: Iterable[int] | None = None
    _kernel: SlidingKernel = field(init=False, repr=False)
    _state: SlidingState = field(init=False, repr=False)
    _full: bool = field(init=False, repr=False, default=False)

    def __post_init__(self) -> None:
        n = self.sample_count
        if n < 2:
            raise FeatureError(f'a spectrum needs windows of at least 2 samples, not {n}')
        chosen = np.arange(n // 2 + 1) if self.bins is None else np.array([*self.bins], dtype=int)
        if not len(chosen) or ((chosen < 0) | (chosen > n // 2)).any():
            raise FeatureError(f'the bins of {n} samples are 0 to {n // 2}; asked were {chosen}')
        self._kernel = _make_kernel(n, chosen)
        self._state = SlidingState(0, 0.0, np.zeros(n), np.zeros((len(chosen), 4)))

    def add(self, tension_n: ArrayLike) -> FloatArray:
        """Take the next samples and return the amplitudes of the windows that they complete.

        Parameters
        ----------
        tension_n : array_like of shape (samples,)
            Tension [N].

        Returns
        -------
        ndarray of shape (windows, bins)
            Amplitudes [N]: one row a sample, none for the first ``sample_count - 1``.

        Raises
        ------
        FeatureError
            When a value is not finite; none of the samples is taken then.
        """
        tension = np.ascontiguousarray(tension_n, dtype=np.float64)
        if tension.ndim != 1:
            raise FeatureError(f'samples come as one row of numbers, not as {tension.shape}')
        if not np.isfinite(tension).all():
            raise FeatureError('the tension holds values that are not finite')
        missing = 0 if self._full else self.sample_count - 1 - self._state.place
        head, rest = tension[: max(missing, 0)], tension[max(missing, 0) :]
        width = len(self._state.sums)
        slide = _choose(len(tension))
        if len(head):
            slide(self._kernel, self._state, head, np.empty((len(head), width)))
        out = np.empty((len(rest), width))
        if len(rest):
            slide(self._kernel, self._state, rest, out)
            self._full = True
        return out


def _make_kernel(n: int, bins: NDArray[np.int_]) -> SlidingKernel:
    # The product of the indices is reduced as an integer, so that no angle is large.
    angle = 2.0 * np.pi / n * (np.outer(bins, np.arange(n)) % n)
    scale = np.where(2 * bins == n, 1.0, 2.0) / n
    scale[bins == 0] = 0.0  # a window without its mean has nothing at 0 Hz
    return SlidingKernel(np.cos(angle), -np.sin(angle), scale)


def _choose(samples: int) -> Callable[[SlidingKernel, SlidingState, FloatArray, FloatArray], None]:
    """Return the compiled loop where it pays and numba is there: the bits are the same."""
    name = 'tactile_features.compiled_sliding'
    if name in sys.modules or (samples >= _COMPILE_FROM and find_spec('numba')):
        from tactile_features.compiled_sliding import slide

        return slide
    return _slide


def _slide(
    kernel: SlidingKernel, state: SlidingState, tension: FloatArray, out: FloatArray
) -> None:
    """Take samples, length by length; `accumulate` adds one after another, as a loop does."""
    width, n = kernel.cosine.shape
    longest = max(1, _PART_NUMBERS // width)
    at = 0
    while at < len(tension):
        if state.place == 0:
            state.anchor = float(tension[at])
        count = min(n - state.place, len(tension) - at, longest)
        here = slice(state.place, state.place + count)
        new = tension[at : at + count]
        cosine, sine = kernel.cosine[:, here], kernel.sine[:, here]
        change, fresh = new - state.last[here], new - state.anchor
        real = _accumulate(state.sums[:, 0], cosine, change)
        imaginary = _accumulate(state.sums[:, 1], sine, change)
        _accumulate(state.sums[:, 2], cosine, fresh)
        _accumulate(state.sums[:, 3], sine, fresh)
        state.last[here] = new
        state.place += count
        if state.place == n:
            state.place = 0
            state.sums[:, :2] = state.sums[:, 2:]
            state.sums[:, 2:] = 0.0
            real[:, -1], imaginary[:, -1] = state.sums[:, 0], state.sums[:, 1]
        amplitude = np.sqrt(real * real + imaginary * imaginary) * kernel.scale[:, None]
        out[at : at + count] = amplitude.T
        at += count


def _accumulate(total: FloatArray, table: FloatArray, step: FloatArray) -> FloatArray:
    """Return ``total`` after each step, and leave the last in it."""
    products = table * step
    products[:, 0] += total
    running = np.add.accumulate(products, axis=1)
    total[:] = running[:, -1]
    return running
