# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Windows of many simulated sessions: a few to train on, many to test on."""

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
"""Others were used to choose between methods."""

TRAIN = 6
TRAIN_TRIALS, TEST_TRIALS = 8, 4
"""Of each label in a session."""


def count_seeds(quick: bool) -> tuple[range, int]:
    """Return the numbers of the seeds, and how many sessions are tested for each."""
    return (range(2), 10) if quick else (range(20), 40)


def describe(seeds: range, tests: int) -> str:
    """Return how many sessions were simulated."""
    return (
        f'SIMULATED, {len(seeds)} seeds, {TRAIN} sessions of {TRAIN_TRIALS} trials a label to '
        f'train on, {tests} of {TEST_TRIALS} to test on'
    )


def simulate_windows(
    protocol: str, contact: str, seed: int, tests: int
) -> tuple[Array, NDArray[np.str_], NDArray[np.intp], float]:
    """Return the windows of trials, their labels and sessions, and the sample rate [Hz].

    Sessions below `TRAIN` are those to train on.
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
