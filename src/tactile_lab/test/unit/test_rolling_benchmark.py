# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the benchmark of rolling objects computes, on cases with a known answer."""

import importlib
from pathlib import Path
import sys

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[4]
if not (REPOSITORY / 'benchmarks').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)
sys.path.insert(0, str(REPOSITORY))
rolling = importlib.import_module('benchmarks.events.rolling')


def test_bend_is_the_parabola_over_the_deviation_of_its_noise():
    rate_hz, noise_n = 60.0, 0.004
    rng = np.random.default_rng(0)
    time_s = np.arange(1200) / rate_hz
    bend_n_s2 = 0.05
    line = 1e6 + 3.0 * time_s  # a line has no bend, however large
    fall = -0.5 * bend_n_s2 * time_s**2
    noise = rng.normal(0.0, noise_n, (200, 1200))
    score = rolling.compute_bend(line + fall + noise, rate_hz, 0, 600)[:, -1]
    # Least squares on n points of a window W: deviation of the bend sqrt(720 / n) noise / W^2.
    window_s = max(rolling.WINDOWS_S)
    count = window_s * rate_hz
    expected = bend_n_s2 / (np.sqrt(720 / count) * noise_n / window_s**2)
    assert np.mean(score) == pytest.approx(expected, rel=0.04)
    up = rolling.compute_bend(line - fall + noise, rate_hz, 0, 600)[:, -1]
    assert up.max() < 6.0


def test_visibility_leaves_out_what_is_explained():
    time_s = np.arange(100) / 60.0
    explained = np.column_stack([np.ones(100), time_s])
    step = np.where(np.arange(100) < 50, 0.0, 0.01)
    seen = rolling.compute_visibility(np.array([step, 3.0 + 7.0 * time_s]), explained, 0.004)
    fitted = np.polyval(np.polyfit(time_s, step, 1), time_s)
    assert seen[0] == pytest.approx(np.linalg.norm(step - fitted) / 0.004)
    assert seen[1] == pytest.approx(0.0, abs=1e-9)


def test_auroc_counts_ties_half():
    assert rolling.compute_auroc(np.array([1.0, 2.0]), np.array([0.0, 1.0, 3.0])) == 3.5 / 6


def test_the_twin_without_a_pull_differs_by_nothing_before_it():
    pulls = rolling.simulate_pulls(rolling.KINDS[rolling.USUAL], 'flexion', 60.0, 1, 2)
    before = pulls.pulled.sample_times_s < pulls.begin_s - 0.02
    effect_n = pulls.effect_n()
    # Steps are shorter while the object moves, and a little before.
    assert np.abs(effect_n[:, before]).max() < 1e-4
    assert np.ptp(effect_n, axis=1).min() > 1e-3


def test_what_does_not_turn_has_the_bits_of_the_simulator():
    from tactile_sim.physics.fast_trials import simulate_motion
    from tactile_sim.physics.scene import build_scene
    from tactile_sim.physics.timeline import Move, Timeline
    from tactile_sim.physics.variation import Variation

    timeline = Timeline(
        [Move(0.1, 0.06, 0.04)], [Move(0.1, 0.004, 0.01)], 1.5, 0.06, [Move(0.8, 0.001, 0.002)]
    )
    scenes = [
        build_scene('slip', 'cylinder', 'flexion'),
        rolling.build_kind(rolling.Kind(), 'flexion', 60.0, 0),
    ]
    first, second = (simulate_motion(s, timeline, Variation.none()).sensed_n for s in scenes)
    assert first.tobytes() == second.tobytes()
