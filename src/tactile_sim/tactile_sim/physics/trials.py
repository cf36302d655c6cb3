# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulation of many trials in parallel, or of one trial together with the simulated devices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.errors import ConvergenceError, DescriptionError
from tactile_sim.physics import layout as at
from tactile_sim.physics.motion import plan_timeline, Timeline
from tactile_sim.physics.scene import build_scene, Scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.solver import advance_trials
from tactile_sim.physics.variation import draw_variation, Variation

FloatArray = NDArray[np.float64]

STEPS_PER_SAMPLE = 16
"""Number of time steps per sample of the load cell while an axis moves. The page
docs/benchmarks.md compares the errors of different numbers."""

TRUSTED_NM = 1e-2
"""Default of ``trusted_nm`` in `simulate_motion` [N m], which passes it to `advance_trials` for
scenes with inertia."""

_RESTING_STEPS_PER_SAMPLE = 2
_SETTLING_S = 0.1  # time after a motion with small steps; the finger comes to rest in 20 ms
_BATCH = 64
_ROWS = (at.SENSED, at.TENSION, at.FORCE, at.MODES)
_MODE_ROWS = (at.MODES + 1, at.MODES + 2)
_STATE = tuple(range(at.STATE_ROWS))


@dataclass(frozen=True)
class SimulatedTrials:
    """Simulated trials, with the errors of the load cell.

    ``tension_n`` of shape (trials, samples) are the readings of the load cell [N]. They are NaN
    from the time at which the solver found no balance for a trial. ``sample_times_s`` of shape
    (samples,) are true times since the start of the timeline [s]. `SimulatedMotion` describes
    ``truth`` and ``failed_at_s``.
    """

    tension_n: FloatArray
    sample_times_s: FloatArray
    truth: Mapping[str, FloatArray]
    failed_at_s: FloatArray


@dataclass(frozen=True)
class SimulatedMotion:
    """Simulated trials, without bias, drift, noise and rounding of the load cell.

    ``sensed_n`` of shape (trials, samples) is the tension with crosstalk of the contact force,
    after the low-pass filter of the load cell [N]. ``truth`` has arrays of the same shape:
    ``tension_n`` and ``contact_force_n`` [N], and ``bend_rad`` [rad]. If requested, it also has
    ``modes_rad`` of shape (trials, samples, 3). ``failed_at_s`` of shape (trials,) is the time at
    which the solver found no balance for a trial [s], after which its values are NaN; or NaN.
    """

    sample_times_s: FloatArray
    sensed_n: FloatArray
    truth: Mapping[str, FloatArray]
    failed_at_s: FloatArray


def simulate_trials(
    protocol: str,
    object_label: str,
    contact: str,
    timeline: Timeline,
    count: int,
    seed: int,
    *,
    session: int = 0,
    first: int = 0,
    trials_per_mounting: int = 1,
    catalogue: Catalogue | None = None,
) -> SimulatedTrials:
    """Simulate trials ``first`` to ``first + count - 1`` of one object in one session.

    Each trial depends only on (seed, session, protocol, contact, object, trial number) and on
    ``trials_per_mounting``; see `draw_variation`.

    Raises `DescriptionError` for an unknown protocol, object or contact, or when the timeline does
    not fit the rig. Raises `ConvergenceError` when the finger has no state of rest at the start.
    """
    if count < 1 or first < 0 or session < 0 or seed < 0:
        raise DescriptionError(
            f'count is {count}, first {first}, session {session}, seed {seed}; '
            'count must be at least 1, and the others at least 0'
        )
    catalogue = catalogue or default_catalogue()
    scene = build_scene(protocol, object_label, contact, catalogue)
    variation, generators = draw_variation(
        catalogue,
        contact,
        protocol,
        object_label,
        seed,
        session,
        count,
        first,
        trials_per_mounting,
    )
    # Phases are rounded so that samples coincide with ends of time steps while an axis moves.
    # These samples need no interpolation.
    phase = np.floor(variation.phase * STEPS_PER_SAMPLE) / STEPS_PER_SAMPLE
    motion = simulate_motion(scene, timeline, replace(variation, phase=phase))
    tension_n = read_tension(
        scene.rig.load_cell, motion.sensed_n, variation.sensor_bias_n, generators
    )
    return SimulatedTrials(tension_n, motion.sample_times_s, motion.truth, motion.failed_at_s)


def simulate_motion(
    scene: Scene,
    timeline: Timeline,
    variation: Variation,
    steps_per_sample: int = STEPS_PER_SAMPLE,
    keep_modes: bool = False,
    trusted_nm: float = TRUSTED_NM,
) -> SimulatedMotion:
    """Simulate trials with given variations, without the errors of the load cell.

    ``steps_per_sample`` is the number of time steps per sample while an axis moves. While the axes
    rest, there are an eighth as many steps, but at least one. If ``trusted_nm`` is 0, the residual
    of every step is checked; see `advance_trials`.

    Raises `DescriptionError` when the timeline does not fit the rig, and `ConvergenceError` when
    the finger has no state of rest at the start.
    """
    schedule = _Schedule(scene, timeline, steps_per_sample)
    rows = _ROWS + _MODE_ROWS if keep_modes else _ROWS
    parts = []
    for begin in range(0, len(variation.phase), _BATCH):
        some = variation.select(slice(begin, begin + _BATCH))
        parts.append(_run_batch(scene, schedule, some, rows, trusted_nm))
    sampled = np.concatenate([part[0] for part in parts], axis=1)
    failed_at_s = np.concatenate([part[1] for part in parts])
    failed = np.flatnonzero(np.isfinite(failed_at_s))
    for trial in failed:
        sampled[:, trial, schedule.sample_times_s > failed_at_s[trial]] = np.nan
    sensed_n, tension_n, force_n, bend_rad = sampled[:4]
    truth = {'tension_n': tension_n, 'contact_force_n': force_n, 'bend_rad': bend_rad}
    if keep_modes:
        truth['modes_rad'] = np.moveaxis(sampled[3:6], 0, -1)
    return SimulatedMotion(schedule.sample_times_s, sensed_n, truth, failed_at_s)


class _Schedule:
    """Time steps of a timeline, which are short while an axis moves and longer at rest."""

    def __init__(self, scene: Scene, timeline: Timeline, steps_per_sample: int) -> None:
        period_s = scene.rig.load_cell.period_s
        axes = plan_timeline(scene.rig, timeline)
        periods = int(timeline.duration_s / period_s + 1e-9)
        self.sample_times_s: FloatArray = period_s * np.arange(periods + 1, dtype=np.float64)
        moving = np.zeros(periods, dtype=bool)
        for axis in axes:
            for start_s, end_s in axis.busy_s:
                low, high = math.floor(start_s / period_s), (end_s + _SETTLING_S) / period_s
                moving[max(low, 0) : math.ceil(high)] = True
        resting = max(1, steps_per_sample * _RESTING_STEPS_PER_SAMPLE // STEPS_PER_SAMPLE)
        steps = np.where(moving, steps_per_sample, resting)
        self.lengths = np.repeat(np.where(moving, 0, 1), steps)
        lengths_s = np.array([period_s / steps_per_sample, period_s / resting])
        self.coefficients = scene.compute_coefficients(tuple(lengths_s))
        # Number of time steps before each sample period.
        self._before = np.concatenate([[0], np.cumsum(steps)])
        # Times are computed from the start of each period, so that rounding errors do not
        # accumulate.
        within = np.arange(len(self.lengths)) - np.repeat(self._before[:-1], steps)
        started_s = np.repeat(self.sample_times_s[:-1], steps)
        self.times_s = started_s + (within + 1) * lengths_s[self.lengths]
        guide, tendon = (axis.positions_at(self.times_s) for axis in axes)
        self.inputs = scene.compute_inputs(tendon, guide)
        guide, tendon = (axis.positions_at(np.zeros(1) - 1.0) for axis in axes)
        self.start = scene.compute_inputs(tendon, guide)[0]

    def locate_samples(self, phase: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the number of time steps before each sample, and the remaining part of a step.

        Both arrays have the shape (trials, samples). Sample i of a trial is taken ``i - phase``
        sample periods after the start of the timeline, but not before the start.
        """
        periods = len(self._before) - 1
        time = np.maximum(np.arange(periods + 1) - phase[:, np.newaxis], 0.0)
        period = np.minimum(time.astype(np.intp), periods - 1)
        steps = np.diff(self._before)[period]
        within = (time - period) * steps
        # Numbers that differ from whole numbers only by rounding errors are rounded.
        whole = np.rint(within)
        within = np.where(np.abs(within - whole) < 1e-9, whole, within)
        low = within.astype(np.intp)
        return self._before[period] + low, within - low


def _run_batch(
    scene: Scene,
    schedule: _Schedule,
    variation: Variation,
    rows: tuple[int, ...],
    trusted_nm: float,
) -> tuple[FloatArray, FloatArray]:
    """Simulate a batch of trials; return the values of ``rows`` at the samples.

    The result has the shape (rows, trials, samples). Also return the time at which the solver
    found no balance for each trial [s], or NaN.
    """
    count = len(variation.phase)
    failed = np.full(count, -1, dtype=np.int64)
    out = advance_trials(
        scene.start_trials(variation, schedule.start),
        scene.parameters,
        schedule.lengths,
        schedule.start,
        schedule.inputs,
        schedule.coefficients,
        rows,
        failed,
        trusted_nm=trusted_nm if scene.inertia else 0.0,
    )
    low, share = schedule.locate_samples(variation.phase)
    trial = np.arange(count)[:, np.newaxis]
    # Index of the first row at each sample in the flat result of the solver.
    place = ((trial // out.shape[3] * out.shape[1] + low) * out.shape[2]) * out.shape[3]
    place += trial % out.shape[3]
    between = np.flatnonzero(share)
    share, flat = share.ravel()[between], out.ravel()
    sampled = np.empty((len(rows), *place.shape))
    for row, values in enumerate(sampled):
        here = place + row * out.shape[3]
        np.take(flat, here, out=values)
        before = values.ravel()[between]
        after = flat[here.ravel()[between] + out.shape[2] * out.shape[3]]
        values.ravel()[between] = before + share * (after - before)
    times_s = np.concatenate([schedule.times_s, [np.nan]])
    return sampled, times_s[failed]


class ForeseenSteps(NamedTuple):
    """Time steps that `Plant.foresee` has computed in advance.

    ``states`` of shape (steps + 1, STATE_ROWS) are the states before the first step and after each
    step. It is shorter if the solver finds no balance in a step. ``tension_n`` and
    ``contact_force_n`` of shape (steps,) are the values after each step [N].
    """

    inputs: FloatArray
    states: FloatArray
    tension_n: FloatArray
    contact_force_n: FloatArray


class Plant:
    """The simulated finger in one trial, which is advanced by time steps of ``step_s`` [s].

    The finger is initially at rest, with the guide at ``guide_m`` and the tendon at ``tendon_m``
    [m].
    """

    def __init__(
        self, scene: Scene, variation: Variation, guide_m: float, tendon_m: float, step_s: float
    ) -> None:
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
        """Replace the scene, for another plate, object or finger, which is then at rest."""
        self._scene = scene
        self._inputs = scene.compute_inputs(np.array([tendon_m]), np.array([guide_m]))[0]
        self._state = scene.start_trials(variation, self._inputs, self._state)
        # Two equal step lengths, which `foresee` uses in turn. The solver then treats every step
        # as if the previous step had another length. Otherwise, the result of a step would depend
        # on whether it is the first one of a call.
        self._coefficients = scene.compute_coefficients((self._step_s, self._step_s))
        self._is_steady = False

    def is_steady_at(self, guide_m: float, tendon_m: float) -> bool:
        """Return True if time steps with the axes at these positions do not change the state."""
        return self._is_steady and self._steady_at_m == (guide_m, tendon_m)

    def step(self, guide_m: float, tendon_m: float) -> None:
        """Advance by one time step, at whose end guide and tendon are at these positions [m].

        Raises `ConvergenceError` when the solver finds no balance. The state is then unusable.
        """
        self.follow(self.foresee(np.array([guide_m]), np.array([tendon_m])), 1)

    def foresee(self, guide_m: FloatArray, tendon_m: FloatArray) -> ForeseenSteps:
        """Compute time steps in advance, without changing the state.

        At the end of each step, guide and tendon are at these positions; shape (steps,) [m].
        `follow` changes the state accordingly.
        """
        assert self._state is not None
        inputs = self._scene.compute_inputs(tendon_m, guide_m)
        count = len(inputs)
        failed = np.full(1, -1, dtype=np.int64)
        out = advance_trials(
            self._state.copy(),
            self._scene.parameters,
            np.arange(count) % 2,
            self._inputs,
            inputs,
            self._coefficients,
            _STATE,
            failed,
        )
        states = out[0, :, :, 0]
        solved = count if failed[0] < 0 else int(failed[0])
        return ForeseenSteps(
            inputs, states[: solved + 1], states[1:, at.TENSION], states[1:, at.FORCE]
        )

    def follow(self, steps: ForeseenSteps, count: int) -> None:
        """Advance the state by the first ``count`` steps that `foresee` has computed.

        Raises `ConvergenceError` when the solver found no balance in one of them.
        """
        assert self._state is not None
        states, inputs = steps.states, steps.inputs[:count]
        if count >= len(states):
            guide_m, tendon_m = inputs[len(states) - 1, [at.GUIDE_INPUT, at.TENDON_INPUT]]
            raise ConvergenceError(
                f'no balance of the finger with the guide at {guide_m:g} m and the tendon at '
                f'{tendon_m:g} m; a motion was too fast, or the description is extreme'
            )
        before = self._inputs if count == 1 else inputs[-2]
        # If a step with constant inputs changes no bit of the state, the next step with these
        # inputs does not change it either.
        self._is_steady = (
            states[count].tobytes() == states[count - 1].tobytes()
            and inputs[-1].tobytes() == before.tobytes()
        )
        self._state[: at.STATE_ROWS, 0] = states[count]
        self._inputs = inputs[-1]
        self._steady_at_m = (float(inputs[-1, at.GUIDE_INPUT]), float(inputs[-1, at.TENDON_INPUT]))

    def _read(self, row: int) -> float:
        assert self._state is not None
        return float(self._state[row, 0])
