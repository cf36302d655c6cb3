# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One trial that advances as its devices move: the state behind the live rig."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_sim.errors import ConvergenceError
from tactile_sim.physics.finger import layout as at
from tactile_sim.physics.finger.solver import advance_trials, choose_solver
from tactile_sim.physics.scene import Scene
from tactile_sim.physics.variation import Variation

FloatArray = NDArray[np.float64]

_ONE_STEP = np.zeros(1, dtype=np.int64)


class Plant:
    """State of one trial, moved on by ``step``.

    Parameters
    ----------
    scene
        What it is made of.
    variation
        Of one trial.
    guide_m, tendon_m
        Where guide and tendon are at the start; the finger starts at rest [m].
    step_s
        Length of every step [s].
    """

    def __init__(
        self, scene: Scene, variation: Variation, guide_m: float, tendon_m: float, step_s: float
    ) -> None:
        self._solver = choose_solver()
        self._step_s = step_s
        self._state: FloatArray | None = None
        self.exchange(scene, variation, guide_m, tendon_m)

    @property
    def tension_n(self) -> float:
        """Tension of the tendon [N]."""
        return self._read(at.TENSION)

    @property
    def contact_force_n(self) -> float:
        """Normal force at the fingertip [N]."""
        return self._read(at.FORCE)

    @property
    def bend_rad(self) -> float:
        """Slope of the finger at its tip [rad]."""
        return self._read(at.MODES)

    def exchange(
        self, scene: Scene, variation: Variation, guide_m: float, tendon_m: float
    ) -> None:
        """Put something else under the finger, or another finger; all comes to rest."""
        self._scene = scene
        self._inputs = self._compute_inputs(guide_m, tendon_m)
        self._state = scene.start_trials(self._solver, variation, self._inputs, self._state)
        self._coefficients = scene.compute_coefficients((self._step_s,))

    def step(self, guide_m: float, tendon_m: float) -> None:
        """Move on by one step, at whose end guide and tendon are where they are told.

        Raises
        ------
        ConvergenceError
            No balance was found; the state is not to be used any more.
        """
        failed = np.full(1, -1, dtype=np.int64)
        inputs = self._compute_inputs(guide_m, tendon_m)
        advance_trials(
            self._solver,
            self._state,
            self._scene.parameters,
            _ONE_STEP,
            self._inputs,
            inputs[np.newaxis],
            self._coefficients,
            (),
            failed,
        )
        self._inputs = inputs
        if failed[0] >= 0:
            raise ConvergenceError(
                f'no balance of the finger with the guide at {guide_m:g} m and the tendon at '
                f'{tendon_m:g} m; something moved too far at once, or the description is extreme'
            )

    def _compute_inputs(self, guide_m: float, tendon_m: float) -> FloatArray:
        inputs = np.zeros(at.INPUTS)
        inputs[at.TENDON_INPUT], inputs[at.GUIDE_INPUT] = tendon_m, guide_m
        away_m = abs(guide_m - self._scene.guide_m)
        inputs[at.PRESENT_INPUT] = away_m <= self._scene.half_width_m
        return inputs

    def _read(self, row: int) -> float:
        assert self._state is not None
        return float(self._state[row, 0])
