# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Twelve plates whose pitches differ by 5 %, worn edges, several speeds, unseen sessions.

The plates are those of ``hard_plates``, which `write_plates` made and nothing else changes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import RidgeClassifierCV
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from benchmarks.measuring import Report, Row
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.estimators.random_convolutions import RandomConvolutions
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.fast_trials import simulate_trials

Array = NDArray[Any]

FOLDER = Path(__file__).parent / 'hard_plates'
PLATES, FINEST_MM, RATIO = 12, 2.0, 1.05
DEPTH_MM, LONGEST_WEAR_MM = 0.3, 0.25
GROOVED_MM = 50.0

SPEEDS_MM_S = (8, 12, 18, 25)
BETWEEN_MM_S = (10, 15, 21)
USUAL_MM_S = 15
SESSIONS, TRIALS = 8, 3
"""Of each plate at each speed; the first half of the sessions trains, the other tests."""

SEEDS = (1, 2, 3)
CROP_M, PATH_M = 0.010, 0.035
SAMPLES = 84
"""What the path has at 25 mm/s; over time, every signal is cut to it."""

POINTS = 128


def write_plates(path: Path) -> None:
    """Write the description of the plates; wear differs from groove to groove and repeats."""
    lines = [
        '# Twelve plates of rectangular grooves, pitch in ratios of 1.05 from 2.0 mm, half of it',
        '# groove, 0.3 mm deep, each edge worn to a chamfer of 0 to 0.25 mm.',
        '# Written by hard_benchmark.py.',
    ]
    for k in range(PLATES):
        pitch_mm = FINEST_MM * RATIO**k
        points = [(0.0, 0.0)]
        for i in range(int(GROOVED_MM / pitch_mm)):
            left, right = (i + 0.25) * pitch_mm, (i + 0.75) * pitch_mm
            # The golden ratio's multiples fill the range evenly and never repeat.
            worn = [LONGEST_WEAR_MM * ((2 * i + e + 7 * k) * 0.6180339887 % 1) for e in (0, 1)]
            points += [
                (left - worn[0] - 1e-3, 0.0),
                (left, -DEPTH_MM),
                (right, -DEPTH_MM),
                (right + worn[1] + 1e-3, 0.0),
            ]
        points.append((GROOVED_MM, 0.0))
        text = ', '.join(f'[{x:.4f}, {h:g}]' for x, h in points)
        lines.append(
            f'P{k + 1:02d}: {{groove: profile, end_mm: 10.0, '
            f'grooved_mm: {GROOVED_MM:g}, friction: 0.4,\n'
            f'  points_mm: [{text}]}}'
        )
    path.write_text('\n'.join(lines) + '\n', 'utf-8')


@lru_cache
def simulate(seed: int, speed_mm_s: int) -> tuple[Array, Array, Array]:
    """Glides over the same path on every plate.

    Returns
    -------
    signals : ndarray, shape (trials, samples)
    labels, sessions : ndarray, shape (trials,)
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
            # A speed has trials of its own: numbers that no other speed has.
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


View = Callable[[Array, int], Array]


def spectrum(detrend: str, window: str) -> View:
    """The set ``texture_spectrum`` over the first seconds."""
    config = FeatureConfig(
        texture_samples=SAMPLES, spectrum_detrend=detrend, spectrum_window=window
    )
    return lambda x, speed_mm_s: features_from_trials(
        'texture', x[:, :SAMPLES], 60.0, config=config
    )[0]


def spatial(x: Array, speed_mm_s: int) -> Array:
    """The set ``texture_spatial`` over 30 mm of the path."""
    config = FeatureConfig(
        texture_features='texture_spatial', spatial_length_m=0.030, spatial_finest_m=5e-4
    )
    speeds = np.full(len(x), speed_mm_s / 1e3)
    return features_from_trials('texture', x, 60.0, config=config, speeds_m_s=speeds)[0]


def signal_in_time(x: Array, speed_mm_s: int) -> Array:
    """The signal itself, over time."""
    return x[:, :SAMPLES]


def signal_over_path(x: Array, speed_mm_s: int) -> Array:
    """The signal itself, at points of the path."""
    at = np.linspace(0.0, x.shape[1] - 1.0, POINTS)
    return np.array([np.interp(at, np.arange(x.shape[1]), row) for row in x])


def fit_rocket(train: Array) -> Callable[[Array], Array]:
    """Random convolutions, with biases from the signals of the training."""
    rocket = RandomConvolutions.fit(train[:, np.newaxis], random_state=0)
    return lambda rows: np.asarray(rocket.transform(rows[:, np.newaxis]))


def keep(train: Array) -> Callable[[Array], Array]:
    """Features as they are."""
    return lambda rows: rows


def build_ridge() -> Any:
    return make_pipeline(StandardScaler(), RidgeClassifierCV(np.logspace(-3, 3, 10)))


def build_linear() -> Any:
    return make_pipeline(StandardScaler(), SVC(kernel='linear', max_iter=1_000_000))


def build_neighbours() -> Any:
    return KNeighborsClassifier(3)


METHODS: tuple[tuple[str, View, Any, Any], ...] = (
    ('spectrum, mean off, neighbours', spectrum('mean', 'none'), keep, build_neighbours),
    ('spectrum, mean off, linear', spectrum('mean', 'none'), keep, build_linear),
    ('spectrum, line off, neighbours', spectrum('linear', 'none'), keep, build_neighbours),
    ('spectrum, line off, linear', spectrum('linear', 'none'), keep, build_linear),
    ('spectrum, line off, Hann, linear', spectrum('linear', 'hann'), keep, build_linear),
    ('texture_spatial, neighbours', spatial, keep, build_neighbours),
    ('texture_spatial, linear', spatial, keep, build_linear),
    ('random convolutions, time, ridge', signal_in_time, fit_rocket, build_ridge),
    ('random convolutions, path, ridge', signal_over_path, fit_rocket, build_ridge),
)

TASKS = {
    'one speed': ((USUAL_MM_S,), (USUAL_MM_S,), 0.0),
    'four speeds': (SPEEDS_MM_S, SPEEDS_MM_S, 0.0),
    'speeds between': (SPEEDS_MM_S, BETWEEN_MM_S, 0.0),
    'and 20 mN': (SPEEDS_MM_S, BETWEEN_MM_S, 0.02),
    'and 80 mN': (SPEEDS_MM_S, BETWEEN_MM_S, 0.08),
}
"""Speeds of training and test [mm/s], and white noise that is added to all readings, rms [N]."""


def measure(method: tuple[str, View, Any, Any], seed: int, task: str) -> float:
    """Accuracy in sessions that training did not see [%]."""
    _, view, fit, build = method
    trains, tests, noise_n = TASKS[task]
    generator = np.random.default_rng(seed)

    def gather(speeds: tuple[int, ...], is_test: bool) -> tuple[Array, Array]:
        parts, names = [], []
        for speed_mm_s in speeds:
            x, labels, sessions = simulate(seed, speed_mm_s)
            chosen = (sessions >= SESSIONS // 2) == is_test
            noisy = x[chosen] + noise_n * generator.standard_normal(x[chosen].shape)
            parts.append(view(noisy, speed_mm_s))
            names.append(labels[chosen])
        return np.concatenate(parts), np.concatenate(names)

    train, labels = gather(trains, False)
    test, wanted = gather(tests, True)
    transform = fit(train)
    fitted = build().fit(transform(train), labels)
    return float(100 * np.mean(fitted.predict(transform(test)) == wanted))


def run_hard_plates(quick: bool) -> Report:
    """Show where each set of features breaks."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = []
    for method in METHODS:
        more = {}
        for task in TASKS:
            found = [measure(method, seed, task) for seed in seeds]
            more[task] = f'{np.mean(found):.1f} ({min(found):.1f}-{max(found):.1f})'
        rows.append(Row(method[0], more=more))
    return Report(
        'hard plates: twelve SIMULATED plates, pitches 5 % apart, worn edges',
        'none',
        f'accuracy in % in {SESSIONS // 2} sessions that training on {SESSIONS // 2} others did '
        f'not see, mean (least to most) of {len(seeds)} seeds; chance is {100 / PLATES:.1f}; '
        f'one speed: {USUAL_MM_S} mm/s; four: {SPEEDS_MM_S}; between: trained on these, tested on '
        f'{BETWEEN_MM_S}, and with so much white noise (rms) in every reading',
        rows,
    )


if __name__ == '__main__':
    write_plates(FOLDER / 'plates.yaml')
