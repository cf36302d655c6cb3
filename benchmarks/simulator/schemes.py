# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator of texture trials: speed against error, by step."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring import Ratio, Report, Row
from benchmarks.simulator.trials import (
    compare,
    CONTACTS,
    draw_trials,
    FloatArray,
    name_choice,
    PLATES,
    remove_line,
    time_in_turns,
    TrialSet,
)
from tactile_sim.physics.trials import STEPS_PER_SAMPLE, TRUSTED_NM

STEPS = (4, 6, 8, 10, 12, 16, 20, 24, 40)
REFERENCE_STEPS = 160
BOUND_PERCENT = 2.5
"""Of what the sensor gets, which is what leaves the simulator; the tension stands beside it."""


class Choice(NamedTuple):
    """Steps a sample, and the residual below which a step is not checked [N m]."""

    steps: int
    trusted_nm: float = TRUSTED_NM


DEFAULT = Choice(STEPS_PER_SAMPLE)
SOLVED = Choice(STEPS_PER_SAMPLE, 0.0)
REFERENCE = Choice(REFERENCE_STEPS)
FINER = Choice(2 * REFERENCE_STEPS)


def run_simulator(quick: bool) -> Report:
    """Vary the step on drawn texture trials."""
    sets = _draw_sets(32 if quick else 64)
    count = sum(len(trials.variation.phase) for trials in sets)
    choices = [Choice(steps) for steps in STEPS]
    choices.append(SOLVED)
    works = [partial(_simulate_all, sets, choice) for choice in choices]
    times_s = time_in_turns(works, 3 if quick else 9)
    ratios = times_s / times_s[choices.index(DEFAULT)]
    reference = _simulate_all(sets, REFERENCE)
    rows = []
    for choice, some_s, some_ratios in zip(choices, times_s, ratios, strict=True):
        low, median, high = np.quantile(some_ratios, (0.25, 0.5, 0.75)).tolist()
        solved = ', each step solved' if choice == SOLVED else ''
        rows.append(
            _row(
                name_choice(choice.steps) + solved,
                _simulate_all(sets, choice),
                reference,
                Ratio(median, low, high),
                count / float(some_s.min()),
                BOUND_PERCENT if choice == DEFAULT else None,
            )
        )
    few = _draw_sets(8 if quick else 32)
    case = f'{REFERENCE_STEPS} steps against {2 * REFERENCE_STEPS}'
    rows.append(_row(case, _simulate_all(few, REFERENCE), _simulate_all(few, FINER)))
    return Report(
        f'simulator: texture trials on {", ".join(PLATES)}, flexion and abduction; errors in %',
        f'the default, {STEPS_PER_SAMPLE} steps a sample',
        f'rms deviation from {name_choice(REFERENCE_STEPS)}, over the rms, in the 180 '
        'samples without their straight line: of the tension, and of what the sensor gets (error: '
        'its 95th percentile over the trials)',
        rows,
    )


def _draw_sets(count: int) -> list[TrialSet]:
    return [
        draw_trials('texture', plate, contact, count) for plate in PLATES for contact in CONTACTS
    ]


def _simulate_all(sets: list[TrialSet], choice: Choice) -> tuple[FloatArray, FloatArray]:
    """Return the windows of tension and of what the sensor gets, shape (trials, samples) [N]."""
    tension, sensed = [], []
    for trials in sets:
        motion = trials.simulate(choice.steps, trusted_nm=choice.trusted_nm)
        if np.isfinite(motion.failed_at_s).any():
            raise RuntimeError(f'a texture trial failed with {choice}')
        tension.append(motion.truth['tension_n'][:, trials.window])
        sensed.append(motion.sensed_n[:, trials.window])
    return np.concatenate(tension), np.concatenate(sensed)


def _row(
    case: str,
    ours: tuple[FloatArray, FloatArray],
    reference: tuple[FloatArray, FloatArray],
    ratio: Ratio | None = None,
    trials_per_s: float | None = None,
    bound: float | None = None,
) -> Row:
    tension, sensed = (
        compare(remove_line(a), remove_line(b)) for a, b in zip(ours, reference, strict=True)
    )
    more: dict[str, Any] = {
        'trials/s': trials_per_s,
        'tension p50': float(np.median(tension)),
        'tension p95': float(np.quantile(tension, 0.95)),
        'sensed p50': float(np.median(sensed)),
    }
    return Row(case, ratio, float(np.quantile(sensed, 0.95)), bound, more=more)
