# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The palpation rig: three devices around one physical state."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_sim.description import load_rig
from tactile_sim.dynamixel_device import DynamixelDevice
from tactile_sim.errors import RigError
from tactile_sim.grbl_device import GrblDevice
from tactile_sim.load_cell_device import LoadCellDevice
from tactile_sim.mounting import build_mount, draw_variation
from tactile_sim.plant import Plant, Variation

STEP_S = 1e-3
_SLACK_M = 5e-4


class PalpationRig:
    """The rig in virtual time: whoever calls `advance` is its clock.

    Parameters
    ----------
    seed
        Of the trials' variations and the sensor's noise.
    variation
        The same variation for every trial instead of drawn ones.

    Attributes
    ----------
    guide, tendon, sensor
        The devices: bytes in, bytes out.
    now_s
        Time since the rig was switched on [s].
    """

    def __init__(self, seed: int = 0, variation: Variation | None = None) -> None:
        description = load_rig()
        self.guide = GrblDevice(description.guide)
        self.tendon = DynamixelDevice(description.tendon)
        self._seeds = np.random.SeedSequence(seed)
        self.sensor = LoadCellDevice(
            description.load_cell, np.random.default_rng(self._seeds.spawn(1)[0])
        )
        self._spread = description.variation
        self._variation = variation
        self._steps = 0
        self._mounted = {'protocol': 'stiffness', 'object': 'none', 'contact': 'flexion'}
        self._trials = 0
        finger, rig, mount = build_mount('stiffness', 'none', 'flexion')
        self._plant = Plant(finger, rig, mount, Variation.none(), self.guide.position_m(0.0), 0.0)
        self.sensor.record(0.0, self._plant.tension_n)

    @property
    def now_s(self) -> float:
        return self._steps * STEP_S

    def advance(self, now_s: float) -> float:
        """Move on in steps of the physics, to ``now_s`` at the most; returns the time reached."""
        while (next_s := (self._steps + 1) * STEP_S) <= now_s:
            self._steps += 1
            self.tendon.advance(next_s, float(self._plant.tension_n[0]))
            guide_m = self.guide.position_m(next_s)
            self._plant.step(guide_m, self.tendon.displacement_m, STEP_S)
            self.sensor.record(next_s, self._plant.tension_n)
        return self.now_s

    def mount(self, protocol: str, object_label: str, contact: str) -> dict[str, Any]:
        """Put a plate or object under the finger, or turn the finger to the other contact.

        Raises
        ------
        DescriptionError
            No such protocol, object or contact.
        RigError
            The tendon is pulled.
        """
        finger, _, mount = build_mount(protocol, object_label, contact)
        if self.tendon.displacement_m > _SLACK_M:
            raise RigError(
                f'the tendon is wound in by {self.tendon.displacement_m * 1e3:.1f} mm; '
                'release it before changing what lies under the finger'
            )
        variation = self._variation
        if variation is None:
            generator = np.random.default_rng(self._seeds.spawn(1)[0])
            variation = draw_variation(self._spread, [generator])
        guide_m = self.guide.position_m(self.now_s)
        self._plant.exchange(mount, variation, guide_m, self.tendon.displacement_m, finger)
        self._mounted = {'protocol': protocol, 'object': object_label, 'contact': contact}
        self._trials += 1
        return {'ok': True, **self._mounted, 'trial': self._trials}

    def read_truth(self) -> dict[str, Any]:
        """What no sensor says: the physical state, for tests."""
        return {
            'time_s': self.now_s,
            'guide_position_m': self.guide.position_m(self.now_s),
            'tendon_displacement_m': self.tendon.displacement_m,
            'bend_rad': float(self._plant.bend_rad[0]),
            'tension_n': float(self._plant.tension_n[0]),
            'contact_force_n': float(self._plant.contact_force_n[0]),
            'mount': dict(self._mounted),
        }
