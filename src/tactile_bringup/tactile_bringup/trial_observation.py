# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks during a trial: contact of the tendon, and motion of the guide."""

from __future__ import annotations

import math

from linear_guide_driver.grbl.guide_client import MotionSummary, MOVED_M
from tactile_bringup.trial_protocols import TrialConfig
from tactile_ros.refusal import Refusal

REST_SPEED_M_S = 0.0005
"""Largest reported speed of a tendon at rest [m/s].

It equals two steps of the servo's speed with a pulley of 10 mm.
"""

FAST_M_S = 0.005
"""Lowest speed of a pull whose reported speed distinguishes motion from rest [m/s].

It is twice the largest step of the servo's speed: 0.229 rpm is 2.4 mm/s with a pulley of 100 mm.
"""

STILL_NS = 250_000_000
"""If a slow pull has not come closer to its target for this time [ns], the tendon is at rest.

A servo at its lowest speed, 0.229 rpm, moves by one of its 4096 counts in 64 ms.
"""

CLOCK_STEP_NS = 1_000_000_000
"""If stamps decrease by more than this, the clock was set back [ns]."""


class TendonContact:
    """Detector of tendon rest at the contact displacement, and of loss of contact.

    States are evaluated in order of arrival, so that a host clock that is set back does not hide
    a loss. If the clock is set back by more than `CLOCK_STEP_NS`, this also counts as a loss.

    If a speed of `FAST_M_S` or more was reported during a pull, the tendon is at rest at the
    first state within the tolerance with `REST_SPEED_M_S` or less. Otherwise, the reported speed
    cannot distinguish motion from rest. The tendon is then at rest once it has not come closer to
    the displacement for `STILL_NS`; the rest begins at the first state with the smallest error.

    Attributes
    ----------
    rest_ns : int or None
        Stamp of the first state at rest at the displacement [ns]; None until rest is detected.
    error_m : float
        Largest error of the displacement since ``rest_ns`` [m].
    last_m : float
        Displacement of the last state [m].
    """

    def __init__(self) -> None:
        self.end()

    def begin(self, displacement_m: float, tolerance_m: float) -> None:
        """Begin to check a pull to ``displacement_m`` [m] and the contact after it."""
        self.end()
        self._tolerance_m = tolerance_m
        self._wanted_m: float | None = displacement_m

    def end(self) -> None:
        """End the check, because the tendon will be slackened."""
        self._wanted_m = None
        self.rest_ns: int | None = None
        self.error_m = self.last_m = 0.0
        self._fastest_m_s = 0.0
        self._least_error_m = math.inf  # smallest error since the error fell below the tolerance
        self._nearest_ns = 0  # stamp of the first state with this error
        self._last_ns: int | None = None
        self._set_back_ns = 0  # largest decrease between consecutive stamps

    def take(self, stamp_ns: int, displacement_m: float, velocity_m_s: float) -> None:
        """Add a state of the tendon: stamp [ns], displacement [m], speed [m/s]."""
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
        """Return the time at which the tendon came to rest [ns], or None if it is not at rest."""
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
                f'{self._wanted_m:.4f} m, but displacement_tolerance_m allows an error of '
                f'{self._tolerance_m:g} m',
                'check the diagnostics of the tendon actuator',
            )
        if self._set_back_ns > CLOCK_STEP_NS:
            return Refusal(
                f"the clock of the tendon actuator's host was set back by "
                f'{self._set_back_ns / 1e9:.2f} s in contact',
                'repeat the trial, and do not set the clock during trials',
            )
        return None


class GuideRest:
    """Detector of motion of the guide while it should be at rest and the finger touches an object.

    Late states from before the guide came to rest are ignored.
    """

    def __init__(self) -> None:
        self.end()

    def begin(self, position_m: float) -> None:
        """Begin to check that the guide stays at a position [m]."""
        self.end()
        self._rest_m: float | None = position_m

    def end(self) -> None:
        """End the check, because the guide is allowed to move."""
        self._rest_m = None
        self._was_there = False
        self._away_m: float | None = None

    def take(self, stamp_ns: int, position_m: float, velocity_m_s: float) -> None:
        """Add a state of the guide: stamp [ns], position [m], speed [m/s]."""
        if self._rest_m is None:
            return
        if abs(position_m - self._rest_m) <= MOVED_M:
            self._was_there = True
        elif self._was_there:
            self._away_m = position_m

    def find_motion(self) -> Refusal | None:
        """Return a refusal if the guide has moved, otherwise None."""
        if self._rest_m is None or self._away_m is None:
            return None
        return Refusal(
            f'the guide moved from {self._rest_m:.4f} m to {self._away_m:.4f} m while the finger '
            'touched the object',
            'make sure that no other node commands the guide during a trial',
        )


def find_glide_fault(
    summary: MotionSummary | None, speed_m_s: float, config: TrialConfig
) -> Refusal | None:
    """Return why a glide differs from the commanded one, or None.

    ``summary`` is the observed motion, None if there were too few reports, and ``speed_m_s`` the
    commanded speed [m/s].
    """
    if summary is None:
        return Refusal(
            'too few positions of the guide were reported to assess its glide',
            'increase poll_rate_hz of linear_guide, or glide longer or slower',
        )
    error = abs(summary.mean_speed_m_s / speed_m_s - 1.0)
    if error > config.speed_tolerance:
        return Refusal(
            f'the guide glided at {summary.mean_speed_m_s:.5f} m/s instead of {speed_m_s:g} m/s, '
            f'but speed_tolerance allows a relative error of {config.speed_tolerance:g}',
            'check the diagnostics of the guide',
        )
    if summary.lag_s > config.lag_tolerance_s:
        return Refusal(
            f'the guide fell {summary.lag_s:.3f} s behind its commanded motion in the glide, but '
            f'lag_tolerance_s allows {config.lag_tolerance_s:g} s',
            'if its host is busy, increase run_on_s of linear_guide',
        )
    return None
