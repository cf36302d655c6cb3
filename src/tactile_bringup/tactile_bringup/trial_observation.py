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

"""What the trial runner sees of a trial, and whether that is still a good trial."""

from __future__ import annotations

from linear_guide_driver.motion_track import MotionSummary
from tactile_bringup.records import TrialConfig

REST_SPEED_M_S = 0.0005
"""A tendon this slow is at rest: two steps of the servo's speed with a pulley of 10 mm."""


class TendonContact:
    """Whether the tendon comes to rest at the displacement of a contact, and stays there.

    States are judged by their stamps: those that were measured before the tendon came to rest
    may arrive after the pull has ended.

    Attributes
    ----------
    rest_ns : int or None
        Stamp of the first state at rest at the displacement [ns]; None before it.
    error_m : float
        Largest difference from the displacement since then [m].
    last_m : float
        Displacement of the last state [m].
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

    def take(self, stamp_ns: int, displacement_m: float, velocity_m_s: float) -> None:
        """Take in one state of the tendon: stamp [ns], displacement [m], speed [m/s]."""
        wanted_m = self._wanted_m
        if wanted_m is None:
            return
        error_m = abs(displacement_m - wanted_m)
        is_at_rest = error_m <= self._tolerance_m and abs(velocity_m_s) <= REST_SPEED_M_S
        if self.rest_ns is None and is_at_rest:
            self.rest_ns = stamp_ns
        if self.rest_ns is not None and stamp_ns >= self.rest_ns:
            self.last_m = displacement_m
            self.error_m = max(self.error_m, error_m)

    def describe_loss(self) -> str:
        """Return how the tendon left its displacement; empty while it stays there."""
        if self._wanted_m is None or self.error_m <= self._tolerance_m:
            return ''
        return (
            f'the tendon was wound in by {self.last_m:.4f} m instead of {self._wanted_m:.4f} m; '
            f'displacement_tolerance_m allows {self._tolerance_m:g} m'
        )


def judge_glide(summary: MotionSummary | None, speed_m_s: float, config: TrialConfig) -> str:
    """Return why a glide was not the commanded one; empty when it was.

    Parameters
    ----------
    summary : MotionSummary or None
        What was observed; None when too little was.
    speed_m_s : float
        Commanded speed [m/s].
    config : TrialConfig
    """
    if summary is None:
        return (
            'too few positions of the guide were reported to judge its glide; raise poll_rate_hz '
            'of linear_guide, or glide longer or slower'
        )
    error = abs(summary.mean_speed_m_s / speed_m_s - 1.0)
    if error > config.speed_tolerance:
        return (
            f'the guide glided at {summary.mean_speed_m_s:.5f} m/s instead of {speed_m_s:g} m/s; '
            f'speed_tolerance allows a share of {config.speed_tolerance:g}'
        )
    if summary.lag_s > config.lag_tolerance_s:
        return (
            f'the guide fell {summary.lag_s:.3f} s behind its commanded motion in the glide; '
            f'lag_tolerance_s allows {config.lag_tolerance_s:g} s; raise run_on_s of '
            'linear_guide where its host is busy'
        )
    return ''
