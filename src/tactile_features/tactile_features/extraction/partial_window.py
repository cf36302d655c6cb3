# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The first part of a texture window, while the rest of it still fills."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_features.config import FeatureConfig
from tactile_features.extraction.phase_window import PhaseWindow
from tactile_features.feature_sets.feature_set import WindowSamples
from tactile_features.records import FeatureWindow, Outcome, TrialEvent
from tactile_features.windows import SampleBuffer


class PartialWindow(PhaseWindow):
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
        self._whole, self._wanted = self._set.sample_count, count

    def take(self, buffer: SampleBuffer) -> FeatureWindow | None:
        """Return the window, or None while its samples have not all come."""
        if self._no_window:
            return self.refuse(Outcome.UNDEFINED, self._no_window)
        cut = self._first_samples(buffer)
        if cut is None:
            return None
        return self._refuse_evicted(buffer) or self._assess(cut)

    def _compute(self, samples: WindowSamples) -> NDArray[np.float64]:
        return self._set.compute_part(samples, self._whole)

    def _window(self, *args: Any) -> FeatureWindow:
        return dataclasses.replace(super()._window(*args), partial=True)
