# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Configuration of the nodes of this package."""

from __future__ import annotations

from dataclasses import dataclass, field

CONTACTS = ('flexion', 'abduction')
PROTOCOLS = ('texture', 'stiffness')


@dataclass(frozen=True)
class TrialConfig:
    """How the trial runner carries out the two protocols.

    The defaults fit the simulated rig. On a rig of your own, measure the guide's
    positions and the displacements that bring the fingertip into contact.
    """

    simulated: bool = field(
        default=False,
        metadata={'description': 'the rig is simulated; marks all that is derived from it'},
    )
    guide_start_m: float = field(
        default=0.060,
        metadata={
            'description': 'guide position with the fingertip over the start of the plate, '
            'or over the object',
            'unit': 'm',
            'range': (0.0, 2.0),
        },
    )
    glide_length_m: float = field(
        default=0.065,
        metadata={
            'description': 'distance glided over the plate',
            'unit': 'm',
            'range': (0.001, 2.0),
        },
    )
    glide_speed_m_s: float = field(
        default=0.015,
        metadata={
            'description': 'speed over the plate',
            'unit': 'm/s',
            'range': (0.001, 0.2),
        },
    )
    approach_speed_m_s: float = field(
        default=0.040,
        metadata={
            'description': 'speed of the guide out of contact',
            'unit': 'm/s',
            'range': (0.001, 0.2),
        },
    )
    flexion_displacement_m: float = field(
        default=0.0058,
        metadata={
            'description': 'tendon displacement that makes contact, in flexion',
            'unit': 'm',
            'range': (0.0, 0.1),
        },
    )
    abduction_displacement_m: float = field(
        default=0.0075,
        metadata={
            'description': 'the same in abduction',
            'unit': 'm',
            'range': (0.0, 0.1),
        },
    )
    pull_speed_m_s: float = field(
        default=0.010,
        metadata={
            'description': 'tendon speed of pull and release',
            'unit': 'm/s',
            'range': (0.0001, 0.1),
        },
    )
    settle_s: float = field(
        default=0.3,
        metadata={
            'description': 'rest between contact and glide',
            'unit': 's',
            'range': (0.0, 10.0),
        },
    )
    hold_s: float = field(
        default=4.0,
        metadata={
            'description': 'time to hold the finger on the object',
            'unit': 's',
            'range': (0.5, 3600.0),
        },
    )
    server_timeout_s: float = field(
        default=5.0,
        metadata={
            'description': 'time to wait for the guide and the tendon actuator to answer',
            'unit': 's',
            'range': (0.1, 60.0),
        },
    )

    def displacement_m(self, contact: str) -> float:
        """Return the tendon displacement that makes this kind of contact."""
        return {
            'flexion': self.flexion_displacement_m,
            'abduction': self.abduction_displacement_m,
        }[contact]


@dataclass(frozen=True)
class RecorderConfig:
    """What the bag recorder writes, and where."""

    bag: str = field(
        default='',
        metadata={'description': 'folder of the bag to write; must not exist yet'},
    )
    namespaces: tuple[str, ...] = field(
        default=('',),
        metadata={'description': 'namespaces of the fingers to record; empty: the root'},
    )
    classifiers: tuple[str, ...] = field(
        default=(),
        metadata={'description': 'node names of the classifiers to record'},
    )
    facts: str = field(
        default='{}',
        metadata={'description': 'facts about the recording for its metadata, as a JSON object'},
    )
