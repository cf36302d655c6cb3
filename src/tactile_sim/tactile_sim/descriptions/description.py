# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frozen dataclasses that describe the rig, its fingers, plates and objects.

The module ``catalogue`` reads them from YAML files.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
import itertools
import math
from typing import Any

from tactile_sim.errors import DescriptionError

PROTOCOLS = ('texture', 'stiffness')
CONTACTS = ('flexion', 'abduction')
GROOVES = ('none', 'rectangular', 'triangular', 'circular', 'profile')
MOST_BRANCHES = 3
MOST_POINTS = 1000


# All ranges are wide. They reject typing errors and wrong units, but accept unusual rigs.
def _between(low: float, high: float, **default: Any) -> Any:
    return dataclasses.field(metadata={'range': (low, high)}, **default)


def _list() -> Any:
    return dataclasses.field()


@dataclass(frozen=True)
class Finger:
    """A tendon-driven finger that bends in one plane; ``docs/simulation.md`` has its equations."""

    length_m: float = _between(0.01, 1.0)
    moment_arm_m: float = _between(1e-4, 0.1)
    bending_stiffness_nm_rad: float = _between(1e-5, 100.0)
    creep_stiffness_nm_rad: float = _between(0.0, 100.0)
    creep_time_s: float = _between(1e-3, 1e5)
    damping_nm_s_rad: float = _between(1e-7, 10.0)
    mass_kg: float = _between(0.0, 2.0)
    tip_mass_kg: float = _between(0.0, 2.0)
    tip_radius_m: float = _between(2e-4, 0.05)
    tip_stiffness_n_m: float = _between(1.0, 1e8)
    tip_damping_n_s_m: float = _between(0.0, 1e4)
    tip_shear_stiffness_n_m: float = _between(1.0, 1e8)
    contact_bend_deg: float = _between(0.1, 150.0)
    tendon_stiffness_n_m: float = _between(1.0, 1e7)
    # The upper limit is due to a series in `compute_balance`, which is valid for small friction.
    tendon_friction: float = _between(0.0, 0.15)
    tendon_presliding_m: float = _between(1e-7, 1e-3)
    bend_stop_deg: float = _between(0.1, 150.0)
    stop_stiffness_nm_rad: float = _between(1e-3, 1e4)
    stiffness_per_k: float = _between(-0.05, 0.05)

    def __post_init__(self) -> None:
        if not self.contact_bend_deg < self.bend_stop_deg:
            raise DescriptionError(
                f'contact_bend_deg is {self.contact_bend_deg:g}; '
                f'it must be below bend_stop_deg, which is {self.bend_stop_deg:g}'
            )


@dataclass(frozen=True)
class Plate:
    """A rigid texture plate: a grooved zone between two flat ends.

    ``groove`` is the shape of the grooves. Rectangular, triangular and circular grooves have a
    pitch, a width and a depth. With ``none``, the plate has no grooves. With ``profile``, the
    grooved zone is a polyline through the points (x, height) in ``points_mm``; x increases from 0
    to ``grooved_mm``, and height 0 is the top of the plate.
    """

    groove: str
    end_mm: float = _between(0.1, 1000.0)
    grooved_mm: float = _between(0.1, 1000.0)
    friction: float = _between(0.0, 5.0)
    pitch_mm: float = _between(0.0, 1000.0, default=0.0)
    width_mm: float = _between(0.0, 1000.0, default=0.0)
    depth_mm: float = _between(0.0, 100.0, default=0.0)
    points_mm: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if self.groove not in GROOVES:
            raise DescriptionError(f'groove is {self.groove!r}; it must be one of {GROOVES}')
        if self.groove == 'profile':
            self._check_points()
        elif self.points_mm:
            raise DescriptionError('points_mm is only for groove: profile; omit it')
        if self.groove in ('none', 'profile'):
            if self.pitch_mm or self.width_mm or self.depth_mm:
                raise DescriptionError(
                    f'groove: {self.groove} has no pitch_mm, width_mm and depth_mm; omit them'
                )
        else:
            self._check_grooves()

    def _check_grooves(self) -> None:
        if not 0.05 <= self.width_mm <= self.pitch_mm <= self.grooved_mm:
            raise DescriptionError(
                f'width_mm is {self.width_mm:g}, pitch_mm {self.pitch_mm:g} and grooved_mm '
                f'{self.grooved_mm:g}; the width must be at least 0.05 and at most the pitch, '
                'and the pitch at most grooved_mm'
            )
        if self.depth_mm <= 0.0:
            raise DescriptionError('depth_mm of a groove must be above 0; or use groove: none')
        if self.groove == 'circular' and self.depth_mm > self.width_mm / 2:
            raise DescriptionError('depth_mm of a circular groove is at most half its width_mm')

    def _check_points(self) -> None:
        if not 2 <= len(self.points_mm) <= MOST_POINTS:
            raise DescriptionError(
                f'points_mm has {len(self.points_mm)} points; '
                f'groove: profile needs 2 to {MOST_POINTS} points, each [x, height]'
            )
        along, heights = zip(*self.points_mm, strict=True)
        rising = all(a < b for a, b in itertools.pairwise(along))
        if not (rising and along[0] == 0.0 and along[-1] == self.grooved_mm):
            raise DescriptionError(
                'the x of points_mm must increase from 0 to grooved_mm, '
                f'which is {self.grooved_mm:g}, from each point to the next'
            )
        if not all(-100.0 <= height <= 0.0 for height in heights):
            raise DescriptionError(
                'the heights of points_mm must be between -100 and 0; 0 is the top of the plate'
            )

    @property
    def length_m(self) -> float:
        """Length of the whole plate [m]."""
        return (2 * self.end_mm + self.grooved_mm) * 1e-3


@dataclass(frozen=True)
class Branch:
    """One branch of a viscoelastic object (Prony series): a spring in series with a dashpot."""

    stiffness_n_m: float = _between(1e-9, 1e9)
    relaxation_time_s: float = _between(1e-3, 1e5)


@dataclass(frozen=True)
class Body:
    """A soft object on which the fingertip presses in a stiffness trial.

    ``stiffness_n_m`` is the stiffness after complete relaxation; 0 means that there is no object.
    Up to three ``branches`` add parts of the stiffness that relax. For compressions far below
    ``softening_m`` [m], the force is proportional to the compression. Far above it, the force is
    proportional to the square root of the compression, as for a buckling shell (Pogorelov). If
    ``softening_m`` is 0, as for a solid, the force is always proportional to the compression.
    ``friction`` is the friction coefficient of the fingertip on the object [1].
    """

    stiffness_n_m: float = _between(0.0, 1e9)
    branches: tuple[Branch, ...] = _list()
    softening_m: float = _between(0.0, 0.1)
    friction: float = _between(0.0, 5.0)

    def __post_init__(self) -> None:
        if len(self.branches) > MOST_BRANCHES:
            raise DescriptionError(
                f'branches has {len(self.branches)} entries; at most {MOST_BRANCHES} are supported'
            )
        if self.stiffness_n_m == 0 and self.branches:
            raise DescriptionError(
                'a body without stiffness_n_m cannot have branches; write branches: []'
            )


@dataclass(frozen=True)
class Guide:
    """The linear guide and its Grbl controller."""

    travel_m: float = _between(0.01, 10.0)
    max_speed_m_s: float = _between(1e-4, 10.0)
    acceleration_m_s2: float = _between(1e-3, 100.0)
    step_m: float = _between(1e-8, 1e-3)
    pull_off_m: float = _between(1e-5, 0.1)
    power_up_m: float = _between(0.0, 10.0)

    def __post_init__(self) -> None:
        if not self.power_up_m <= self.travel_m:
            raise DescriptionError('power_up_m must be at most travel_m')


@dataclass(frozen=True)
class TendonDrive:
    """The Dynamixel servo that pulls the tendon, and its pulley."""

    pulley_radius_m: float = _between(1e-3, 0.2)
    counts_per_turn: int = _between(16, 1 << 24)
    slack_count: int = _between(0, 1 << 24)
    torque_constant_nm_a: float = _between(1e-3, 100.0)
    friction_current_a: float = _between(0.0, 10.0)
    max_speed_m_s: float = _between(1e-4, 10.0)
    max_acceleration_m_s2: float = _between(1e-3, 1000.0)
    back_drive_n: float = _between(0.0, 1000.0)
    back_drive_n_s_m: float = _between(1e-3, 1e6)
    reboot_s: float = _between(0.0, 60.0)

    @property
    def m_per_count(self) -> float:
        """Length of tendon that the pulley winds up per count of the encoder [m]."""
        return 2 * math.pi * self.pulley_radius_m / self.counts_per_turn


@dataclass(frozen=True)
class LoadCell:
    """The load cell on the tendon, whose errors the module ``sensing`` simulates."""

    rate_hz: float = _between(1.0, 1e4)
    clock_error_ppm: float = _between(-1e4, 1e4)
    noise_n: float = _between(0.0, 100.0)
    capacity_n: float = _between(0.01, 1e5)
    low_pass_hz: float = _between(0.1, 1e5)
    resolution_n: float = _between(1e-9, 10.0)
    drift_n_rt_s: float = _between(0.0, 10.0)
    crosstalk: float = _between(-0.5, 0.5)
    bias_n_per_k: float = _between(-1.0, 1.0)

    def __post_init__(self) -> None:
        if not self.resolution_n <= self.capacity_n:
            raise DescriptionError('resolution_n must be at most capacity_n')

    @property
    def period_s(self) -> float:
        """True time between two samples [s]. It includes the error of the load cell's clock."""
        return (1 + self.clock_error_ppm * 1e-6) / self.rate_hz


@dataclass(frozen=True)
class Placement:
    """Positions of plate, tray and object, in coordinates of the linear guide."""

    texture_guide_m: float = _between(0.0, 10.0)
    texture_lead_m: float = _between(0.0, 1.0)
    tray_depth_m: float = _between(1e-5, 0.1)
    object_guide_m: float = _between(0.0, 10.0)
    object_half_width_m: float = _between(1e-4, 1.0)


@dataclass(frozen=True)
class VariationSpread:
    """Standard deviations of randomly varied quantities.

    A field whose name has no unit is relative to the mean of the quantity.
    """

    contact_height_m: float = _between(0.0, 0.01)
    placement_m: float = _between(0.0, 0.05)
    friction: float = _between(0.0, 0.3)
    object_stiffness: float = _between(0.0, 0.3)
    finger_stiffness: float = _between(0.0, 0.3)
    glide_speed: float = _between(0.0, 0.3)
    tendon_zero_m: float = _between(0.0, 0.01)
    temperature_k: float = _between(0.0, 20.0)


@dataclass(frozen=True)
class VariationLevels:
    """Random variation between trials, between mountings and between sessions.

    A mounting is a series of trials for which a plate or object is fixed once. A session is a
    series of mountings for which the finger and the rig are set up once.
    """

    trial: VariationSpread
    mounting: VariationSpread
    session: VariationSpread


@dataclass(frozen=True)
class Rig:
    """The rig around the finger: guide, tendon drive, load cell, positions and variation."""

    guide: Guide
    tendon: TendonDrive
    load_cell: LoadCell
    placement: Placement
    variation: VariationLevels

    def __post_init__(self) -> None:
        for name in ('texture_guide_m', 'object_guide_m'):
            if getattr(self.placement, name) > self.guide.travel_m:
                raise DescriptionError(f'placement.{name} must be at most guide.travel_m')
