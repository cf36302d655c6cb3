# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator where descriptions are extreme and steps are far too long.

Run by the NumPy solver, which gives the same bytes as the compiled one, so that steps that were
cut into parts can be counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import dataclasses
from dataclasses import dataclass, field
import math
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.measuring import Report, Row
from benchmarks.simulator.trials import (
    compare,
    cut_after_window,
    draw_trials,
    find_window,
    FloatArray,
    remove_line,
)
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.fast_trials import (
    simulate_motion,
    SimulatedMotion,
    STEPS_PER_SAMPLE,
    TRUSTED_NM,
)
from tactile_sim.physics.finger import layout as at
from tactile_sim.physics.finger import numpy_solver
from tactile_sim.physics.finger.bent_line import compute_line
from tactile_sim.physics.finger.solver import advance_trials, TOLERANCE_NM
from tactile_sim.physics.finger.steps import BDF2, split_inputs
from tactile_sim.physics.scene import Scene
from tactile_sim.physics.surface import build_plate_surface
from tactile_sim.physics.timeline import Move, plan_timeline, Timeline
from tactile_sim.physics.variation import Variation

PLATE = 'R3'
REFERENCE_STEPS = 160
HOLD_S = 600.0
RELEASE_M_S = 0.048
SINGLE_TOLERANCES_NM = (TOLERANCE_NM, 1e-6, 1e-5)
"""Single precision may leave more than the default: a rounding of the bend is 1e-7 rad."""


@dataclass
class Halvings:
    """Counts steps that were cut into parts.

    Attributes
    ----------
    steps
        Cut at least once.
    """

    steps: int = 0
    _last_share: float = field(default=1.0, repr=False)

    def split(self, before: Any, after: Any, share: float, out: Any) -> None:
        """As `steps.split_inputs`, which solvers call for every part of a step."""
        # The first half of a step that follows a whole one: it was just found to need halving.
        self.steps += share == 0.5 and self._last_share == 1.0
        self._last_share = share
        split_inputs(before, after, share, out)


@contextmanager
def count_halvings() -> Iterator[Halvings]:
    """Count what the NumPy solver cuts."""
    halvings = Halvings()
    with patch.object(numpy_solver, 'split_inputs', halvings.split):
        yield halvings


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes
    ----------
    name
    scene, timeline, variation
        What is simulated.
    window
        Samples that are compared.
    reference_steps
        Steps a sample of what it is compared with.
    """

    name: str
    scene: Scene
    timeline: Timeline
    variation: Variation
    window: slice
    reference_steps: int = REFERENCE_STEPS

    def simulate(self, steps: int, solver: str) -> SimulatedMotion:
        """Simulate it."""
        return simulate_motion(self.scene, self.timeline, self.variation, solver, BDF2, steps)


def run_hard_cases(quick: bool) -> Report:
    """Run each case and compare it with finer steps of the same case."""
    trials = draw_trials('texture', PLATE, 'flexion', 2 if quick else 8)
    timeline = cut_after_window(trials.planned, trials.window)
    plain = Case('as described', trials.scene, timeline, trials.variation, trials.window)
    rows = [_run_case(case) for case in _make_cases(plain)]
    rows += [_run_case(_release(label, 2 if quick else 8)) for label in ('pla', 'sponge')]
    rows += [_run_case(_hold(), 'compiled'), _run_slack(plain)]
    rows += [_run_long_steps(plain, factor) for factor in (10, 100, 1000)]
    rows += [_run_single_precision(plain, tolerance_nm) for tolerance_nm in SINGLE_TOLERANCES_NM]
    return Report(
        f'hard cases: drawn texture trials on {PLATE} in flexion unless it says otherwise; '
        f'{STEPS_PER_SAMPLE} steps a sample',
        'none; cut: steps of the batch that were cut into parts; failed: trials that found no '
        'balance and say when; silent: trials with impossible values that do not say so',
        f'rms deviation of the tension in the window from {REFERENCE_STEPS} steps a sample (held: '
        '40) over its rms, both without their straight line, largest of the trials, in %; long '
        'steps: at their ends, from the start of the trial, with mean and line; single precision: '
        'from double',
        rows,
    )


def _make_cases(plain: Case) -> list[Case]:
    finger = plain.scene.finger
    cases = [plain]
    for factor in (0.1, 10.0, 100.0, 1000.0):
        stiffness = factor * finger.tip_stiffness_n_m
        cases.append(_vary(plain, f'contact x{factor:g}', tip_stiffness_n_m=stiffness))
    rigid = {'tip_stiffness_n_m': 1000 * finger.tip_stiffness_n_m, 'tip_damping_n_s_m': 0.0}
    cases.append(_vary(plain, 'contact x1000, no damper', **rigid))
    shear = 1000 * finger.tip_shear_stiffness_n_m
    cases.append(_vary(plain, 'shear spring x1000', tip_shear_stiffness_n_m=shear))
    presliding = 1e-3 * finger.tendon_presliding_m
    cases.append(_vary(plain, 'presliding x0.001', tendon_presliding_m=presliding))
    cases.append(_vary(plain, 'no friction of the tendon', tendon_friction=0.0))
    smooth = dataclasses.replace(plain.variation, friction=np.zeros_like(plain.variation.friction))
    cases.append(dataclasses.replace(plain, name='no friction at the tip', variation=smooth))
    return [*cases, _meet_corners(plain), _widen_tip(plain)]


def _vary(plain: Case, name: str, **changes: float) -> Case:
    finger = dataclasses.replace(plain.scene.finger, **changes)
    scene = dataclasses.replace(plain.scene, finger=finger)
    return dataclasses.replace(plain, name=name, scene=scene)


def _meet_corners(plain: Case) -> Case:
    """Place the plates so that a sample falls where the tip changes from edge to edge.

    The grooves pass in whole numbers of samples, so that it does so in each of them.
    """
    scene, finger = plain.scene, plain.scene.finger
    guide = plan_timeline(scene.rig, plain.timeline)[0]
    bend_rad = math.radians(finger.contact_bend_deg)
    reach_m = finger.length_m * math.sin(bend_rad) / bend_rad
    sample = (plain.window.start + plain.window.stop) // 2
    when_s = np.array([sample * scene.rig.load_cell.period_s])
    clamp_m = scene.lead_m - reach_m - scene.guide_m + float(guide.positions_at(when_s)[0])
    plate = default_catalogue().plate(PLATE)
    shift_m = 0.0
    for _ in range(4):  # the tip's reach depends a little on where it is on the groove
        variation = dataclasses.replace(Variation.none(), placement_m=np.array([shift_m]))
        motion = simulate_motion(
            scene, plain.timeline, variation, steps_per_sample=REFERENCE_STEPS, keep_modes=True
        )
        q0, q1, q2 = motion.truth['modes_rad'][0, sample]
        line = compute_line(q0, q1, q2, finger.mass_kg, finger.tip_mass_kg)
        along_m = clamp_m + shift_m + finger.length_m * float(line[1]) - 1e-3 * plate.end_mm
        pitch_m = 1e-3 * plate.pitch_mm
        shift_m += pitch_m / 2 - along_m % pitch_m
    variation = dataclasses.replace(Variation.none(), placement_m=np.array([shift_m]))
    return dataclasses.replace(plain, name='corner of a groove at a sample', variation=variation)


def _widen_tip(plain: Case) -> Case:
    """A tip of 50 mm over grooves of 1.5 mm."""
    case = _vary(plain, 'tip of 50 mm, grooves of 1.5 mm', tip_radius_m=0.050)
    plate, depth_m = default_catalogue().plate(PLATE), case.scene.rig.placement.tray_depth_m
    surface = build_plate_surface(plate, case.scene.finger.tip_radius_m, depth_m)
    return dataclasses.replace(case, scene=dataclasses.replace(case.scene, surface=surface))


def _release(label: str, count: int) -> Case:
    """Wind in and release as fast as the rig can."""
    trials = draw_trials('stiffness', label, 'flexion', count)
    pull_m = TrialConfig().flexion_displacement_m
    moves = [Move(0.2, pull_m, RELEASE_M_S), Move(1.0, 0.0, RELEASE_M_S)]
    timeline = Timeline([], moves, 1.6)
    name = f'{label}, wound in and released at {1e3 * RELEASE_M_S:g} mm/s'
    return Case(name, trials.scene, timeline, trials.variation, slice(12, None))


def _hold() -> Case:
    """Ten minutes on the object whose force relaxes most."""
    trials = draw_trials('stiffness', 'rubber_shell', 'flexion', 1)
    planned = plan_trial(TrialConfig(hold_s=HOLD_S), TrialRequest('stiffness', 'flexion'))
    return Case(
        'rubber_shell, held for 10 minutes',
        trials.scene,
        planned.timeline,
        trials.variation,
        find_window('stiffness', planned),
        reference_steps=40,
    )


def _run_case(case: Case, solver: str = 'numpy') -> Row:
    with count_halvings() as halvings:
        motion = case.simulate(STEPS_PER_SAMPLE, solver)
    fine = case.simulate(case.reference_steps, 'compiled')
    ours, reference = (m.truth['tension_n'][:, case.window] for m in (motion, fine))
    force_n = motion.truth['contact_force_n'][:, case.window]
    more = {
        'trials': len(ours),
        'cut': halvings.steps if solver == 'numpy' else None,
        **_judge(ours, force_n, motion.failed_at_s),
    }
    return Row(case.name, error=_compare_good(ours, reference), more=more)


def _judge(tension_n: FloatArray, force_n: FloatArray, failed_at_s: FloatArray) -> dict[str, int]:
    """Count trials that failed and said so, and wrong ones that did not."""
    said = np.isfinite(failed_at_s)
    possible = np.isfinite(tension_n) & (tension_n >= 0.0) & (force_n >= 0.0)
    return {'failed': int(said.sum()), 'silent': int((~said & ~possible.all(axis=1)).sum())}


def _compare_good(ours: FloatArray, reference: FloatArray) -> float | None:
    good = np.isfinite(ours).all(axis=1) & np.isfinite(reference).all(axis=1)
    if not good.any():
        return None
    return float(compare(remove_line(ours[good]), remove_line(reference[good])).max())


def _run_slack(plain: Case) -> Row:
    """A tendon that is too long by 20 mm: its tension must be 0 throughout."""
    loose = dataclasses.replace(
        plain.variation, tendon_zero_m=np.full_like(plain.variation.tendon_zero_m, 0.02)
    )
    with count_halvings() as halvings:
        motion = dataclasses.replace(plain, variation=loose).simulate(STEPS_PER_SAMPLE, 'numpy')
    tension_n, force_n = motion.truth['tension_n'], motion.truth['contact_force_n']
    judged = _judge(tension_n, force_n, motion.failed_at_s)
    more = {'trials': len(tension_n), 'cut': halvings.steps, **judged}
    return Row(
        'slack tendon: largest tension [N]', None, float(np.abs(tension_n).max()), 0.0, more=more
    )


def _advance(
    case: Case,
    step_s: float,
    dtype: Any = np.float64,
    tolerance_nm: float = TOLERANCE_NM,
    trusted_nm: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Even steps by the NumPy solver: times, tension, normal force, and when trials failed."""
    scene = case.scene
    axes = plan_timeline(scene.rig, case.timeline)
    times_s = np.asarray(
        step_s * np.arange(1, int(case.timeline.duration_s / step_s) + 1), dtype=np.float64
    )
    guide, tendon, _ = (axis.positions_at(times_s) for axis in axes)
    rest = [axis.positions_at(np.array([-1.0])) for axis in axes]
    start = scene.compute_inputs(rest[1], rest[0])[0]
    failed = np.full(len(case.variation.phase), -1, dtype=np.int64)
    out = advance_trials(
        'numpy',
        scene.start_trials('numpy', case.variation, start).astype(dtype),
        scene.parameters,
        np.zeros(len(times_s), dtype=np.int64),
        start,
        scene.compute_inputs(tendon, guide),
        scene.compute_coefficients((step_s,)),
        (at.TENSION, at.FORCE),
        failed,
        BDF2,
        tolerance_nm=tolerance_nm,
        trusted_nm=trusted_nm,
    )
    failed_at_s = np.append(times_s, np.nan)[failed]
    tension_n, force_n = np.moveaxis(out[0, 1:].astype(np.float64), 0, -1)
    for trial in np.flatnonzero(np.isfinite(failed_at_s)):
        tension_n[trial, times_s >= failed_at_s[trial]] = np.nan
    return times_s, tension_n, force_n, failed_at_s


def _run_long_steps(case: Case, factor: int) -> Row:
    """Steps that are far too long; compared at their ends, from the start of the trial."""
    period_s = case.scene.rig.load_cell.period_s
    with count_halvings() as halvings:
        times_s, tension_n, force_n, failed_at_s = _advance(
            case, factor * period_s / STEPS_PER_SAMPLE, trusted_nm=TRUSTED_NM
        )
    still = dataclasses.replace(case.variation, phase=np.zeros_like(case.variation.phase))
    fine = dataclasses.replace(case, variation=still).simulate(REFERENCE_STEPS, 'compiled')
    reference = np.stack(
        [np.interp(times_s, fine.sample_times_s, row) for row in fine.truth['tension_n']]
    )
    judged = _judge(tension_n, force_n, failed_at_s)
    more = {'trials': len(tension_n), 'cut': halvings.steps, **judged}
    largest = float(compare(tension_n, reference).max())
    return Row(f'steps x{factor}', error=largest, more=more)


def _run_single_precision(case: Case, tolerance_nm: float) -> Row:
    """Against double precision with the same steps."""
    step_s = case.scene.rig.load_cell.period_s / STEPS_PER_SAMPLE
    with count_halvings() as halvings:
        _, tension_n, force_n, failed_at_s = _advance(case, step_s, np.float32, tolerance_nm)
    _, reference, _, _ = _advance(case, step_s)
    judged = _judge(tension_n, force_n, failed_at_s)
    more = {'trials': len(tension_n), 'cut': halvings.steps, **judged}
    name = f'single precision, solved to {tolerance_nm:g} N m'
    first = case.window.start * STEPS_PER_SAMPLE
    error = _compare_good(tension_n[:, first:], reference[:, first:])
    return Row(name, error=error, more=more)
