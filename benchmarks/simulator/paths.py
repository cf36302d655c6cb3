# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The other ways through the simulator: readings, stiffness, the live rig."""

from __future__ import annotations

import numpy as np

from benchmarks.measuring import Report, Row
from benchmarks.simulator.trials import CONTACTS, draw_trials, FloatArray, time_best, TrialSet
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.motion import plan_timeline
from tactile_sim.physics.trials import Plant, simulate_trials, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import Variation
from tactile_sim.rig import PalpationRig, STEP_S

PLATE = 'R3'
REFERENCE_STEPS = 160


def run_paths(quick: bool) -> Report:
    """Measure readings, stiffness trials, the live rig."""
    count = 64 if quick else 256
    rounds = 2 if quick else 5
    trials = draw_trials('texture', PLATE, 'flexion', count)
    timeline = trials.planned.timeline
    readings_s = time_best(
        lambda: simulate_trials('texture', PLATE, 'flexion', timeline, count, 1), rounds
    )
    motion_s = time_best(lambda: trials.simulate(STEPS_PER_SAMPLE), rounds)
    rows = [
        Row('texture, physics', more={'trials/s': count / motion_s}),
        Row('texture, readings', more={'trials/s': count / readings_s}),
    ]
    rows += [
        _run_stiffness(label, contact, 16 if quick else 64, rounds)
        for label in default_catalogue().labels('stiffness')
        for contact in CONTACTS
    ]
    rows += [_run_plant(quick), _run_rig(quick)]
    return Report(
        'paths: the default step',
        '',
        'trials a second of one core, the best of several runs; core: share of one core that the '
        'live rig takes in real time, with steps of 1 ms; '
        f'stiffness: largest over the trials, against {REFERENCE_STEPS} steps a sample, of the '
        'deviations of slope and intercept [% of the value] and of the correlation (absolute)',
        rows,
    )


def _run_stiffness(label: str, contact: str, count: int, rounds: int) -> Row:
    trials = draw_trials('stiffness', label, contact, count)
    found = _regress(trials, STEPS_PER_SAMPLE)
    reference = _regress(trials, REFERENCE_STEPS)
    best_s = time_best(lambda: trials.simulate(STEPS_PER_SAMPLE), rounds)
    relative = 100 * np.abs(found / reference - 1).max(axis=0)
    more = {
        'trials/s': count / best_s,
        'slope %': float(relative[0]),
        'intercept %': float(relative[1]),
        'correlation': float(np.abs(found[:, 2] - reference[:, 2]).max()),
    }
    return Row(f'{label}, {contact}', more=more)


def _regress(trials: TrialSet, steps: int) -> FloatArray:
    motion = trials.simulate(steps)
    window = trials.window
    time_ns = np.rint(1e9 * motion.sample_times_s[window]).astype(np.int64)
    return compute_regression(time_ns, motion.sensed_n[:, window])


def _run_plant(quick: bool) -> Row:
    """One trial, step by step as the live rig makes them, over the plate."""
    trials = draw_trials('texture', PLATE, 'flexion', 1)
    guide, tendon, _ = plan_timeline(trials.scene.rig, trials.planned.timeline)
    times_s = np.asarray(STEP_S * np.arange(1.0, round(5.0 / STEP_S)), dtype=np.float64)
    guide_m, tendon_m = guide.positions_at(times_s), tendon.positions_at(times_s)
    places = list(zip(guide_m.tolist(), tendon_m.tolist(), strict=True))

    def work() -> None:
        plant = Plant(trials.scene, Variation.none(), 0.06, 0.0, STEP_S)
        for place in places:
            plant.step(*place)

    best_s = time_best(work, 1 if quick else 3)
    return Row('live rig: physics', more={'core %': 100 * best_s / times_s[-1]})


def _run_rig(quick: bool) -> Row:
    """The rig with its three devices, at rest."""

    def work() -> None:
        rig = PalpationRig(seed=1)
        rig.mount('texture', PLATE, 'flexion')
        rig.advance(2.0)

    best_s = time_best(work, 1 if quick else 3)
    return Row('live rig: all, at rest', more={'core %': 100 * best_s / 2.0})
