# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy for twelve plates that are hard to tell apart, at several speeds, in new sessions.

Their pitches differ by 5 %, and their edges are worn.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from benchmarks.measuring import Report, Row
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_classifier.estimators.random_convolutions import fit_convolutions
from tactile_features import FeatureConfig, features_from_trials
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

Array = NDArray[Any]

FOLDER = Path(__file__).parent / 'hard_plates'

SPEEDS_MM_S = (8, 12, 18, 25)
BETWEEN_MM_S = (10, 15, 21)
USUAL_MM_S = 15
SESSIONS, TRIALS = 8, 3
"""Number of sessions, and of trials on each plate at each speed in a session. The first half of
the sessions is used for training."""

SEEDS = (1, 2, 3)
CROP_M, PATH_M = 0.010, 0.035
SAMPLES = 84
"""Number of samples on the path at 25 mm/s. For features over time, all signals are truncated to
this length."""

POINTS = 128

TASKS = {
    'one speed': ((USUAL_MM_S,), (USUAL_MM_S,), 0.0),
    'speeds between': (SPEEDS_MM_S, BETWEEN_MM_S, 0.0),
    'and 80 mN': (SPEEDS_MM_S, BETWEEN_MM_S, 0.08),
}
"""Tasks. The values are the speeds in training, the speeds in the test [mm/s], and the rms of the
white noise that is added to all samples [N]."""


@lru_cache
def simulate(seed: int, speed_mm_s: int) -> tuple[Array, Array, Array]:
    """Simulate glides over the same path at one speed.

    The result consists of signals of shape (trials, samples), labels and sessions.
    """
    catalogue = Catalogue(FOLDER)
    request = TrialRequest('texture', 'flexion', glide_speed_m_s=speed_mm_s / 1e3)
    planned = plan_trial(TrialConfig(), request, catalogue)
    first_s = dict(planned.phases)['glide'] + CROP_M * 1e3 / speed_mm_s
    first = int(np.ceil(first_s * planned.rate_hz))
    count = int(PATH_M * 1e3 / speed_mm_s * planned.rate_hz)
    rows, labels, sessions = [], [], []
    for label in [name for name in catalogue.labels('texture') if name.startswith('P')]:
        for session in range(SESSIONS):
            # Trial numbers differ between speeds, so that the trials are independent.
            found = simulate_trials(
                'texture',
                label,
                'flexion',
                planned.timeline,
                TRIALS,
                seed,
                session=session,
                first=speed_mm_s * TRIALS,
                catalogue=catalogue,
            )
            rows.append(found.tension_n[:, first : first + count])
            labels += [label] * TRIALS
            sessions += [session] * TRIALS
    return np.concatenate(rows), np.array(labels), np.array(sessions)


def spectrum(x: Array, speed_mm_s: int) -> Array:
    """Return the feature set ``texture_spectrum`` of the first `SAMPLES` samples."""
    config = FeatureConfig(texture_samples=SAMPLES)
    return features_from_trials('texture', x[:, :SAMPLES], 60.0, config=config)[0]


def spatial(x: Array, speed_mm_s: int) -> Array:
    """Return the feature set ``texture_spatial`` over 30 mm of the path."""
    config = FeatureConfig(
        texture_features='texture_spatial', spatial_length_m=0.030, spatial_finest_m=5e-4
    )
    speeds = np.full(len(x), speed_mm_s / 1e3)
    return features_from_trials('texture', x, 60.0, config=config, speeds_m_s=speeds)[0]


def signal_over_path(x: Array, speed_mm_s: int) -> Array:
    """Return the signals, resampled at `POINTS` equidistant points of the path."""
    at = np.linspace(0.0, x.shape[1] - 1.0, POINTS)
    return np.array([np.interp(at, np.arange(x.shape[1]), row) for row in x])


class Method(NamedTuple):
    """A method: features and a linear SVM, or random convolutions and a ridge classifier."""

    name: str
    view: Callable[[Array, int], Array]
    convolve: bool = False

    def count_right(self, train: Array, labels: Array, test: Array, wanted: Array) -> float:
        """Train the classifier, and return its accuracy on the test trials [%]."""
        estimator: Any = SVC(kernel='linear', max_iter=1_000_000)
        if self.convolve:
            rocket = fit_convolutions(train[:, np.newaxis], random_state=0)
            train, test = (np.asarray(rocket.transform(x[:, np.newaxis])) for x in (train, test))
            estimator = RidgeClassifierCV(np.logspace(-3, 3, 10))
        fitted = make_pipeline(StandardScaler(), estimator).fit(train, labels)
        return float(100 * np.mean(fitted.predict(test) == wanted))


METHODS = (
    Method('spectrum, line removed, linear SVM', spectrum),
    Method('texture_spatial, linear SVM', spatial),
    Method('random convolutions over the path', signal_over_path, convolve=True),
)


def measure(method: Method, seed: int, task: str) -> float:
    """Return the accuracy in sessions that are not in the training trials [%]."""
    trains, tests, noise_n = TASKS[task]
    generator = np.random.default_rng(seed)

    def gather(speeds: tuple[int, ...], is_test: bool) -> tuple[Array, Array]:
        parts, names = [], []
        for speed_mm_s in speeds:
            x, labels, sessions = simulate(seed, speed_mm_s)
            chosen = (sessions >= SESSIONS // 2) == is_test
            noisy = x[chosen] + noise_n * generator.standard_normal(x[chosen].shape)
            parts.append(method.view(noisy, speed_mm_s))
            names.append(labels[chosen])
        return np.concatenate(parts), np.concatenate(names)

    return method.count_right(*gather(trains, False), *gather(tests, True))


def run_hard_plates(quick: bool) -> Report:
    """Measure the accuracy of several methods on the twelve plates."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = []
    for method in METHODS:
        more = {}
        for task in TASKS:
            found = [measure(method, seed, task) for seed in seeds]
            more[task] = f'{np.mean(found):.1f} ({min(found):.1f}-{max(found):.1f})'
        rows.append(Row(method.name, more=more))
    return Report(
        'hard plates: twelve SIMULATED plates, pitches 5 % apart, worn edges',
        '',
        f'accuracy in % in {SESSIONS // 2} sessions, trained on {SESSIONS // 2} others, mean '
        f'(minimum to maximum) of {len(seeds)} seeds; chance 8.3; one speed: {USUAL_MM_S} mm/s; '
        f'between: trained on {SPEEDS_MM_S}, tested on {BETWEEN_MM_S} mm/s; 80 mN: rms of added '
        'white noise',
        rows,
    )
