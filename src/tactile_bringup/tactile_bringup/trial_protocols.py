# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protocols as lists of steps.

One description serves the trial runner, which carries the steps out with
actions, and the simulator's fast path, which computes when each of them ends.
"""

from __future__ import annotations

from dataclasses import dataclass

from linear_guide_driver.records import EmergencyStopConfig
from tactile_classifier.records import CONTACTS
from tactile_ros.configs import parameter

PROTOCOLS = ('texture', 'stiffness')
"""Protocols of the rig and of the simulator, which have features and classifiers."""


@dataclass(frozen=True)
class TrialConfig(EmergencyStopConfig):
    """Configuration of the trial runner for the two protocols.

    The defaults fit the simulated rig. On hardware, measure the guide positions and the
    displacements that bring the fingertip into contact.
    """

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


LONGEST_TRAVEL_M = 2.0
"""No guide is longer; where the guide stands before a trial, nobody knows."""


class ProtocolError(ValueError):
    """A trial was asked for that cannot be run; the message says why."""


@dataclass(frozen=True)
class GuideStep:
    """Move the guide to ``position_m`` at ``speed_m_s``."""

    phase: str
    position_m: float
    speed_m_s: float


@dataclass(frozen=True)
class TendonStep:
    """Tighten the tendon to ``displacement_m`` at ``speed_m_s``; 0 m slackens it."""

    phase: str
    displacement_m: float
    speed_m_s: float


@dataclass(frozen=True)
class WaitStep:
    """Keep still for ``duration_s``."""

    phase: str
    duration_s: float


Step = GuideStep | TendonStep | WaitStep
"""Steps that the rig and the simulator can carry out."""


@dataclass(frozen=True)
class TrialRequest:
    """One trial: which protocol, which contact, on what; `ProtocolError` when it cannot be."""

    protocol: str
    contact: str
    object_label: str = ''
    trial_id: str = ''
    session_id: str = ''
    glide_speed_m_s: float = 0.0
    hold_s: float = 0.0
    mounting_id: str = ''

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise ProtocolError(
                f'no protocol "{self.protocol}"; there is {" and ".join(PROTOCOLS)}'
            )
        if self.contact not in CONTACTS:
            raise ProtocolError(f'no contact "{self.contact}"; there is {" and ".join(CONTACTS)}')
        for name in ('glide_speed_m_s', 'hold_s'):
            if not 0.0 <= getattr(self, name) < float('inf'):
                raise ProtocolError(f'{name} is {getattr(self, name)}; it must be 0 or more')


def glide_speed_m_s(config: TrialConfig, request: TrialRequest) -> float:
    """Return the speed over the plate [m/s]; 0 for a stiffness trial."""
    if request.protocol != 'texture':
        return 0.0
    return request.glide_speed_m_s or config.glide_speed_m_s


def trial_steps(config: TrialConfig, request: TrialRequest) -> list[Step]:
    """Return the steps of a trial, in order; each names the phase it belongs to."""
    pull_m = config.displacement_m(request.contact)
    approach = GuideStep('approach', config.guide_start_m, config.approach_speed_m_s)
    contact = TendonStep('contact', pull_m, config.pull_speed_m_s)
    release = TendonStep('release', 0.0, config.pull_speed_m_s)
    if request.protocol == 'stiffness':
        return [approach, contact, WaitStep('hold', request.hold_s or config.hold_s), release]
    end_m = config.guide_start_m + config.glide_length_m
    return [
        approach,
        contact,
        WaitStep('contact', config.settle_s),
        GuideStep('glide', end_m, glide_speed_m_s(config, request)),
        release,
        GuideStep('return', config.guide_start_m, config.approach_speed_m_s),
    ]


def longest_trial_s(config: TrialConfig, request: TrialRequest) -> float:
    """Return how long a trial may take at most [s]: its motions and waits, and every time-out."""
    total_s = config.server_timeout_s  # until the drivers are ready
    # A tendon that is taut is slackened first.
    total_s += 2 * config.server_timeout_s
    total_s += config.displacement_m(request.contact) / config.pull_speed_m_s
    for step in trial_steps(config, request):
        if isinstance(step, WaitStep):
            total_s += step.duration_s
            continue
        # Two time-outs for each motion: to take the goal, and to give it up.
        total_s += 2 * config.server_timeout_s
        if isinstance(step, TendonStep):
            total_s += config.displacement_m(request.contact) / step.speed_m_s
        elif isinstance(step, GuideStep) and step.phase == 'glide':
            total_s += config.glide_length_m / step.speed_m_s
        elif isinstance(step, GuideStep):
            total_s += LONGEST_TRAVEL_M / step.speed_m_s
    return total_s
