# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""When to give up waiting for samples, by a clock that nobody sets and nobody stops."""

from __future__ import annotations

from collections.abc import Callable
import time

from tactile_features.extraction.extractor import GRACE_S, TrialFeatureExtractor

LONGEST_STEP_S = 0.5


class SampleTimeout:
    """Refuses windows whose samples do not come, while nothing else comes that would.

    A window is refused when it has waited `GRACE_S` longer than ``samples_timeout_s`` and no
    block has come for as long. Where data still come, their stamps decide in the extractor.
    Time in which nobody asked counts as `LONGEST_STEP_S` at most: in a process that was
    stopped, samples may have come that it has not looked at.

    Parameters
    ----------
    extractor : TrialFeatureExtractor
    monotonic_s : callable, optional
        The time [s].
    """

    def __init__(
        self, extractor: TrialFeatureExtractor, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._extractor = extractor
        self._monotonic_s = monotonic_s
        self._most_s = extractor.config.samples_timeout_s + GRACE_S
        self._seen: tuple[int | None, int] = (None, 0)
        self._asked_s = monotonic_s()
        self._waited_s = 0.0

    def is_over(self) -> bool:
        """Return whether to refuse the oldest window that waits; ask several times a second."""
        now_s = self._monotonic_s()
        self._waited_s += min(now_s - self._asked_s, LONGEST_STEP_S)
        self._asked_s = now_s
        seen = (self._extractor.waits_since_ns, self._extractor.block_count)
        if seen != self._seen:
            self._seen = seen
            self._waited_s = 0.0
        return seen[0] is not None and self._waited_s > self._most_s
