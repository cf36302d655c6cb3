# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Configuration of the nodes of this package."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.configs import parameter

PROTOCOLS = ('texture', 'stiffness')
"""Protocols of the rig, which have features and classifiers."""

SIMULATED_PROTOCOLS = (*PROTOCOLS, 'slip')
"""Protocols of the simulator."""


@dataclass(frozen=True)
class TrialConfig:
    """Configuration of the trial runner for the two protocols.

    The defaults fit the simulated rig. On hardware, measure the guide positions and the
    displacements that bring the fingertip into contact.
    """

    simulated: bool = parameter(
        False,
        'deprecated: marks every event as simulated. The samples of a simulated sensor say so '
        'themselves',
    )
    guide_start_m: float = parameter(
        0.060,
        'guide position with the fingertip over the start of the plate, or over the object',
        unit='m',
        range=(0.0, 2.0),
    )
    glide_length_m: float = parameter(
        0.065,
        'distance glided over the plate',
        unit='m',
        range=(0.001, 2.0),
    )
    glide_speed_m_s: float = parameter(
        0.015,
        'speed over the plate',
        unit='m/s',
        range=(0.001, 0.2),
    )
    approach_speed_m_s: float = parameter(
        0.040,
        'speed of the guide out of contact',
        unit='m/s',
        range=(0.001, 0.2),
    )
    flexion_displacement_m: float = parameter(
        0.0049,
        'tendon displacement that makes contact, in flexion',
        unit='m',
        range=(0.0, 0.1),
    )
    abduction_displacement_m: float = parameter(
        0.0074,
        'the same in abduction',
        unit='m',
        range=(0.0, 0.1),
    )
    pull_speed_m_s: float = parameter(
        0.010,
        'tendon speed of pull and release',
        unit='m/s',
        range=(0.0001, 0.1),
    )
    settle_s: float = parameter(
        0.3,
        'rest between contact and glide',
        unit='s',
        range=(0.0, 10.0),
    )
    hold_s: float = parameter(
        4.0,
        'time to hold the finger on the object',
        unit='s',
        range=(0.5, 3600.0),
    )
    server_timeout_s: float = parameter(
        5.0,
        'time to wait for the guide and the tendon actuator to be ready, and to answer',
        unit='s',
        range=(0.1, 60.0),
    )
    heartbeat_timeout_s: float = parameter(
        0.4,
        'silence of the heartbeat of the guide or of the tendon actuator that ends a trial; so '
        'does a standstill of the trial runner, or a taut tendon whose position is not told, for '
        'as long',
        unit='s',
        range=(0.15, 10.0),
    )
    strain_timeout_s: float = parameter(
        0.5,
        'a trial in contact ends when no valid sample came on tendon_sensor/strain for this long',
        unit='s',
        range=(0.05, 10.0),
    )
    speed_tolerance: float = parameter(
        0.011,
        'largest error of the mean speed of a glide; at the default a spectral line at 30 Hz '
        'moves by one bin of 1/3 Hz',
        unit='1',
        range=(0.0001, 1.0),
    )
    lag_tolerance_s: float = parameter(
        0.033,
        'longest time by which the guide may fall behind its commanded motion in a glide; at the '
        'default a spectral line at 30 Hz loses one period, which is one bin',
        unit='s',
        range=(0.001, 10.0),
    )
    displacement_tolerance_m: float = parameter(
        0.0005,
        'largest error of the tendon displacement in contact; the default is that within which '
        'the tendon actuator ends a pull',
        unit='m',
        range=(0.00001, 0.1),
    )

    def displacement_m(self, contact: str) -> float:
        """Return the tendon displacement that makes this kind of contact."""
        return {
            'flexion': self.flexion_displacement_m,
            'abduction': self.abduction_displacement_m,
        }[contact]
