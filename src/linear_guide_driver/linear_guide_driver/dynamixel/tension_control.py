# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Winds a tendon in and out until the sensor reads a tension, slowly enough for any finger.

A plain integrator: the winding speed is proportional to what the tension lacks. A finger with
stiffness k [N/m] closes the gap with the rate ``gain * k``; the sensor's message and the servo
answer after some 0.1 s. The gain is chosen for the stiffest case, a finger that presses on a
rigid stop (10 to 30 kN/m in the simulated rig), so a free finger (0.2 to 1.5 kN/m) takes
seconds.
"""

from __future__ import annotations

FULL_SPEED_M_S = 0.006
"""Winding speed when the whole limit is lacking."""

DEAD_BAND = 0.01
"""Share of the limit by which the tension may be off without being corrected: one count of
the servo is 15 um of tendon."""

NEAR = 0.02
"""Tolerance of a reached target, as a share of the limit. The finger creeps away from the target
almost as fast as the last of the gap is closed."""

STEPS_NEAR = 3
"""Consecutive steps within tolerance after which the target counts as reached."""

LONGEST_STEP_S = 0.1
LEAD_S = 0.1


class TensionController:
    """One step at a time: what is measured now to where the tendon shall be wound.

    No IO and no clock.

    Parameters
    ----------
    target_n, limit_n : float
        Tension to reach, and the guarded limit that sets the scale [N].
    speed_m_s : float
        Fastest winding [m/s].
    start_m, max_displacement_m : float
        Where the tendon is, and how far it may be wound in [m].
    """

    def __init__(
        self,
        target_n: float,
        limit_n: float,
        speed_m_s: float,
        start_m: float,
        max_displacement_m: float,
    ) -> None:
        self._target_n, self._speed_m_s = target_n, speed_m_s
        self._gain_m_s_n = FULL_SPEED_M_S / limit_n
        self._dead_band_n, self._near_n = DEAD_BAND * limit_n, NEAR * limit_n
        self._max_m = max_displacement_m
        self._goal_m = start_m
        self._steps_near = 0

    @property
    def is_near(self) -> bool:
        """Whether the tension has been at its target for some steps."""
        return self._steps_near >= STEPS_NEAR

    @property
    def is_at_end(self) -> bool:
        """Whether the tendon is wound in as far as it may be, and more is wanted."""
        return self._goal_m >= self._max_m and not self._steps_near

    def step(self, displacement_m: float, tension_n: float, elapsed_s: float) -> float:
        """Return where the tendon shall be [m].

        Parameters
        ----------
        displacement_m, tension_n : float
            Measured now [m], [N].
        elapsed_s : float
            Since the last step [s].
        """
        error_n = self._target_n - tension_n
        self._steps_near = self._steps_near + 1 if abs(error_n) <= self._near_n else 0
        if abs(error_n) <= self._dead_band_n:
            return self._goal_m
        speed_m_s = min(max(self._gain_m_s_n * error_n, -self._speed_m_s), self._speed_m_s)
        goal_m = self._goal_m + speed_m_s * min(elapsed_s, LONGEST_STEP_S)
        # Never far ahead of a tendon that does not follow: nothing winds up.
        lead_m = self._speed_m_s * LEAD_S
        goal_m = min(max(goal_m, displacement_m - lead_m), displacement_m + lead_m)
        # A tendon below its zero is not wound in to there while it is to be let out.
        self._goal_m = min(max(goal_m, min(0.0, displacement_m)), self._max_m)
        return self._goal_m
