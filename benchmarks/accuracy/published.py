# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's statements on simulated as-published trials, one setting changed at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
import tempfile

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from sklearn.model_selection import cross_val_score, StratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from benchmarks.measuring import Report, Row
from benchmarks.simulator.trials import CONTACTS, find_window
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.evaluation.significance import rank_sum_p_values
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

FloatArray = NDArray[np.float64]

TRIALS = 60
SEEDS = (1, 2, 3)
NAMES = ('neighbours', 'linear', 'RBF', 'tree')
SIMILAR = 0.05
NO_DEVIATION = (
    'variation: {trial: {contact_height_m: 0, placement_m: 0, friction: 0, object_stiffness: 0, '
    'finger_stiffness: 0, glide_speed: 0, tendon_zero_m: 0, temperature_k: 0}}'
)


@dataclass(frozen=True)
class Setting:
    """How trials are made and classified.

    Attributes
    ----------
    per_mounting
        Trials between one fixing of plate or object and the next.
    rig
        Text that is laid over the packaged ``rig.yaml``.
    newton
        Value of one newton: 1, or 1000 for features in millinewtons.
    gamma
        Of the RBF SVM: ``scale`` (scikit-learn since 0.22) or ``auto`` (before).
    """

    name: str
    per_mounting: int = TRIALS
    rig: str = '{}'
    newton: float = 1.0
    gamma: str = 'scale'


BASE = Setting('base: each mounted once, mean removed, N, gamma scale, not scaled')
SETTINGS = (
    BASE,
    replace(BASE, name='fixed anew for each trial (crossed)', per_mounting=1),
    replace(BASE, name='guide and drive repeat exactly', rig=NO_DEVIATION),
    replace(BASE, name='gamma auto, mN', gamma='auto', newton=1e3),
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


def score(values: FloatArray, labels: NDArray[np.str_], gamma: str, seed: int) -> list[float]:
    """Accuracy of the four classifiers in six stratified folds."""
    estimators = (
        KNeighborsClassifier(3),
        SVC(kernel='linear', max_iter=1_000_000),
        SVC(kernel='rbf', gamma=gamma),
        DecisionTreeClassifier(random_state=0),
    )
    folds = StratifiedKFold(6, shuffle=True, random_state=seed)
    return [cross_val_score(one, values, labels, cv=folds).mean() for one in estimators]


def find_alike(values: FloatArray, labels: NDArray[np.str_]) -> set[str]:
    """Name pairs of objects, and the feature in which the rank-sum test finds them alike."""
    found = rank_sum_p_values(values, labels)
    return {
        f'{name} {found.labels[j]}/{found.labels[i]}'
        for name, p in zip(('slope', 'intercept', 'correlation'), found.p, strict=True)
        for i in range(len(found.labels))
        for j in range(i)
        if p[i, j] > SIMILAR
    }


def run_published(quick: bool) -> Report:
    """Change one setting at a time, and look at the paper's statements."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = [
        Row(f'{setting.name}; {contact}', more=_judge(setting, contact, seeds))
        for setting in (SETTINGS[:1] if quick else SETTINGS)
        for contact in CONTACTS
    ]
    return Report(
        'published: the statements of the paper on SIMULATED trials',
        '',
        f'accuracy in % of {"/".join(NAMES)}, six stratified folds, mean of {len(seeds)} seeds; '
        f'components of 90 with a mean p above {SIMILAR:g}, least and most of the seeds; pairs of '
        'objects that one of the three stiffness features does not tell apart in some seed',
        rows,
    )


def _judge(setting: Setting, contact: str, seeds: Sequence[int]) -> dict[str, str | int]:
    more: dict[str, str | int] = {}
    above: list[int] = []
    alike: set[str] = set()
    for protocol in ('texture', 'stiffness'):
        scores = []
        for seed in seeds:
            windows, labels, rate_hz = make_windows(
                protocol, contact, seed, setting.per_mounting, setting.rig
            )
            values = compute_features(protocol, windows, rate_hz)
            units = setting.newton if protocol == 'texture' else [setting.newton] * 2 + [1.0]
            scores.append(score(values * units, labels, setting.gamma, seed))
            if protocol == 'texture':
                above.append(int((rank_sum_p_values(values, labels).mean_p[1:] > SIMILAR).sum()))
            else:
                alike |= find_alike(values, labels)
        more[protocol] = '/'.join(f'{100 * value:.1f}' for value in np.mean(scores, axis=0))
    return more | {'p > 0.05': f'{min(above)}-{max(above)}', 'alike': len(alike)}
