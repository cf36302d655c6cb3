# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Computation of the features of a model from one window of samples."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.feature_sets.feature_set import WindowSamples
from tactile_features.model_contract import LONGEST_BUFFER_S
from tactile_features.spec import FeatureSpec, format_rates, is_same_rate, MEAN, set_for

Matrix = npt.NDArray[np.float64]

CHANNEL_0 = 'channel_000__'
"""Prefix of the feature names of the first of several channels."""


class SampleWindow:
    """Computes the features of a specification from samples, for one or several channels.

    ``needs_speed`` is True if the features depend on the sliding speed. The constructor raises
    FeatureError if this installation cannot compute these features.
    """

    def __init__(self, task: str, spec: FeatureSpec) -> None:
        self._spec = spec
        self._channels = 1
        if spec.names[0].startswith(CHANNEL_0):
            self._channels = len({name.partition('__')[0] for name in spec.names})
        k = len(spec.names) // self._channels
        names = tuple(name.removeprefix(CHANNEL_0) for name in spec.names[:k])
        one = dataclasses.replace(spec, names=names, units=spec.units[:k])
        config = one.bind(FeatureConfig(buffer_s=LONGEST_BUFFER_S))
        self._set = set_for(task, config)
        self.needs_speed = self._set.needs_speed

    def compute(
        self, samples: npt.ArrayLike, rate_hz: float, speed_m_s: float, *, cut: bool = False
    ) -> Matrix:
        """Return the features, shape (k,), of evenly spaced samples, shape (n,) or (channels, n).

        ``rate_hz`` must equal the rate of the specification [Hz]. ``speed_m_s`` is 0 if the
        sliding speed is unknown [m/s]. If ``cut`` is True, the window is cut out of a longer
        signal.

        Raises
        ------
        DatasetError
            If shape, length, rate or speed do not fit; the message gives the remedy.
        UndefinedFeatureError
            If the window has no features.
        """
        rows = self._check(samples, rate_hz)
        whole = self._count(speed_m_s)
        if cut:
            rows = self._cut(rows, whole)
        count = rows.shape[1]
        if whole and count != whole:
            raise DatasetError(self._format_length(count, whole))
        if not np.isfinite(rows).all():
            raise UndefinedFeatureError('not all samples are finite')
        times_ns = np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)
        try:
            found = [
                self._set.compute(WindowSamples(times_ns, row, rate_hz, speed_m_s)) for row in rows
            ]
        except UndefinedFeatureError:
            raise
        except FeatureError as error:
            raise DatasetError(f'no features from these samples: {error}') from error
        values = np.concatenate(found)
        if not np.isfinite(values).all():
            raise UndefinedFeatureError('the features are not finite')
        return values

    def _check(self, samples: npt.ArrayLike, rate_hz: float) -> Matrix:
        """Check samples and rate; return samples of shape (channels, n)."""
        rows = np.array(samples, dtype=np.float64, order='C')
        channels = self._spec.channels
        if self._channels == 1 and channels and rows.ndim == 2 and len(rows) == len(channels):
            is_mean = self._spec.channel == MEAN
            rows = rows.mean(axis=0) if is_mean else rows[channels.index(self._spec.channel)]
        if self._channels == 1 and rows.ndim == 1:
            rows = rows[np.newaxis]
        if rows.ndim != 2 or len(rows) != self._channels or rows.shape[1] < 2:
            wanted = '(n,)' if self._channels == 1 else f'({self._channels}, n)'
            raise DatasetError(
                f'the samples have shape {np.shape(samples)}; one window has shape {wanted}: '
                'call this method once for each window'
            )
        if not is_same_rate(rate_hz, self._spec.rate_hz):
            given, wanted = format_rates(rate_hz, self._spec.rate_hz)
            raise DatasetError(
                f'the rate is {given} Hz, but the model was trained at {wanted} Hz: '
                'resample the samples (--resample-hz, TrialSet.resample)'
            )
        return rows

    def _count(self, speed_m_s: float) -> int:
        """Return the number of samples of a full window; 0 if windows have any length."""
        if not self.needs_speed:
            return self._spec.sample_count
        if not speed_m_s > 0.0:
            raise DatasetError(
                f'{self._spec.feature_set} needs a sliding speed above 0: give speed_m_s'
            )
        try:
            return self._set.window(self._spec.rate_hz, speed_m_s).sample_count
        except FeatureError as error:
            raise DatasetError(f'no features from these samples: {error}') from error

    def _format_length(self, count: int, whole: int) -> str:
        """Return a message if the number of samples is ``count`` instead of ``whole``."""
        rate_hz = self._spec.rate_hz
        text = f'{count} samples; a window has {whole} ({whole / rate_hz:g} s at {rate_hz:g} Hz)'
        if count < whole:
            return f'{text}: give exactly {whole} samples'
        crop_s = self._crop_s
        if crop_s is None:
            return f'{text}: give the same part of the trial as in training'
        first = math.ceil(crop_s * rate_hz)
        return (
            f'{text}: give only the window; the live node uses samples[{first}:{first + whole}] '
            f'of a glide, which begin {crop_s:g} s after the start of the glide'
        )

    @property
    def _crop_s(self) -> float | None:
        """Time from the start of a glide to the start of a window [s]; None if unknown."""
        crop_s = self._spec.parameters.get('texture_crop_start_s')
        return crop_s if isinstance(crop_s, float) else None

    def _cut(self, rows: Matrix, whole: int) -> Matrix:
        """Return the window of ``whole`` samples, or all samples if there are fewer."""
        spare = rows.shape[1] - whole
        first = math.ceil((self._crop_s or 0.0) * self._spec.rate_hz)
        if self.needs_speed:
            first = max(spare, 0) // 2
        return rows[:, first : first + whole] if whole and spare >= first else rows
