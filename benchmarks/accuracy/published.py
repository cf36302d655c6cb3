# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's statements on simulated as-published trials, one setting changed at a time.

The rules by which a statement holds are those of the report.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
import tempfile

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from sklearn.model_selection import cross_val_score, StratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from benchmarks.measuring import Report, Row
from benchmarks.simulator.trials import CONTACTS, find_window
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_classifier.evaluation.significance import rank_sum_p_values
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.report.published import DRAMATIC, EQUALLY, FEW, HIGH, PERFECT, STIFFNESS_LEAST
from tactile_lab.report.significance import LEVEL
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

FloatArray = NDArray[np.float64]

TRIALS = 60
SEEDS = tuple(range(1, 21))
NAMES = ('neighbours', 'linear', 'RBF', 'tree')
EXCUSED = {'correlation pla/solid_rubber', 'correlation pla/rubber_shell'}
"""Pairs that the paper itself finds alike."""


@dataclass(frozen=True)
class Setting:
    """A way of making and classifying trials.

    Plate or object is fixed anew after ``per_mounting`` trials. ``rig`` is laid over the packaged
    ``rig.yaml``. One newton is ``newton``: 1000 for features in millinewtons. ``gamma`` of the RBF
    SVM is ``scale`` (scikit-learn since 0.22) or ``auto`` (before). ``scaled`` features have zero
    mean and unit variance, fitted in each fold.
    """

    name: str
    per_mounting: int = TRIALS
    rig: str = '{}'
    newton: float = 1.0
    gamma: str = 'scale'
    scaled: bool = False
    tasks: tuple[str, ...] = ('texture', 'stiffness')


def _drive(error_m: float) -> str:
    return f'variation: {{trial: {{tendon_zero_m: {error_m:g}}}}}'


QUIET = 'load_cell: {noise_n: 0.0004}'


BASE = Setting('base: each mounted once, mean removed, N, gamma scale, not scaled')
HOLDS = replace(BASE, tasks=('stiffness',))
SETTINGS = (
    BASE,
    replace(BASE, name='scaled', scaled=True),
    replace(BASE, name='gamma auto, mN', gamma='auto', newton=1e3),
    replace(BASE, name='fixed anew for each trial (crossed)', per_mounting=1),
    replace(HOLDS, name='drive repeats to 3.5 um', rig=_drive(3.5e-6)),
    replace(HOLDS, name='drive repeats to 1.75 um', rig=_drive(1.75e-6)),
    replace(HOLDS, name='drive repeats exactly', rig=_drive(0.0)),
    replace(HOLDS, name='sensor noise 0.4 mN (a tenth)', rig=QUIET),
    replace(HOLDS, name='drive 1.75 um, noise 0.4 mN', rig=f'{_drive(1.75e-6)}\n{QUIET}'),
)


@lru_cache
def make_windows(
    protocol: str, contact: str, seed: int, per_mounting: int, rig: str
) -> tuple[FloatArray, NDArray[np.str_], float]:
    """Return the windows that features come from, their labels, and the sample rate [Hz]."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / 'rig.yaml').write_text(rig, 'utf-8')
        catalogue = Catalogue(Path(folder))
    planned = plan_trial(TrialConfig(), TrialRequest(protocol, contact), catalogue)
    window = find_window(protocol, planned)
    labels = catalogue.labels(protocol)
    rows = [
        simulate_trials(
            protocol,
            label,
            contact,
            planned.timeline,
            TRIALS,
            seed,
            trials_per_mounting=per_mounting,
            catalogue=catalogue,
        ).tension_n[:, window]
        for label in labels
    ]
    return np.concatenate(rows), np.repeat(labels, TRIALS), planned.rate_hz


def compute_features(protocol: str, windows: FloatArray, rate_hz: float) -> FloatArray:
    """Features as the paper has them, shape (trials, k)."""
    if protocol == 'texture':
        return compute_spectrum(detrend(windows, type='constant'))
    times_ns = np.rint(1e9 / rate_hz * np.arange(windows.shape[1])).astype(np.int64)
    return compute_regression(times_ns, windows)


def score(
    values: FloatArray, labels: NDArray[np.str_], setting: Setting, seed: int
) -> list[float]:
    """Accuracy of the four classifiers in six stratified folds."""
    estimators = (
        KNeighborsClassifier(3),
        SVC(kernel='linear', max_iter=1_000_000),
        SVC(kernel='rbf', gamma=setting.gamma),
        DecisionTreeClassifier(random_state=0),
    )
    scaler = StandardScaler() if setting.scaled else FunctionTransformer()
    folds = StratifiedKFold(6, shuffle=True, random_state=seed)
    return [
        cross_val_score(make_pipeline(scaler, one), values, labels, cv=folds).mean()
        for one in estimators
    ]


def find_alike(values: FloatArray, labels: NDArray[np.str_]) -> set[str]:
    """Name pairs of objects, and the feature in which the rank-sum test finds them alike."""
    found = rank_sum_p_values(values, labels)
    return {
        f'{name} {found.labels[j]}/{found.labels[i]}'
        for name, p in zip(('slope', 'intercept', 'correlation'), found.p, strict=True)
        for i in range(len(found.labels))
        for j in range(i)
        if p[i, j] > LEVEL
    }


def run_published(quick: bool) -> Report:
    """Change one setting at a time, and count the seeds in which the paper's statements hold."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = [
        Row(f'{setting.name}; {task}, {contact}', more=_judge(setting, task, contact, seeds))
        for setting in (SETTINGS[:1] if quick else SETTINGS)
        for task in setting.tasks
        for contact in CONTACTS
    ]
    return Report(
        'published: the statements of the paper on SIMULATED trials',
        '',
        f'accuracy in %, six stratified folds: mean of {len(seeds)} seeds (least to most), and '
        'the number of seeds in which a statement holds',
        rows,
    )


def _judge(setting: Setting, task: str, contact: str, seeds: tuple[int, ...]) -> dict[str, str]:
    scores, above, pairs = [], [], []
    for seed in seeds:
        windows, labels, rate_hz = make_windows(
            task, contact, seed, setting.per_mounting, setting.rig
        )
        values = compute_features(task, windows, rate_hz)
        units = setting.newton if task == 'texture' else [setting.newton] * 2 + [1.0]
        scores.append(score(values * units, labels, setting, seed))
        if task == 'texture':
            above.append((rank_sum_p_values(values, labels).mean_p[1:] > LEVEL).mean())
        else:
            pairs.append(find_alike(values, labels) - EXCUSED)
    found = np.array(scores)
    more = {
        name: f'{mean:.1f} ({least:.1f} to {most:.1f})'
        for name, mean, least, most in zip(
            NAMES,
            *(100 * of(found, axis=0) for of in (np.mean, np.min, np.max)),
            strict=True,
        )
    }
    knn, linear, rbf, tree = found.T
    if task == 'texture':
        holds = {
            'neighbours, RBF 100': np.minimum(knn, rbf) >= PERFECT,
            'tree high': tree >= HIGH,
            'linear lower': rbf - linear >= EQUALLY,
            'few components': np.array(above) <= FEW,
        }
        more['over 0.05 [%]'] = f'{100 * min(above):.0f} to {100 * max(above):.0f}'
    else:
        others = found[:, [0, 1, 3]].min(axis=1)
        holds = {
            'others 97.2': others >= STIFFNESS_LEAST,
            'RBF lower': others - rbf >= DRAMATIC,
            'both': (others >= STIFFNESS_LEAST) & (others - rbf >= DRAMATIC),
            'all differ': np.array([not each for each in pairs]),
        }
    return more | {'holds in': ', '.join(f'{k}: {int(v.sum())}' for k, v in holds.items())}
