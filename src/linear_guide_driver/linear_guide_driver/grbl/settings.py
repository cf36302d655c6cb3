# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controller's settings that decide whether the guide goes where and as fast as asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from linear_guide_driver.errors import DeviceRefusedError
from linear_guide_driver.records import LinearGuideConfig

TRAVEL_TOLERANCE_MM = 0.5

FEWEST_STEPS_PER_MM = 20.0
"""A step of more than 0.05 mm is felt in a glide, and a move could not end on its target."""

MOST_STEPS_HZ = 30e3
"""Most that Grbl's interrupt manages on an 8-bit board; grblHAL runs on faster ones."""


@dataclass(frozen=True)
class GuideSettings:
    """Settings of the X axis, in Grbl's units."""

    reports_inches: bool  # $13
    has_soft_limits: bool  # $20
    has_homing: bool  # $22
    homing_feed_mm_min: float  # $24
    homing_seek_mm_min: float  # $25
    pull_off_mm: float  # $27
    steps_per_mm: float  # $100
    max_rate_mm_min: float  # $110
    acceleration_mm_s2: float  # $120
    travel_mm: float  # $130

    @classmethod
    def from_lines(cls, values: Mapping[int, str]) -> GuideSettings:
        """Read the answer to ``$$``; raises `DeviceRefusedError`, also for what is missing."""

        def number(index: int, is_positive: bool = True) -> float:
            try:
                value = float(values[index])
            except (KeyError, ValueError):
                value = float('nan')
            if not (0.0 < value < 1e9 if is_positive else 0.0 <= value < 1e9):
                raise DeviceRefusedError(
                    f"the controller's setting ${index} is {values.get(index, 'missing')}; "
                    f'restore its settings'
                )
            return value

        return cls(
            reports_inches=number(13, False) != 0,
            has_soft_limits=number(20, False) != 0,
            has_homing=int(number(22, False)) & 1 == 1,  # a mask in grblHAL, bit 0 is Grbl's
            homing_feed_mm_min=number(24),
            homing_seek_mm_min=number(25),
            pull_off_mm=number(27, False),
            steps_per_mm=number(100),
            max_rate_mm_min=number(110),
            acceleration_mm_s2=number(120),
            travel_mm=number(130),
        )

    def check(
        self, config: LinearGuideConfig, build_options: str, *, is_hal: bool = False
    ) -> None:
        """Raise `DeviceRefusedError` for a setting that would change a motion without an error.

        ``build_options`` are the letters of the controller's ``[OPT:`` message, ``is_hal`` is
        True for grblHAL. The error names the setting and the value that it needs.
        """
        if self.reports_inches:
            raise DeviceRefusedError('the controller reports inches; set $13=0')
        if not self.has_homing:
            raise DeviceRefusedError('homing is switched off in the controller; set $22=1')
        if not self.has_soft_limits:
            raise DeviceRefusedError('soft limits are switched off in the controller; set $20=1')
        if 'Z' in build_options:
            raise DeviceRefusedError(
                'the firmware sets its origin at the homing switch (option Z), which turns the '
                'travel around; build it without HOMING_FORCE_SET_ORIGIN'
            )
        fastest_mm_min = config.max_speed_m_s * 60e3
        if self.max_rate_mm_min < fastest_mm_min * (1 - 1e-9):
            raise DeviceRefusedError(
                f'the controller caps speed at {self.max_rate_mm_min:g} mm/min, below '
                f'max_speed_m_s = {config.max_speed_m_s:g}; set $110={fastest_mm_min:g} or '
                f'max_speed_m_s to {self.max_rate_mm_min / 60e3:g}'
            )
        if self.steps_per_mm < FEWEST_STEPS_PER_MM:
            raise DeviceRefusedError(
                f'the controller counts {self.steps_per_mm:g} steps a millimetre, too coarse for '
                f'a glide; raise the micro-stepping and with it $100, to {FEWEST_STEPS_PER_MM:g} '
                f'or more'
            )
        steps_hz = fastest_mm_min / 60 * self.steps_per_mm
        if steps_hz > MOST_STEPS_HZ and not is_hal:
            raise DeviceRefusedError(
                f'max_speed_m_s = {config.max_speed_m_s:g} needs {steps_hz:.0f} steps/s and Grbl '
                f'manages {MOST_STEPS_HZ:.0f}; lower max_speed_m_s, or the micro-stepping and $100'
            )
        if abs(self.travel_mm - config.travel_m * 1e3) > TRAVEL_TOLERANCE_MM:
            raise DeviceRefusedError(
                f"the controller's travel is {self.travel_mm:g} mm and travel_m is "
                f'{config.travel_m:g}; set $130={config.travel_m * 1e3:g} or travel_m to '
                f'{self.travel_mm / 1e3:g}'
            )

    def compute_move_duration_s(self, distance_m: float, speed_m_s: float) -> float:
        """Return an upper bound on the time of a move from rest to rest [s].

        d/v + v/a: exact for a trapezoid, too long for a move that never reaches v.
        """
        return abs(distance_m) / speed_m_s + speed_m_s * 1e3 / self.acceleration_mm_s2

    def compute_homing_timeout_s(self) -> float:
        """Return how long a homing cycle may take [s].

        Grbl seeks over 1.5 times the travel, then approaches the switch slowly over
        a few times the pull-off.
        """
        seek_s = 1.5 * self.travel_mm / (self.homing_seek_mm_min / 60)
        locate_s = 10 * self.pull_off_mm / (self.homing_feed_mm_min / 60)
        return seek_s + locate_s + self.homing_seek_mm_min / 60 / self.acceleration_mm_s2
