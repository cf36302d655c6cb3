# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated palpation rig: guide, tendon actuator and sensor on one physical model."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.devices.dynamixel import DynamixelDevice
from tactile_sim.devices.grbl import GrblDevice
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.errors import TautTendonError
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import Plant
from tactile_sim.physics.variation import draw_variation, make_generator, Variation

STEP_S = 1e-3
_SLACK_M = 1e-3  # the tendon counts as slack below; homing shifts its zero by about 0.6 mm
_SESSION = -1  # session number in the seeds; `simulate_trials` uses none below 0

_MOST_STEPS = 64
"""Largest number of steps that are computed at once."""

_MOST_TRIALS = 10**6  # largest number of trials in one mounting


class PalpationRig:
    """The rig in virtual time; `advance` simulates it up to a given time.

    Each pull of the tendon has its own seed for the noise of the sensor. Therefore, the noise in
    a trial does not depend on the time that has passed before it.

    Parameters
    ----------
    seed : int
        Seed of the trials' variations and of the sensor's noise.
    variation : Variation, optional
        Deviations that all trials have; by default, they are drawn for each trial.
    catalogue : Catalogue, optional
        Plates and objects that can be mounted; by default the packaged descriptions.
    """

    def __init__(
        self,
        seed: int = 0,
        variation: Variation | None = None,
        catalogue: Catalogue | None = None,
    ) -> None:
        self._catalogue = catalogue or default_catalogue()
        description = self._catalogue.rig()
        self.guide = GrblDevice(description.guide)
        self.tendon = DynamixelDevice(description.tendon)
        self._seed = seed
        self.sensor = LoadCellDevice(description.load_cell, make_generator(seed, 'sensor'))
        self._variation = variation
        self._steps = 0
        self._mounted = {'protocol': 'stiffness', 'object': 'none', 'contact': 'flexion'}
        self._trials = self._pulls = 0
        self._is_pulled = False
        scene = build_scene('stiffness', 'none', 'flexion', self._catalogue)
        guide_m = self.guide.position_m(0.0)
        self._plant = Plant(scene, Variation.none(), guide_m, 0.0, STEP_S)
        self.sensor.record(0.0, self._plant.tension_n, self._plant.contact_force_n)

    @property
    def now_s(self) -> float:
        return self._steps * STEP_S

    def step_time_s(self, due_s: float) -> float:
        """Return the time [s] at which the first future step that reaches ``due_s`` ends."""
        if math.isinf(due_s):
            return due_s if due_s > 0.0 else (self._steps + 1) * STEP_S
        steps = max(self._steps + 1, int(due_s / STEP_S))
        while steps * STEP_S < due_s:
            steps += 1
        return steps * STEP_S

    def advance(self, now_s: float) -> float:
        """Simulate whole steps of ``STEP_S``, at most up to ``now_s``; return the time reached.

        The result is the same if the same time is covered with fewer or more calls.
        """
        steps = int(now_s / STEP_S) + 1
        while steps * STEP_S > now_s:
            steps -= 1
        while self._steps < steps:
            self._take_steps(min(steps - self._steps, _MOST_STEPS))
        return self.now_s

    def _take_steps(self, count: int) -> None:
        """Simulate between one and ``count`` steps at once.

        In the first step, the devices can do anything, such as begin a motion. The further steps
        only continue motions that the devices can predict. If the tension turns out to disturb
        the predicted motion of the tendon, the steps after the disturbance are discarded.
        """
        first_s = (self._steps + 1) * STEP_S
        self.tendon.advance(first_s, self._plant.tension_n)
        self._note_pull()
        if self._plant.is_steady_at(self.guide.position_m(first_s), self.tendon.displacement_m):
            self._rest(count)
        else:
            self._move(count)

    def _rest(self, count: int) -> None:
        """Simulate at least one step, and more as long as guide and tendon stand still."""
        tension_n, force_n = self._plant.tension_n, self._plant.contact_force_n
        until_s = min(self.guide.rests_until_s, self.tendon.rests_until_s(tension_n))
        now_s = (self._steps + 1) * STEP_S
        end = self._steps + count
        while True:
            self._steps += 1
            self.sensor.record(now_s, tension_n, force_n)
            next_s = (self._steps + 1) * STEP_S
            if self._steps == end or next_s >= until_s:
                break
            now_s = next_s
        self.tendon.rest(now_s, tension_n)

    def _move(self, count: int) -> None:
        """Simulate steps with motion; the devices have already been advanced by the first one."""
        times_s = np.asarray(STEP_S * np.arange(self._steps + 1, self._steps + 1 + count), float)
        guide_m = self.guide.positions_m(times_s)
        foreseen = self.tendon.foresee(times_s[1 : len(guide_m)])
        # The prediction ends before the tendon becomes taut or slack, because `_note_pull` is only
        # called at the first step.
        same = np.append((foreseen.displacement_m > _SLACK_M) == self._is_pulled, False)
        foreseen = foreseen.shorten(int(np.argmin(same)))
        tendon_m = np.append(self.tendon.displacement_m, foreseen.displacement_m)
        steps = self._plant.foresee(guide_m[: len(tendon_m)], tendon_m)
        taken = 1 + self.tendon.follow(foreseen, steps.tension_n[:-1])
        self._plant.follow(steps, taken)
        self._steps += taken
        forces = (times_s[:taken], steps.tension_n, steps.contact_force_n)
        for time_s, tension_n, force_n in zip(*(some.tolist() for some in forces), strict=False):
            self.sensor.record(time_s, tension_n, force_n)

    def _note_pull(self) -> None:
        was_pulled, self._is_pulled = self._is_pulled, self.tendon.displacement_m > _SLACK_M
        if self._is_pulled and not was_pulled:
            self._pulls += 1
            names = (self._seed, 'sensor', self._trials, self._pulls)
            self.sensor.draw_from(make_generator(*names))

    def mount(
        self,
        protocol: str,
        object_label: str,
        contact: str,
        numbers: Sequence[int] | None = None,
    ) -> dict[str, Any]:
        """Put a plate or object under the finger, or turn the finger to the other contact.

        ``numbers`` are the numbers of session, mounting and trial, which start at 0. Trials with
        the same session and mounting have the same deviations of session and mounting. If
        ``numbers`` is None, every call starts a new mounting within one session.

        Raises `DescriptionError` for an unknown protocol, object or contact, and
        `TautTendonError` when the tendon is tightened.
        """
        scene = build_scene(protocol, object_label, contact, self._catalogue)
        if self.tendon.displacement_m > _SLACK_M:
            raise TautTendonError(
                f'the tendon is tightened by {self.tendon.displacement_m * 1e3:.1f} mm; '
                'slacken it before you change the plate or object under the finger: '
                'ros2 service call /tendon_actuator/release std_srvs/srv/Trigger'
            )
        variation = self._variation
        if variation is None:
            session, first, per_mounting = _SESSION, self._trials, 1
            if numbers is not None:
                session = _SESSION - 1 - numbers[0]
                first = numbers[1] * _MOST_TRIALS + numbers[2]
                per_mounting = _MOST_TRIALS
            variation, _ = draw_variation(
                self._catalogue,
                contact,
                protocol,
                object_label,
                self._seed,
                session,
                count=1,
                first=first,
                trials_per_mounting=per_mounting,
            )
        guide_m = self.guide.position_m(self.now_s)
        self._plant.exchange(scene, variation, guide_m, self.tendon.displacement_m)
        self.sensor.set_bias(float(variation.sensor_bias_n[0]))
        self._mounted = {'protocol': protocol, 'object': object_label, 'contact': contact}
        self._trials += 1
        self._pulls = 0
        return {'ok': True, **self._mounted, 'trial': self._trials}

    def read_truth(self) -> dict[str, Any]:
        """Return the true physical state of the simulation, which tests compare with readings."""
        return {
            'time_s': self.now_s,
            'guide_position_m': self.guide.position_m(self.now_s),
            'tendon_displacement_m': self.tendon.displacement_m,
            'bend_rad': self._plant.bend_rad,
            'tension_n': self._plant.tension_n,
            'contact_force_n': self._plant.contact_force_n,
            'mount': dict(self._mounted),
        }
