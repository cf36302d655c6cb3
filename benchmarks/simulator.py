# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fast path of the simulator: how many trials, at which step, how far off."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from measuring import Report, Row

from tactile_bringup.records import TrialConfig
from tactile_bringup.simulated_bags import plan_trial
from tactile_bringup.trial_protocols import TrialRequest
from tactile_features import FeatureConfig
from tactile_sim.fast_trials import STEP_S, Timeline, simulate_motion, simulate_trials
from tactile_sim.plant import Variation

STEPS_S = (2e-4, 4e-4, 1e-3)
FINE_S = 4e-5
PLATE = 'R3'  # the finest rectangular grooves: the hardest


def run_simulator(quick: bool) -> Report:
    """Simulate trials, against the time that they would last; vary the step."""
    count = 10 if quick else 60
    rows = []
    for protocol, label in (('texture', PLATE), ('stiffness', 'sponge')):
        planned = plan_trial(TrialConfig(), TrialRequest(protocol, 'flexion'))
        start_s = time.perf_counter()
        simulate_trials(protocol, label, 'flexion', planned.timeline, count, 1)
        elapsed_s = time.perf_counter() - start_s
        more = {
            'times real time': count * planned.timeline.duration_s / elapsed_s,
            'trials per s': count / elapsed_s,
        }
        rows.append(Row(f'{protocol}, {count} on {label}', more=more))
    return Report(
        'simulator: the fast path',
        'the duration of the trials themselves; steps: the default step',
        f'rms deviation from a step of {FINE_S * 1e3:g} ms, alternating part of the 180 samples '
        f'of a texture window on {PLATE}, in % of its rms',
        rows + _step_rows(),
    )


def _step_rows() -> list[Row]:
    planned = plan_trial(TrialConfig(), TrialRequest('texture', 'flexion'))
    config = FeatureConfig()
    from_s = dict(planned.phases)['glide'] + config.texture_crop_start_s
    until_s = from_s + (config.texture_samples + 1) / config.rate_hz
    moves = planned.timeline
    timeline = Timeline(
        [move for move in moves.guide_moves if move.start_s < until_s],
        [move for move in moves.tendon_moves if move.start_s < until_s],
        until_s,
        moves.guide_start_m,
    )

    def ripple(step_s: float) -> tuple[Any, float]:
        start_s = time.perf_counter()
        times, truth = simulate_motion(
            'texture', PLATE, 'flexion', timeline, Variation.none(), step_s
        )
        elapsed_s = time.perf_counter() - start_s
        begin = int(np.searchsorted(times, from_s))
        window = truth['tension_n'][0, begin : begin + config.texture_samples]
        return window - window.mean(), elapsed_s

    fine, _ = ripple(FINE_S)
    found = {step_s: ripple(step_s) for step_s in STEPS_S}
    rows = []
    for step_s, (coarse, elapsed_s) in found.items():
        error = 100 * np.sqrt(np.mean((coarse - fine) ** 2) / np.mean(fine**2))
        is_default = step_s == STEP_S
        name = f'step {step_s * 1e3:.1f} ms' + (' (default)' if is_default else '')
        more = {'time / default': elapsed_s / found[STEP_S][1]}
        rows.append(Row(name, None, float(error), 2.0 if is_default else None, more=more))
    return rows
