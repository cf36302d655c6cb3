# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Windows of simulated sessions: a few sessions for training, and many for testing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.simulator.trials import find_window
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.trials import simulate_trials

Array = NDArray[np.float64]

FIRST_SEED = 2000
"""First seed of the simulation. The methods were chosen with other seeds."""

TRAIN = 6
TRAIN_TRIALS, TEST_TRIALS = 8, 4
"""Number of trials per label and session."""


def count_seeds(quick: bool) -> tuple[range, int]:
    """Return the seeds, counted from `FIRST_SEED`, and the number of test sessions per seed."""
    return (range(2), 10) if quick else (range(20), 40)


def describe(seeds: range, tests: int) -> str:
    """Return a description of the simulated sessions for the title of a report."""
    return (
        f'SIMULATED, {len(seeds)} seeds, {TRAIN} training sessions of {TRAIN_TRIALS} trials per '
        f'label, {tests} test sessions of {TEST_TRIALS} trials per label'
    )


def simulate_windows(
    protocol: str, contact: str, seed: int, tests: int
) -> tuple[Array, NDArray[np.str_], NDArray[np.intp], float]:
    """Return the windows of trials, their labels and sessions, and the sample rate [Hz].

    Sessions with numbers below `TRAIN` are for training.
    """
    planned = plan_trial(TrialConfig(), TrialRequest(protocol, contact))
    catalogue = default_catalogue()
    window = find_window(protocol, planned)
    windows, labels, sessions = [], [], []
    for label in catalogue.labels(protocol):
        for session in range(TRAIN + tests):
            count = TRAIN_TRIALS if session < TRAIN else TEST_TRIALS
            trials = simulate_trials(
                protocol,
                label,
                contact,
                planned.timeline,
                count,
                FIRST_SEED + seed,
                session=session,
            )
            windows.append(trials.tension_n[:, window])
            labels += [label] * count
            sessions += [session] * count
    x = np.concatenate(windows)
    good = np.isfinite(x).all(axis=1)
    return x[good], np.array(labels)[good], np.array(sessions)[good], planned.rate_hz
