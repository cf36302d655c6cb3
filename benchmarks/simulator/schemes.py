# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed and error of simulated texture trials, for several numbers of steps per sample."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.measuring import Ratio, Report, Row
from benchmarks.simulator.trials import (
    compare,
    CONTACTS,
    draw_trials,
    DrawnTrials,
    FloatArray,
    name_choice,
    PLATES,
    remove_line,
    time_in_turns,
)
from tactile_sim.physics.trials import STEPS_PER_SAMPLE

STEPS = (4, 6, 8, 10, 12, 16, 20, 24, 40)
REFERENCE_STEPS = 160
BOUND_PERCENT = 2.5
"""Bound of the error of the sensor signal, for the default number of steps.

The error of the tension has no bound and is only reported.
"""


def run_simulator(quick: bool) -> Report:
    """Measure speed and error of random texture trials for several numbers of steps per sample."""
    sets = [
        draw_trials('texture', plate, contact, 32 if quick else 64)
        for plate in PLATES
        for contact in CONTACTS
    ]
    count = sum(len(trials.variation.phase) for trials in sets)
    works = [partial(_simulate_all, sets, steps) for steps in STEPS]
    times_s = time_in_turns(works, 3 if quick else 9)
    ratios = times_s / times_s[STEPS.index(STEPS_PER_SAMPLE)]
    reference = _simulate_all(sets, REFERENCE_STEPS)
    rows = []
    for steps, some_s, some_ratios in zip(STEPS, times_s, ratios, strict=True):
        low, median, high = np.quantile(some_ratios, (0.25, 0.5, 0.75)).tolist()
        tension, sensed = (
            compare(remove_line(a), remove_line(b))
            for a, b in zip(_simulate_all(sets, steps), reference, strict=True)
        )
        more = {
            'trials/s': count / float(some_s.min()),
            'tension p50': float(np.median(tension)),
            'tension p95': float(np.quantile(tension, 0.95)),
            'sensed p50': float(np.median(sensed)),
        }
        bound = BOUND_PERCENT if steps == STEPS_PER_SAMPLE else None
        error = float(np.quantile(sensed, 0.95))
        rows.append(Row(name_choice(steps), Ratio(median, low, high), error, bound, more=more))
    return Report(
        f'simulator: texture trials on {", ".join(PLATES)}, flexion and abduction; errors in %',
        f'the default, {STEPS_PER_SAMPLE} steps per sample',
        f'rms deviation from {name_choice(REFERENCE_STEPS)}, relative to the rms, of the 180 '
        'samples without their linear trend: for the tension, and for the input of the sensor '
        '(error: 95th percentile over the trials)',
        rows,
    )


def _simulate_all(sets: list[DrawnTrials], steps: int) -> tuple[FloatArray, FloatArray]:
    """Return the windows of the tension, and of the signal that the sensor receives.

    Both have the shape (trials, samples) [N].
    """
    tension, sensed = [], []
    for trials in sets:
        motion = trials.simulate(steps)
        if np.isfinite(motion.failed_at_s).any():
            raise RuntimeError(f'a texture trial failed with {steps} steps')
        tension.append(motion.truth['tension_n'][:, trials.window])
        sensed.append(motion.sensed_n[:, trials.window])
    return np.concatenate(tension), np.concatenate(sensed)
