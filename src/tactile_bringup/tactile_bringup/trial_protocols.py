# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protocols as lists of steps.

The trial runner executes the steps with actions; the fast simulation computes the end of each
step.
"""

from __future__ import annotations

from dataclasses import dataclass

from linear_guide_driver.config import EmergencyStopConfig
from tactile_classifier.types import CONTACTS
from tactile_features.types import PHASE_TOUCH
from tactile_ros.configs import parameter

PROTOCOLS = ('texture', 'stiffness')
"""Protocols of the rig and of the simulator."""


@dataclass(frozen=True)
class TrialConfig(EmergencyStopConfig):
    """Configuration of the trial runner for the two protocols.

    The defaults fit the simulated rig. On hardware, measure the guide positions and the
    displacements that bring the fingertip into contact.
    """

    guide_start_m: float = parameter(
        0.060,
        'guide position with the fingertip above the start of the plate, or above the object',
        unit='m',
        range=(0.0, 2.0),
    )
    glide_length_m: float = parameter(
        0.065,
        'length of a glide over the plate',
        unit='m',
        range=(0.001, 2.0),
    )
    glide_speed_m_s: float = parameter(
        0.015,
        'guide speed during a glide',
        unit='m/s',
        range=(0.001, 0.2),
    )
    approach_speed_m_s: float = parameter(
        0.040,
        'guide speed without contact',
        unit='m/s',
        range=(0.001, 0.2),
    )
    flexion_displacement_m: float = parameter(
        0.0049,
        'tendon displacement at contact, in flexion',
        unit='m',
        range=(0.0, 0.1),
    )
    abduction_displacement_m: float = parameter(
        0.0074,
        'tendon displacement at contact, in abduction',
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
        'pause between contact and glide',
        unit='s',
        range=(0.0, 10.0),
    )
    hold_s: float = parameter(
        4.0,
        'duration of a hold on the object',
        unit='s',
        range=(0.5, 3600.0),
    )
    server_timeout_s: float = parameter(
        5.0,
        'longest wait for the guide and the tendon actuator to be ready, and for their answers',
        unit='s',
        range=(0.1, 60.0),
    )
    heartbeat_timeout_s: float = parameter(
        0.4,
        'a trial ends if a heartbeat of the guide or the tendon actuator, or the position of a '
        'taut tendon, is missing for this time, or if the trial runner does not run for this time',
        unit='s',
        range=(0.15, 10.0),
    )
    strain_timeout_s: float = parameter(
        0.5,
        'a trial in contact ends if no valid sample arrives on tendon_sensor/strain for this time',
        unit='s',
        range=(0.05, 10.0),
    )
    speed_tolerance: float = parameter(
        0.011,
        'largest relative error of the mean speed of a glide; with the default, a spectral line '
        'at 30 Hz is shifted by one bin of 1/3 Hz',
        unit='1',
        range=(0.0001, 1.0),
    )
    lag_tolerance_s: float = parameter(
        0.033,
        'largest delay of the guide behind its commanded motion in a glide; with the default, a '
        'spectral line at 30 Hz is shifted by one period, which is one bin',
        unit='s',
        range=(0.001, 10.0),
    )
    displacement_tolerance_m: float = parameter(
        0.0005,
        'largest error of the tendon displacement in contact; the default is the tolerance with '
        'which the tendon actuator ends a pull',
        unit='m',
        range=(0.00001, 0.1),
    )

    def displacement_m(self, contact: str) -> float:
        """Return the tendon displacement [m] at this kind of contact."""
        return {
            'flexion': self.flexion_displacement_m,
            'abduction': self.abduction_displacement_m,
        }[contact]


LONGEST_TRAVEL_M = 2.0
"""Longest travel of a guide [m]; used because the position before a trial is unknown."""


class ProtocolError(ValueError):
    """The requested trial is not possible; the message gives the reason."""


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
    """Wait for ``duration_s`` without motion."""

    phase: str
    duration_s: float


Step = GuideStep | TendonStep | WaitStep
"""A step of a protocol."""


@dataclass(frozen=True)
class TrialRequest:
    """Request of one trial: protocol, contact and object; raises `ProtocolError` if invalid."""

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
                f'protocol is "{self.protocol}"; it must be one of {", ".join(PROTOCOLS)}'
            )
        if self.contact not in CONTACTS:
            raise ProtocolError(
                f'contact is "{self.contact}"; it must be one of {", ".join(CONTACTS)}'
            )
        for name in ('glide_speed_m_s', 'hold_s'):
            if not 0.0 <= getattr(self, name) < float('inf'):
                raise ProtocolError(f'{name} is {getattr(self, name)}; it must be 0 or more')


def glide_speed_m_s(config: TrialConfig, request: TrialRequest) -> float:
    """Return the speed of the glide [m/s]; 0 for a stiffness trial."""
    if request.protocol != 'texture':
        return 0.0
    return request.glide_speed_m_s or config.glide_speed_m_s


def trial_steps(config: TrialConfig, request: TrialRequest) -> list[Step]:
    """Return the steps of a trial in order, each with its phase."""
    pull_m = config.displacement_m(request.contact)
    approach = GuideStep('approach', config.guide_start_m, config.approach_speed_m_s)
    touch = TendonStep(PHASE_TOUCH, pull_m, config.pull_speed_m_s)
    release = TendonStep('release', 0.0, config.pull_speed_m_s)
    if request.protocol == 'stiffness':
        return [approach, touch, WaitStep('hold', request.hold_s or config.hold_s), release]
    end_m = config.guide_start_m + config.glide_length_m
    return [
        approach,
        touch,
        WaitStep(PHASE_TOUCH, config.settle_s),
        GuideStep('glide', end_m, glide_speed_m_s(config, request)),
        release,
        GuideStep('return', config.guide_start_m, config.approach_speed_m_s),
    ]


def longest_trial_s(config: TrialConfig, request: TrialRequest) -> float:
    """Return the longest duration of a trial [s]: motions, waits and all timeouts."""
    total_s = config.server_timeout_s  # wait for the drivers
    # A tendon that is taut before the trial is slackened first.
    total_s += 2 * config.server_timeout_s
    total_s += config.displacement_m(request.contact) / config.pull_speed_m_s
    for step in trial_steps(config, request):
        if isinstance(step, WaitStep):
            total_s += step.duration_s
            continue
        # Accepting the goal of a motion and cancelling it can each take one timeout.
        total_s += 2 * config.server_timeout_s
        if isinstance(step, TendonStep):
            total_s += config.displacement_m(request.contact) / step.speed_m_s
        elif isinstance(step, GuideStep) and step.phase == 'glide':
            total_s += config.glide_length_m / step.speed_m_s
        elif isinstance(step, GuideStep):
            total_s += LONGEST_TRAVEL_M / step.speed_m_s
    return total_s
