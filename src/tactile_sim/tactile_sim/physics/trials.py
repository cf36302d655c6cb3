# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulation of trials: many in parallel, or one step by step together with its devices."""

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
"""Steps per sample of the sensor during motion. docs/benchmarks.md has errors of other values."""

TRUSTED_NM = 1e-2
"""Value of ``trusted_nm`` of `advance_trials` for scenes with inertia [N m]."""

_RESTING_STEPS_PER_SAMPLE = 2
_SETTLING_S = 0.1  # transients of the finger last about 20 ms
_BATCH = 64
_ROWS = (at.SENSED, at.TENSION, at.FORCE, at.MODES)
_MODE_ROWS = (at.MODES + 1, at.MODES + 2)
_STATE = tuple(range(at.STATE_ROWS))


@dataclass(frozen=True)
class SimulatedTrials:
    """Trials as recorded by the load cell.

    ``tension_n`` of shape (trials, samples) are the readings [N], NaN from the point where a trial
    found no balance. ``sample_times_s`` of shape (samples,) are relative to the start of the
    timeline, on the true clock [s]. For ``truth`` and ``failed_at_s`` see `SimulatedMotion`.
    """

    tension_n: FloatArray
    sample_times_s: FloatArray
    truth: Mapping[str, FloatArray]
    failed_at_s: FloatArray


@dataclass(frozen=True)
class SimulatedMotion:
    """The physics of trials, without the errors of the sensor.

    ``sensed_n`` of shape (trials, samples) is tension with crosstalk after the sensor's low pass
    [N]. ``truth`` has arrays of the same shape: ``tension_n`` and ``contact_force_n`` [N],
    ``bend_rad`` [rad]; if requested, ``modes_rad`` of shape (trials, samples, 3). ``failed_at_s``
    is NaN, or the time at which a trial found no balance [s]; its rows are NaN from then on.
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
    # Samples coincide with ends of steps during motion, so that they need no interpolation.
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
    """Return the physics of `simulate_trials` for given variations.

    While the axes rest, the number of steps per sample is an eighth, but at least one. If
    ``trusted_nm`` is 0, every step is solved to the tolerance.

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
    """Steps of a timeline: fine while an axis moves, coarse while all axes rest."""

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
        self._before = np.concatenate([[0], np.cumsum(steps)])  # steps before each period
        # Computed from whole periods, so that rounding errors do not accumulate.
        within = np.arange(len(self.lengths)) - np.repeat(self._before[:-1], steps)
        started_s = np.repeat(self.sample_times_s[:-1], steps)
        self.times_s = started_s + (within + 1) * lengths_s[self.lengths]
        guide, tendon = (axis.positions_at(self.times_s) for axis in axes)
        self.inputs = scene.compute_inputs(tendon, guide)
        guide, tendon = (axis.positions_at(np.zeros(1) - 1.0) for axis in axes)
        self.start = scene.compute_inputs(tendon, guide)[0]

    def locate_samples(self, phase: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the position of each sample: steps from the start, and a fraction of a step.

        The shape is (trials, samples). The sensor of a trial lags the motion by ``phase`` periods;
        its first sample is at rest.
        """
        periods = len(self._before) - 1
        time = np.maximum(np.arange(periods + 1) - phase[:, np.newaxis], 0.0)
        period = np.minimum(time.astype(np.intp), periods - 1)
        steps = np.diff(self._before)[period]
        within = (time - period) * steps
        # Rounded where only rounding errors keep the number from being whole.
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
    """Return sampled rows, shape (rows, trials, samples), and the failure time of each trial."""
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
    # Position of the first row of each sample in the solver's blocks.
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
    """Steps of a `Plant` that are computed, but not yet taken.

    ``states`` of shape (steps + 1, STATE_ROWS) ends before a step that finds no balance.
    ``tension_n`` and ``contact_force_n`` of shape (steps,) are the values after each step [N].
    """

    inputs: FloatArray
    states: FloatArray
    tension_n: FloatArray
    contact_force_n: FloatArray


class Plant:
    """State of one trial, advanced by ``step``; the finger starts at rest.

    Guide and tendon start at ``guide_m`` and ``tendon_m`` [m]; every step has the length
    ``step_s`` [s].
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
        """Change the plate, object or finger; the new scene starts at rest."""
        self._scene = scene
        self._inputs = scene.compute_inputs(np.array([tendon_m]), np.array([guide_m]))[0]
        self._state = scene.start_trials(variation, self._inputs, self._state)
        # Two equal lengths: a step of another length than the previous one does not use its
        # differences, and every step of a live trial could be the first of a call.
        self._coefficients = scene.compute_coefficients((self._step_s, self._step_s))
        self._is_steady = False

    def is_steady_at(self, guide_m: float, tendon_m: float) -> bool:
        """Return True if no step changes the state while guide and tendon stay there."""
        return self._is_steady and self._steady_at_m == (guide_m, tendon_m)

    def step(self, guide_m: float, tendon_m: float) -> None:
        """Take one step, at whose end guide and tendon are at these positions.

        Raises `ConvergenceError` when no balance was found; the state is unusable afterwards.
        """
        self.follow(self.foresee(np.array([guide_m]), np.array([tendon_m])), 1)

    def foresee(self, guide_m: FloatArray, tendon_m: FloatArray) -> ForeseenSteps:
        """Compute steps, at whose ends guide and tendon are at these positions; shape (steps,)
        [m].

        The state does not change until `follow`.
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
        """Take the first ``count`` computed steps.

        Raises `ConvergenceError` when one of them found no balance.
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
        # Bits are compared: if a step with constant inputs changes no bit, neither does the next
        # step with these inputs.
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
