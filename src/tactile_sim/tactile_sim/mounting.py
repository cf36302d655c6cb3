# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the experimenter puts under the finger, and how each trial comes out a little different."""

from __future__ import annotations

import zlib
from functools import lru_cache

import numpy as np

from tactile_sim.description import (
    Body,
    Finger,
    Rig,
    VariationSpread,
    load_body,
    load_finger,
    load_plate,
    load_rig,
)
from tactile_sim.errors import DescriptionError
from tactile_sim.plant import Mount, Variation
from tactile_sim.surface import build_plate_surface

# Stiff against the fingertip by a factor of 10^5.
_RIGID_N_M = 1e9


@lru_cache
def build_mount(protocol: str, object_label: str, contact: str) -> tuple[Finger, Rig, Mount]:
    """Describe a trial.

    Raises
    ------
    DescriptionError
        No such protocol, object or contact.
    """
    finger, rig = load_finger(contact), load_rig()
    place = rig.placement
    if protocol == 'texture':
        plate = load_plate(object_label)
        surface = build_plate_surface(plate, finger.tip_radius_m, place.tray_depth_m)
        rigid = Body(_RIGID_N_M, 0.0, 1.0, plate.friction)
        mount = Mount(rigid, surface, place.texture_lead_m, place.texture_guide_m, np.inf)
    elif protocol == 'stiffness':
        body = load_body(object_label)
        mount = Mount(body, None, 0.0, place.object_guide_m, place.object_half_width_m)
    else:
        raise DescriptionError(f"protocol is {protocol!r}; it must be 'texture' or 'stiffness'")
    return finger, rig, mount


def make_seeds(
    protocol: str, object_label: str, contact: str, seed: int, count: int
) -> list[np.random.SeedSequence]:
    """One random stream a trial; trial i has the same stream whatever the count."""
    name = f'{protocol}/{contact}/{object_label}'
    return np.random.SeedSequence([seed, zlib.crc32(name.encode())]).spawn(count)


def draw_variation(spread: VariationSpread, generators: list[np.random.Generator]) -> Variation:
    """Draw every trial's deviations from its own generator."""
    rows = []
    for generator in generators:
        height, place, friction, stiffness = np.clip(generator.standard_normal(4), -3.0, 3.0)
        rows.append(
            (
                spread.contact_height_m * height,
                spread.placement_m * place,
                1 + spread.friction * friction,
                1 + spread.stiffness * stiffness,
                generator.random(),
            )
        )
    columns = np.array(rows).T
    return Variation(*(np.ascontiguousarray(column) for column in columns))
