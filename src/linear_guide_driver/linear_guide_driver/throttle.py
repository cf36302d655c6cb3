# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lets something happen at most once a period."""

from __future__ import annotations

import time


class Throttle:
    """Is due at once, then once every ``period_s`` [s]."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._due_s = time.monotonic()

    def is_due(self) -> bool:
        """Return whether the period is over; start the next one if so."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return False
        self._due_s = now_s + self._period_s
        return True
