# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw the picture of docs/phases.md: two simulated trials with the detected phases."""

from __future__ import annotations

from pathlib import Path

from matplotlib import pyplot as plt
import numpy as np

from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_features.config import FeatureConfig
from tactile_features.phases import find_phases
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.physics.trials import simulate_trials

_TRIALS = (('stiffness', 'sponge', 'flexion'), ('texture', 'R1', 'abduction'))
_SEED = 5


def draw_phases(path: Path) -> None:
    """Draw the tension with commanded phases (dashed) and detected phases."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.6), layout='constrained')
    for axis, (protocol, label, contact) in zip(axes, _TRIALS, strict=True):
        planned = plan_trial(TrialConfig(), TrialRequest(protocol, contact))
        trials = simulate_trials(protocol, label, contact, planned.timeline, 1, _SEED)
        tension_n = trials.tension_n[0, : planned.sample_count]
        time_s = np.arange(len(tension_n)) / planned.rate_hz
        time_ns = np.rint(time_s * 1e9).astype(np.int64)
        axis.plot(time_s, tension_n, color='0.3', linewidth=1)
        for _, at_s in planned.phases:
            axis.axvline(at_s, color='C0', linestyle='--', linewidth=1)
        top_n = float(tension_n.max())
        for event in find_phases(time_ns, tension_n, FeatureConfig(phases=protocol)):
            at_s = event.stamp_ns / 1e9
            axis.axvline(at_s, color='C3', linewidth=1)
            axis.text(at_s + 0.05, 0.08 * top_n, event.phase, color='C3', rotation=90)
        axis.set(title=f'{protocol}, {label}, {contact}', xlabel='time [s]', ylabel='tension [N]')
        axis.set_ylim(-0.05 * top_n, 1.12 * top_n)
    figure.suptitle('SIMULATED trials: phases commanded (dashed) and detected (red)', fontsize=10)
    figure.savefig(path, dpi=100)
    plt.close(figure)
