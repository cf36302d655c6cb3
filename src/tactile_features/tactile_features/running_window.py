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

"""The first part of a texture window, while the rest of it still fills."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.phase_window import PhaseWindow
from tactile_features.records import FeatureWindow, TrialEvent
from tactile_features.windows import SampleBuffer


class RunningWindow(PhaseWindow):
    """The first ``count`` samples of the texture window of a glide that has begun.

    It supposes that the glide lasts, because nobody knows its end yet: so it is the same
    whether the event of the end comes before or after the samples. Whether the glide
    lasted, the window of the finished phase says.

    Parameters
    ----------
    start : TrialEvent
        The start of the glide.
    count : int
        Samples in this part of the window.
    config : FeatureConfig
    """

    def __init__(self, start: TrialEvent, count: int, config: FeatureConfig) -> None:
        super().__init__(start, start, config)
        self._wanted = count

    def take(self, buffer: SampleBuffer) -> FeatureWindow | None:
        """Return the window, or None while its samples have not all come."""
        cut = self._first_samples(buffer)
        if cut is None:
            return None
        return self._refuse_evicted(buffer) or self._assess(cut)

    def _compute(self, samples: Any) -> NDArray[np.float64]:
        return compute_running_spectrum(samples['tension_n'], self._config.texture_samples)

    def _window(self, *args: Any) -> FeatureWindow:
        return dataclasses.replace(super()._window(*args), running=True)


def compute_running_spectrum(tension_n: ArrayLike, sample_count: int) -> NDArray[np.float64]:
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
