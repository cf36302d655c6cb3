# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protocols as lists of steps: the paper's two, and slip, which is only simulated.

One description serves the trial runner, which carries the steps out with
actions, and the simulator's fast path, which computes when each of them ends.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_bringup.records import PROTOCOLS, SIMULATED_PROTOCOLS, TrialConfig
from tactile_classifier.records import CONTACTS

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
    """Wind the tendon to ``displacement_m`` at ``speed_m_s``; 0 m releases it."""

    phase: str
    displacement_m: float
    speed_m_s: float


@dataclass(frozen=True)
class WaitStep:
    """Keep still for ``duration_s``."""

    phase: str
    duration_s: float


@dataclass(frozen=True)
class PullStep:
    """Pull the held object sideways; how far and how fast, the simulated rig describes."""

    phase: str


Step = GuideStep | TendonStep | WaitStep
"""Steps that the rig can carry out."""

SimulatedStep = Step | PullStep
"""Steps that the simulator can carry out."""


@dataclass(frozen=True)
class TrialRequest:
    """One trial: which protocol, which contact, on what.

    Raises
    ------
    ProtocolError
        When the protocol or the contact is not known, or a number is negative.
    """

    protocol: str
    contact: str
    object_label: str = ''
    trial_id: str = ''
    session_id: str = ''
    glide_speed_m_s: float = 0.0
    hold_s: float = 0.0
    mounting_id: str = ''

    def __post_init__(self) -> None:
        if self.protocol not in SIMULATED_PROTOCOLS:
            raise ProtocolError(
                f'no protocol "{self.protocol}"; there is {" and ".join(SIMULATED_PROTOCOLS)}'
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
    """Return the steps of a trial on the rig, in order; each names the phase it belongs to.

    Raises
    ------
    ProtocolError
        When the rig cannot carry the protocol out.
    """
    if request.protocol not in PROTOCOLS:
        raise ProtocolError(
            f'the rig cannot run a {request.protocol} trial: nothing on it pulls the object; '
            f'use tactile simulate {request.protocol}, or run {" or ".join(PROTOCOLS)}'
        )
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
    """Return how long a trial may take at most [s]: its motions and waits, and every time-out.

    Raises
    ------
    ProtocolError
        When the rig cannot carry the protocol out.
    """
    total_s = config.server_timeout_s  # until the drivers are ready
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


def simulated_steps(config: TrialConfig, request: TrialRequest) -> list[SimulatedStep]:
    """Return the steps of a simulated trial: those of the rig, or of a slip trial."""
    if request.protocol != 'slip':
        return [*trial_steps(config, request)]
    return [
        GuideStep('approach', config.guide_start_m, config.approach_speed_m_s),
        TendonStep('contact', config.displacement_m(request.contact), config.pull_speed_m_s),
        WaitStep('contact', config.settle_s),
        PullStep('pull'),
        WaitStep('pull', config.settle_s),
        TendonStep('release', 0.0, config.pull_speed_m_s),
    ]
