# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator beside a chain of hinges in MuJoCo: how far apart, at which speeds."""

from __future__ import annotations

import dataclasses
from functools import lru_cache, partial
import math

import numpy as np
from scipy.signal import lfilter

from benchmarks.measuring import Report, Row
from benchmarks.simulator.mujoco_twin import (
    compute_chain_tip,
    import_mujoco,
    MujocoMissingError,
    simulate_twin,
    TwinContact,
    TwinResult,
)
from benchmarks.simulator.trials import (
    compare,
    cut_after_window,
    draw_trials,
    FloatArray,
    name_choice,
    PLATES,
    remove_mean,
    time_in_turns,
)
from tactile_sim.physics.fast_trials import simulate_motion, STEPS_PER_SAMPLE
from tactile_sim.physics.finger.steps import BDF2
from tactile_sim.physics.motion import Motion
from tactile_sim.physics.scene import Scene
from tactile_sim.physics.sensing import low_pass_coefficients
from tactile_sim.physics.timeline import plan_timeline, Timeline
from tactile_sim.physics.variation import Variation

DENSE = STEPS_PER_SAMPLE
"""Comparisons take so many values a sample: the grooves pass in whole numbers of samples, so
that samples alone would look at the same few places of each groove."""

REFERENCE_STEPS = 16
FINE_S = 5e-5
SPEED_STEPS_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
SPEED_FINE_S = 2e-5
OUR_FACTORS = (1, 2, 3, 4, 6)
"""Of the default number of steps."""

BATCH = 64
DAMPERS_N_S_M = (0.0, 5.0, 10.0, 20.0, 50.0)
"""Beside the packaged one, for information."""


@dataclasses.dataclass(frozen=True, eq=False)
class Tensions:
    """The window of one trial: tension, and what the sensor gets [N]; shape (samples,)."""

    tension_n: FloatArray
    sensed_n: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Match:
    """One texture trial at settings that both sides know.

    Attributes
    ----------
    scene
        Without tendon friction and creep.
    timeline
        To the end of the window.
    window
        Which values belong to it, at `DENSE` a sample.
    """

    scene: Scene
    timeline: Timeline
    window: slice

    @property
    def times_s(self) -> FloatArray:
        """Times of the window's values [s]."""
        values = np.arange(self.window.start, self.window.stop)
        return np.asarray(self.scene.rig.load_cell.period_s / DENSE * values, dtype=np.float64)

    @property
    def axes(self) -> tuple[Motion, Motion]:
        """Guide and tendon."""
        guide, tendon, _ = plan_timeline(self.scene.rig, self.timeline)
        return guide, tendon

    def swing(self, inertia: bool) -> Match:
        """Return the trial of a finger with inertia or without."""
        return dataclasses.replace(self, scene=dataclasses.replace(self.scene, inertia=inertia))

    def compute_window(self, steps: int) -> Tensions:
        """Ours in the window, with so many steps a value."""
        cell = self.scene.rig.load_cell
        fast = dataclasses.replace(cell, rate_hz=DENSE * cell.rate_hz)
        rig = dataclasses.replace(self.scene.rig, load_cell=fast)
        scene = dataclasses.replace(self.scene, rig=rig)
        motion = simulate_motion(
            scene, self.timeline, Variation.none(), scheme=BDF2, steps_per_sample=steps
        )
        tension_n = motion.truth['tension_n'][0, self.window]
        return Tensions(tension_n, motion.sensed_n[0, self.window])

    def simulate_twin(self, step_s: float, hinges: int = 11, inertia: float = 1.0) -> TwinResult:
        """MuJoCo's; the plate lies under the chain as it lies under the arc."""
        finger = self.scene.finger
        drop_m, reach_m = compute_chain_tip(finger, math.radians(finger.contact_bend_deg), hinges)
        offset_m = self.scene.lead_m - self.scene.guide_m - reach_m
        assert self.scene.surface is not None
        contact = TwinContact(self.scene.surface, drop_m, offset_m, self.scene.friction)
        guide, tendon = (axis.positions_at for axis in self.axes)
        duration_s = self.timeline.duration_s
        return simulate_twin(
            finger, contact, guide, tendon, duration_s, step_s, hinges, inertia_scale=inertia
        )

    def sample_twin(self, twin: TwinResult) -> Tensions:
        """MuJoCo's in the window, behind the same sensor."""
        cell = self.scene.rig.load_cell
        step_s = float(twin.times_s[1] - twin.times_s[0])
        keep, early, late = low_pass_coefficients(step_s, cell.low_pass_hz)
        carried_n = twin.tension_n + cell.crosstalk * twin.contact_force_n
        sensed_n = lfilter([late, early], [1.0, -keep], carried_n)
        return Tensions(
            np.interp(self.times_s, twin.times_s, twin.tension_n),
            np.interp(self.times_s, twin.times_s, sensed_n),
        )


@lru_cache
def match_trial(plate: str, tip_damping_n_s_m: float | None = None) -> Match:
    """Plan a flexion trial on a plate, with another damper at the tip if asked for."""
    trials = draw_trials('texture', plate, 'flexion', 1)
    finger = dataclasses.replace(
        trials.scene.finger, tendon_friction=0.0, creep_stiffness_nm_rad=0.0
    )
    if tip_damping_n_s_m is not None:
        finger = dataclasses.replace(finger, tip_damping_n_s_m=tip_damping_n_s_m)
    scene = dataclasses.replace(trials.scene, finger=finger)
    timeline = cut_after_window(trials.planned, trials.window)
    window = slice(DENSE * trials.window.start, DENSE * trials.window.stop)
    return Match(scene, timeline, window)


def _compare_row(case: str, ours: Tensions, other: Tensions) -> Row:
    """Difference of ours from the other's."""
    own, others = ours.tension_n, other.tension_n
    more = {
        'mean N': float(others.mean()),
        'rms mN': float(1e3 * others.std()),
        'mean %': float(100 * abs(own.mean() / others.mean() - 1)),
    }
    difference = compare(remove_mean(ours.sensed_n), remove_mean(other.sensed_n))
    more['sensed %'] = float(difference)
    return Row(case, error=float(compare(remove_mean(own), remove_mean(others))), more=more)


def run_twin(quick: bool) -> Report:
    """Compare with MuJoCo at matched settings."""
    title = 'twin: tension of the simulator against a chain of hinges in MuJoCo'
    try:
        import_mujoco()
    except MujocoMissingError as error:
        return Report(f'{title}: not measured', str(error), 'none', [])
    fine_s = 2 * FINE_S if quick else FINE_S
    plates = ('R3',) if quick else PLATES
    rows = []
    for hinges in (11, 22):
        for plate in plates:
            match = match_trial(plate)
            chain = match.sample_twin(match.simulate_twin(fine_s, hinges))
            for name, steps, inertia in (
                ('default steps', 1, True),
                ('fine steps', REFERENCE_STEPS, True),
                ('without inertia, fine steps', REFERENCE_STEPS, False),
            ):
                ours = match.swing(inertia).compute_window(steps)
                rows.append(_compare_row(f'{plate}, {hinges} hinges, {name}', ours, chain))
    for damping_n_s_m in DAMPERS_N_S_M:
        for plate in plates:
            match = match_trial(plate, damping_n_s_m)
            # Of 22 hinges: 11 are themselves some 5 to 10 % off on these plates.
            chain = match.sample_twin(match.simulate_twin(2 * FINE_S, 22))
            case = f'{plate}, 22 hinges, damper {damping_n_s_m:g} N s/m'
            rows.append(_compare_row(case, match.compute_window(REFERENCE_STEPS), chain))
    return Report(
        title,
        'none; the goals set before: mean within 0.2 %, alternating part within 5 %',
        'rms deviation of the alternating part of the tension in the window over its rms, '
        'in %; sensed: the same behind crosstalk and low pass; flexion, without tendon friction '
        'and creep; the damper at the tip is that of the description where none is named',
        rows,
    )


@dataclasses.dataclass(frozen=True)
class Speed:
    """One simulator with one step.

    Attributes
    ----------
    case, short
        Its name; its step.
    percent, sensed_percent
        Largest error over the plates, against finer steps of its own: of the tension's
        alternating part, and of what the sensor gets [%].
    trial_s
        Time of a trial [s of one core].
    alone_s
        Of mj_step alone [s]; None for ours.
    """

    case: str
    short: str
    percent: float
    sensed_percent: float
    trial_s: float
    alone_s: float | None = None


def _compare_largest(found: list[Tensions], reference: list[Tensions]) -> tuple[float, float]:
    pairs = list(zip(found, reference, strict=True))
    tension = [compare(remove_mean(a.tension_n), remove_mean(b.tension_n)) for a, b in pairs]
    sensed = [compare(remove_mean(a.sensed_n), remove_mean(b.sensed_n)) for a, b in pairs]
    return float(max(tension)), float(max(sensed))


def measure_our_speeds(quick: bool) -> list[Speed]:
    """Measure ours, in a batch of drawn trials, with the default step and shorter ones."""
    matches = [match_trial(plate) for plate in (('R3',) if quick else PLATES)]
    reference = [match.compute_window(REFERENCE_STEPS) for match in matches]
    drawn = draw_trials('texture', 'R3', 'flexion', BATCH).variation
    scene, timeline = match_trial('R3').scene, match_trial('R3').timeline
    works = [
        partial(simulate_motion, scene, timeline, drawn, steps_per_sample=factor * DENSE)
        for factor in OUR_FACTORS
    ]
    times_s = time_in_turns(works, 5 if quick else 20).min(axis=1) / BATCH
    speeds = []
    for factor, trial_s in zip(OUR_FACTORS, times_s.tolist(), strict=True):
        largest = _compare_largest([match.compute_window(factor) for match in matches], reference)
        case = f'ours, {name_choice(BDF2, factor * DENSE)}'
        speeds.append(Speed(case, f'{factor * DENSE}', *largest, trial_s))
    return speeds


def measure_twin_speeds(quick: bool) -> list[Speed]:
    """Measure MuJoCo's error and time by its step.

    Raises
    ------
    MujocoMissingError
        MuJoCo is not installed.
    """
    matches = [match_trial(plate) for plate in (('R3',) if quick else PLATES)]
    reference = [match.sample_twin(match.simulate_twin(SPEED_FINE_S)) for match in matches]
    speeds = []
    for step_s in SPEED_STEPS_S:
        twins = [match.simulate_twin(step_s) for match in matches]
        found = [match.sample_twin(twin) for match, twin in zip(matches, twins, strict=True)]
        speeds.append(
            Speed(
                f'MuJoCo, {1e3 * step_s:g} ms',
                f'{1e3 * step_s:g} ms',
                *_compare_largest(found, reference),
                min(twin.elapsed_s for twin in twins),
                min(twin.step_elapsed_s for twin in twins),
            )
        )
    return speeds


def run_twin_speed(quick: bool) -> Report:
    """Compare speeds at equal errors."""
    title = 'twin-speed: MuJoCo against the compiled batch'
    try:
        import_mujoco()
    except MujocoMissingError as error:
        return Report(f'{title}: not measured', str(error), 'none', [])
    ours = measure_our_speeds(quick)
    rows = []
    for speed in ours + measure_twin_speeds(quick):
        more = {
            'sensed %': speed.sensed_percent,
            'ms a trial': 1e3 * speed.trial_s,
            'over default': speed.trial_s / ours[0].trial_s,
        }
        if speed.alone_s is not None:
            more['mj_step over default'] = speed.alone_s / ours[0].trial_s
        rows.append(Row(speed.case, error=speed.percent, more=more))
    return Report(
        title,
        f'ours with the default step, a batch of {BATCH} drawn trials on R3; mj_step: as many '
        'steps of MuJoCo alone in one call, without contact and without what Python adds. MuJoCo '
        'has 11 degrees of freedom with inertia and runs one trial; ours has 3 modes',
        'largest over the plates of the rms deviation of the alternating part of the tension in '
        f'the window, {DENSE} values a sample, from finer steps of the same simulator, over its '
        'rms, in %; sensed: the same of what the sensor gets',
        rows,
    )
