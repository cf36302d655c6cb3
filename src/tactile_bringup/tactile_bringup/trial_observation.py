# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of a running trial: tendon contact and motion of the guide."""

from __future__ import annotations

import math

from linear_guide_driver.grbl.guide_client import MotionSummary, MOVED_M
from tactile_bringup.trial_protocols import TrialConfig
from tactile_ros.refusal import Refusal

REST_SPEED_M_S = 0.0005
"""A tendon this slow is at rest: two steps of the servo's speed with a pulley of 10 mm."""

FAST_M_S = 0.005
"""Speed from which the reported speed of a pull tells motion from rest.

Twice the largest step of the servo's speed: 0.229 rpm with a pulley of 100 mm is 2.4 mm/s.
"""

STILL_NS = 250_000_000
"""Time without approach after which a slow pull is at rest [ns].

A servo at its lowest speed, 0.229 rpm, moves by one of its 4096 counts in 64 ms.
"""

CLOCK_STEP_NS = 1_000_000_000
"""A stamp that is earlier than the last one by more than this is a clock step [ns]."""


class TendonContact:
    """Detector of tendon rest at the contact displacement, and of loss of contact.

    States are taken in the order of their arrival, so that a host clock that is set back hides
    no loss. One that is set back by more than `CLOCK_STEP_NS` is a loss itself.

    A pull that was seen at `FAST_M_S` or more is at rest with the first state within the
    tolerance at `REST_SPEED_M_S` or less. A slower pull may be reported at that speed while it
    moves. It is at rest when it has come no nearer to the displacement for `STILL_NS`, from the
    first state that was as near.

    ``rest_ns`` is the stamp of the first state at rest at the displacement [ns]; None until rest
    is detected. ``error_m`` is the largest difference from the displacement since then [m],
    ``last_m`` the displacement of the last state [m].
    """

    def __init__(self) -> None:
        self.end()

    def begin(self, displacement_m: float, tolerance_m: float) -> None:
        """Watch a pull to ``displacement_m`` [m], and what follows it."""
        self.end()
        self._tolerance_m = tolerance_m
        self._wanted_m: float | None = displacement_m

    def end(self) -> None:
        """Watch no more: the tendon is about to be released."""
        self._wanted_m = None
        self.rest_ns: int | None = None
        self.error_m = self.last_m = 0.0
        self._fastest_m_s = 0.0
        self._least_error_m = math.inf  # since the tendon came within the tolerance
        self._nearest_ns = 0  # stamp of the first state with that error
        self._last_ns: int | None = None
        self._set_back_ns = 0  # largest step back from one stamp to the next

    def take(self, stamp_ns: int, displacement_m: float, velocity_m_s: float) -> None:
        """Take in one state of the tendon: stamp [ns], displacement [m], speed [m/s]."""
        wanted_m = self._wanted_m
        if wanted_m is None:
            return
        if self._last_ns is not None:
            self._set_back_ns = max(self._set_back_ns, self._last_ns - stamp_ns)
        self._last_ns = stamp_ns
        error_m = abs(displacement_m - wanted_m)
        if self.rest_ns is None:
            self.rest_ns = self._find_rest(stamp_ns, error_m, abs(velocity_m_s))
        if self.rest_ns is not None:
            self.last_m = displacement_m
            self.error_m = max(self.error_m, error_m)

    def _find_rest(self, stamp_ns: int, error_m: float, speed_m_s: float) -> int | None:
        """Return since when the tendon is at rest [ns]; None while it is not."""
        self._fastest_m_s = max(self._fastest_m_s, speed_m_s)
        if error_m > self._tolerance_m:
            self._least_error_m = math.inf
            return None
        if self._fastest_m_s >= FAST_M_S:
            return stamp_ns if speed_m_s <= REST_SPEED_M_S else None
        if error_m < self._least_error_m:
            self._least_error_m, self._nearest_ns = error_m, stamp_ns
        return self._nearest_ns if stamp_ns - self._nearest_ns >= STILL_NS else None

    def find_loss(self) -> Refusal | None:
        """Return why the contact is lost, or None while the tendon stays at its displacement."""
        if self._wanted_m is None:
            return None
        if self.error_m > self._tolerance_m:
            return Refusal(
                f'the tendon was tightened by {self.last_m:.4f} m instead of '
                f'{self._wanted_m:.4f} m, and displacement_tolerance_m allows '
                f'{self._tolerance_m:g} m',
                'see the diagnostics of the tendon actuator',
            )
        if self._set_back_ns > CLOCK_STEP_NS:
            return Refusal(
                f"the clock of the tendon actuator's host was set back by "
                f'{self._set_back_ns / 1e9:.2f} s in contact',
                'repeat the trial, and let nothing set the clock during trials',
            )
        return None


class GuideRest:
    """Detector of a guide that moves while the finger touches an object.

    States reported before the guide came to rest may arrive later; they do not count.
    """

    def __init__(self) -> None:
        self.end()

    def begin(self, position_m: float) -> None:
        """Watch a guide that rests at a position [m]."""
        self.end()
        self._rest_m: float | None = position_m

    def end(self) -> None:
        """Watch no more: the guide may move."""
        self._rest_m = None
        self._was_there = False
        self._away_m: float | None = None

    def take(self, stamp_ns: int, position_m: float, velocity_m_s: float) -> None:
        """Take in one state of the guide: stamp [ns], position [m], speed [m/s]."""
        if self._rest_m is None:
            return
        if abs(position_m - self._rest_m) <= MOVED_M:
            self._was_there = True
        elif self._was_there:
            self._away_m = position_m

    def find_motion(self) -> Refusal | None:
        """Return that the guide has moved, or None while it rests."""
        if self._rest_m is None or self._away_m is None:
            return None
        return Refusal(
            f'the guide moved from {self._rest_m:.4f} m to {self._away_m:.4f} m while the finger '
            'touched the object',
            'let nothing else command the guide during a trial',
        )


def find_glide_fault(
    summary: MotionSummary | None, speed_m_s: float, config: TrialConfig
) -> Refusal | None:
    """Return why a glide was not the commanded one [m/s], or None when it was.

    ``summary`` is None when too little was observed.
    """
    if summary is None:
        return Refusal(
            'too few positions of the guide were reported to judge its glide',
            'raise poll_rate_hz of linear_guide, or glide longer or slower',
        )
    error = abs(summary.mean_speed_m_s / speed_m_s - 1.0)
    if error > config.speed_tolerance:
        return Refusal(
            f'the guide glided at {summary.mean_speed_m_s:.5f} m/s instead of {speed_m_s:g} m/s, '
            f'and speed_tolerance allows a share of {config.speed_tolerance:g}',
            'see the diagnostics of the guide',
        )
    if summary.lag_s > config.lag_tolerance_s:
        return Refusal(
            f'the guide fell {summary.lag_s:.3f} s behind its commanded motion in the glide, and '
            f'lag_tolerance_s allows {config.lag_tolerance_s:g} s',
            'raise run_on_s of linear_guide where its host is busy',
        )
    return None
