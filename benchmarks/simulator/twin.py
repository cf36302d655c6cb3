# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparison of this simulator with MuJoCo, in which the finger is a chain of hinges.

The deviation of the tension and the speed are measured.

Requires ``pip install mujoco`` in the workspace's environment.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache, partial
import math
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from benchmarks.measuring import Report, Row
from benchmarks.simulator.mujoco_twin import (
    compute_chain_tip,
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
from tactile_sim.physics.motion import plan_timeline, Timeline
from tactile_sim.physics.scene import Scene
from tactile_sim.physics.sensing import low_pass_coefficients
from tactile_sim.physics.trials import simulate_motion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import Variation

DENSE = STEPS_PER_SAMPLE
"""Number of compared values per sample. The period of the grooves is a whole number of samples, so
comparing only samples would test the same few positions of each groove."""

HINGES, FEW_HINGES = 22, 11
"""Numbers of hinges of the finger in MuJoCo: the first for the comparison of tensions, the second
for the comparison of speeds."""

REFERENCE_STEPS = 16
FINE_S = 5e-5
SPEED_STEPS_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
SPEED_FINE_S = 2e-5
OUR_FACTORS = (1, 2, 3, 4, 6)
"""Numbers of steps per sample in the comparison of speeds, as multiples of the default."""

BATCH = 64


class Tensions(NamedTuple):
    """Tension, and signal that the sensor receives, in the window of one trial [N].

    Both have the shape (samples,).
    """

    tension_n: FloatArray
    sensed_n: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Match:
    """One flexion trial up to the end of its window, with settings that both simulators support.

    The scene has no tendon friction and no creep. The indices of ``window`` count `DENSE` values
    per sample.
    """

    scene: Scene
    timeline: Timeline
    window: slice

    def compute_window(self, factor: int, *, inertia: bool = True) -> Tensions:
        """Simulate the trial with a multiple of the default number of steps; return the window."""
        cell = self.scene.rig.load_cell
        fast = dataclasses.replace(cell, rate_hz=DENSE * cell.rate_hz)
        rig = dataclasses.replace(self.scene.rig, load_cell=fast)
        scene = dataclasses.replace(self.scene, rig=rig, inertia=inertia)
        motion = simulate_motion(scene, self.timeline, Variation.none(), steps_per_sample=factor)
        tension_n = motion.truth['tension_n'][0, self.window]
        return Tensions(tension_n, motion.sensed_n[0, self.window])

    def simulate_twin(self, step_s: float, hinges: int = FEW_HINGES) -> TwinResult:
        """Simulate the trial in MuJoCo, with the same position of the plate under the tip."""
        finger = self.scene.finger
        drop_m, reach_m = compute_chain_tip(finger, math.radians(finger.contact_bend_deg), hinges)
        offset_m = self.scene.lead_m - self.scene.guide_m - reach_m
        assert self.scene.surface is not None
        contact = TwinContact(self.scene.surface, drop_m, offset_m, self.scene.friction)
        guide, tendon = plan_timeline(self.scene.rig, self.timeline)
        return simulate_twin(
            finger,
            contact,
            guide.positions_at,
            tendon.positions_at,
            self.timeline.duration_s,
            step_s,
            hinges,
        )

    def sample_twin(self, twin: TwinResult) -> Tensions:
        """Return the window of a MuJoCo trial, with the sensor of this simulator."""
        cell = self.scene.rig.load_cell
        step_s = float(twin.times_s[1] - twin.times_s[0])
        keep, early, late = low_pass_coefficients(step_s, cell.low_pass_hz)
        carried_n = twin.tension_n + cell.crosstalk * twin.contact_force_n
        sensed_n = lfilter([late, early], [1.0, -keep], carried_n)
        values = np.arange(self.window.start, self.window.stop)
        times_s = cell.period_s / DENSE * values
        return Tensions(
            np.interp(times_s, twin.times_s, twin.tension_n),
            np.interp(times_s, twin.times_s, sensed_n),
        )


@lru_cache
def match_trial(plate: str) -> Match:
    """Plan a flexion trial on a plate."""
    trials = draw_trials('texture', plate, 'flexion', 1)
    finger = dataclasses.replace(
        trials.scene.finger, tendon_friction=0.0, creep_stiffness_nm_rad=0.0
    )
    scene = dataclasses.replace(trials.scene, finger=finger)
    timeline = cut_after_window(trials.planned, trials.window)
    window = slice(DENSE * trials.window.start, DENSE * trials.window.stop)
    return Match(scene, timeline, window)


def run_twin(quick: bool) -> Report:
    """Compare the tension of this simulator with the tension of MuJoCo."""
    fine_s = 2 * FINE_S if quick else FINE_S
    rows = []
    for plate in _choose_plates(quick):
        match = match_trial(plate)
        chain = match.sample_twin(match.simulate_twin(fine_s, HINGES))
        for name, factor, inertia in (
            ('default steps', 1, True),
            ('without inertia, fine steps', REFERENCE_STEPS, False),
        ):
            ours = match.compute_window(factor, inertia=inertia)
            tension, sensed = _compare_largest([ours], [chain])
            rows.append(Row(f'{plate}, {name}', error=tension, more={'sensed %': sensed}))
    return Report(
        f'twin: tension of the simulator against a chain of {HINGES} hinges in MuJoCo',
        '',
        'rms deviation of the alternating part of the tension in the window, relative to its rms, '
        'in %; sensed: the same after crosstalk and low pass; flexion, without tendon friction '
        'and creep',
        rows,
    )


def run_twin_speed(quick: bool) -> Report:
    """Measure speed and error of this simulator and of MuJoCo, for several lengths of the step."""
    matches = [match_trial(plate) for plate in _choose_plates(quick)]
    rows, default_s = _measure_ours(matches, quick)
    reference = [match.sample_twin(match.simulate_twin(SPEED_FINE_S)) for match in matches]
    for step_s in SPEED_STEPS_S:
        twins = [match.simulate_twin(step_s) for match in matches]
        found = [match.sample_twin(twin) for match, twin in zip(matches, twins, strict=True)]
        more = {'mj_step over default': min(twin.step_elapsed_s for twin in twins) / default_s}
        trial_s = min(twin.elapsed_s for twin in twins)
        case = f'MuJoCo, {1e3 * step_s:g} ms'
        rows.append(_speed_row(case, found, reference, trial_s, default_s, more))
    return Report(
        'twin-speed: MuJoCo against the compiled batch',
        f'this simulator with the default step, a batch of {BATCH} random trials on R3; mj_step: '
        'the same number of MuJoCo steps in one call, without contact and Python overhead. MuJoCo '
        'has 11 degrees of freedom with inertia and runs one trial; this simulator has 3 modes',
        'largest rms deviation over the plates, relative to the rms, of the alternating part of '
        f'the tension in the window, {DENSE} values per sample, from finer steps of the same '
        'simulator, in %; sensed: the same for the input of the sensor',
        rows,
    )


def _choose_plates(quick: bool) -> tuple[str, ...]:
    return ('R3',) if quick else PLATES


def _measure_ours(matches: list[Match], quick: bool) -> tuple[list[Row], float]:
    """Measure this simulator with each of `OUR_FACTORS`.

    Return the rows of the report, and the time of a trial with the default step [s].
    """
    match = match_trial('R3')
    drawn = draw_trials('texture', 'R3', 'flexion', BATCH).variation
    works = [
        partial(simulate_motion, match.scene, match.timeline, drawn, steps_per_sample=n * DENSE)
        for n in OUR_FACTORS
    ]
    times_s = (time_in_turns(works, 5 if quick else 20).min(axis=1) / BATCH).tolist()
    reference = [match.compute_window(REFERENCE_STEPS) for match in matches]
    rows = []
    for factor, trial_s in zip(OUR_FACTORS, times_s, strict=True):
        found = [match.compute_window(factor) for match in matches]
        case = f'ours, {name_choice(factor * DENSE)}'
        rows.append(_speed_row(case, found, reference, trial_s, times_s[0], {}))
    return rows, times_s[0]


def _speed_row(
    case: str,
    found: list[Tensions],
    reference: list[Tensions],
    trial_s: float,
    default_s: float,
    more: dict[str, float],
) -> Row:
    tension, sensed = _compare_largest(found, reference)
    columns = {
        'sensed %': sensed,
        'ms a trial': 1e3 * trial_s,
        'over default': trial_s / default_s,
    }
    return Row(case, error=tension, more=columns | more)


def _compare_largest(found: list[Tensions], reference: list[Tensions]) -> tuple[float, float]:
    """Return the largest error of the tension and of the sensor's input over all plates [%]."""
    pairs = list(zip(found, reference, strict=True))
    tension = [compare(remove_mean(a.tension_n), remove_mean(b.tension_n)) for a, b in pairs]
    sensed = [compare(remove_mean(a.sensed_n), remove_mean(b.sensed_n)) for a, b in pairs]
    return float(max(tension)), float(max(sensed))
