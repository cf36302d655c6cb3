# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's statements on simulated as-published trials, one setting changed at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
import tempfile

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from sklearn.model_selection import cross_val_score, StratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from benchmarks.measuring import Report, Row
from benchmarks.simulator.trials import CONTACTS, find_window
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.evaluation.significance import rank_sum_p_values
from tactile_features.feature_sets.stiffness_regression import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.fast_trials import simulate_trials

FloatArray = NDArray[np.float64]

TRIALS = 60
SEEDS = (1, 2, 3)
NAMES = ('neighbours', 'linear', 'RBF', 'tree')
SIMILAR = 0.05
NO_DEVIATION = (
    '{contact_height_m: 0, placement_m: 0, friction: 0, object_stiffness: 0, '
    'finger_stiffness: 0, glide_speed: 0, tendon_zero_m: 0, temperature_k: 0}'
)


@dataclass(frozen=True)
class Setting:
    """How trials are made and classified; the defaults are the base of the ablation.

    Attributes
    ----------
    per_mounting
        Trials between one fixing of plate or object and the next.
    description
        Text of files laid over the packaged description.
    detrend
        ``constant`` or ``linear``: what is taken from a texture window.
    newton
        Value of one newton: 1, or 1000 for features in millinewtons.
    plain_fft
        Magnitudes of the sum over the window, without the division by its length.
    gamma
        Of the RBF SVM: ``scale`` (scikit-learn since 0.22) or ``auto`` (before).
    scaled
        Features with unit variance.
    settle_s
        Rest between contact and glide [s].
    """

    name: str
    per_mounting: int = TRIALS
    description: tuple[tuple[str, str], ...] = ()
    detrend: str = 'constant'
    newton: float = 1.0
    plain_fft: bool = False
    gamma: str = 'scale'
    scaled: bool = False
    settle_s: float = field(default_factory=lambda: TrialConfig().settle_s)

    @property
    def motion(self) -> tuple[object, ...]:
        """What makes other trials, and not other features."""
        return self.per_mounting, self.description, self.settle_s


BASE = Setting('base: each mounted once, mean removed, N, gamma scale, not scaled')
SETTINGS = (
    BASE,
    replace(BASE, name='straight line removed', detrend='linear'),
    replace(BASE, name='fixed anew for each trial (crossed)', per_mounting=1),
    replace(
        BASE,
        name='all in one and the same mounting',
        description=(('rig.yaml', f'variation: {{mounting: {NO_DEVIATION}}}'),),
    ),
    replace(
        BASE,
        name='plate moves by 0.5 mm from trial to trial',
        description=(('rig.yaml', 'variation: {trial: {placement_m: 5.0e-4}}'),),
    ),
    replace(
        BASE,
        name='sensor with ten times the noise',
        description=(('rig.yaml', 'load_cell: {noise_n: 0.04}'),),
    ),
    replace(
        BASE,
        name='drive stops within a whole count (rms)',
        description=(('rig.yaml', 'variation: {trial: {tendon_zero_m: 1.5e-5}}'),),
    ),
    replace(
        BASE,
        name='guide and drive repeat exactly',
        description=(('rig.yaml', f'variation: {{trial: {NO_DEVIATION}}}'),),
    ),
    replace(
        BASE,
        name='no creep of the finger',
        description=tuple((f'finger_{c}.yaml', 'creep_stiffness_nm_rad: 0') for c in CONTACTS),
    ),
    replace(BASE, name='3 s of rest before the glide', settle_s=3.0),
    replace(BASE, name='features in mN', newton=1e3),
    replace(BASE, name='|FFT| not divided by the length', plain_fft=True),
    replace(BASE, name='gamma auto', gamma='auto'),
    replace(BASE, name='scaled', scaled=True),
    replace(BASE, name='gamma auto, mN', gamma='auto', newton=1e3),
    replace(BASE, name='gamma auto, |FFT| not divided', gamma='auto', plain_fft=True),
    replace(
        BASE,
        name='gamma auto, mN, guide and drive repeat exactly',
        gamma='auto',
        newton=1e3,
        description=(('rig.yaml', f'variation: {{trial: {NO_DEVIATION}}}'),),
    ),
    replace(BASE, name='gamma auto, mN, line removed', gamma='auto', newton=1e3, detrend='linear'),
    replace(
        BASE,
        name='gamma auto, |FFT| not divided, line removed',
        gamma='auto',
        plain_fft=True,
        detrend='linear',
    ),
)


@lru_cache
def make_windows(
    protocol: str,
    contact: str,
    seed: int,
    per_mounting: int,
    description: tuple[tuple[str, str], ...],
    settle_s: float,
    trials: int = TRIALS,
) -> tuple[FloatArray, NDArray[np.str_], float]:
    """Simulate the windows that features come from.

    Returns
    -------
    windows : ndarray of float, shape (trials of all labels, samples)
    labels : ndarray of str
    rate_hz
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, text in description:
            (Path(folder) / name).write_text(text, 'utf-8')
        catalogue = Catalogue(Path(folder))
    config = replace(TrialConfig(), settle_s=settle_s)
    planned = plan_trial(config, TrialRequest(protocol, contact), catalogue)
    window = find_window(protocol, planned)
    labels = catalogue.labels(protocol)
    rows = [
        simulate_trials(
            protocol,
            label,
            contact,
            planned.timeline,
            trials,
            seed,
            trials_per_mounting=per_mounting,
            catalogue=catalogue,
        ).tension_n[:, window]
        for label in labels
    ]
    return np.concatenate(rows), np.repeat(labels, trials), planned.rate_hz


def compute_features(protocol: str, contact: str, seed: int, setting: Setting) -> FloatArray:
    """Features as the setting wants them, shape (trials, k)."""
    windows, _, rate_hz = make_windows(protocol, contact, seed, *setting.motion)  # type: ignore[arg-type]
    if protocol == 'texture':
        values = compute_spectrum(detrend(windows, type=setting.detrend))
        factor = setting.newton * (windows.shape[1] / 2 if setting.plain_fft else 1.0)
        return np.asarray(factor * values)
    times_ns = np.rint(1e9 / rate_hz * np.arange(windows.shape[1])).astype(np.int64)
    values = compute_regression(times_ns, windows)
    return np.asarray(values * [setting.newton, setting.newton, 1.0])


def score(values: FloatArray, labels: NDArray[np.str_], setting: Setting, seed: int) -> FloatArray:
    """Accuracy of the four classifiers in six stratified folds, shape (4,)."""
    estimators = (
        KNeighborsClassifier(3),
        SVC(kernel='linear', max_iter=1_000_000),
        SVC(kernel='rbf', gamma=setting.gamma),
        DecisionTreeClassifier(random_state=0),
    )
    folds = StratifiedKFold(6, shuffle=True, random_state=seed)
    found = []
    for estimator in estimators:
        whole = make_pipeline(StandardScaler(), estimator) if setting.scaled else estimator
        found.append(cross_val_score(whole, values, labels, cv=folds).mean())
    return np.array(found)


def find_alike(values: FloatArray, labels: NDArray[np.str_]) -> list[str]:
    """Name pairs of objects, and the feature in which the rank-sum test finds them alike."""
    found = rank_sum_p_values(values, labels)
    return [
        f'{name} {found.labels[j]}/{found.labels[i]}'
        for name, p in zip(('slope', 'intercept', 'correlation'), found.p, strict=True)
        for i in range(len(found.labels))
        for j in range(i)
        if p[i, j] > SIMILAR
    ]


def run_published(quick: bool) -> Report:
    """Change one setting at a time, and look at the paper's statements."""
    rows: list[Row] = []
    seeds: Sequence[int] = SEEDS[:1] if quick else SEEDS
    for setting in SETTINGS[:2] if quick else SETTINGS:
        for contact in CONTACTS:
            more: dict[str, object] = {}
            for protocol in ('texture', 'stiffness'):
                scores, above, alike = [], [], set()
                for seed in seeds:
                    values = compute_features(protocol, contact, seed, setting)
                    labels = make_windows(protocol, contact, seed, *setting.motion)[1]  # type: ignore[arg-type]
                    scores.append(score(values, labels, setting, seed))
                    if protocol == 'texture':
                        mean_p = rank_sum_p_values(values, labels).mean_p[1:]
                        above.append(int((mean_p > SIMILAR).sum()))
                    else:
                        alike |= set(find_alike(values, labels))
                mean = 100 * np.mean(scores, axis=0)
                more[protocol] = '/'.join(f'{value:.1f}' for value in mean)
                if protocol == 'texture':
                    more['p > 0.05'] = f'{min(above)}-{max(above)}'
                else:
                    more['alike'] = len(alike)
            rows.append(Row(f'{setting.name}; {contact}', more=more))
    return Report(
        'published: the statements of the paper on SIMULATED trials',
        'none',
        f'accuracy in % of {"/".join(NAMES)}, six stratified folds, mean of {len(seeds)} seeds; '
        f'components of 90 with a mean p above {SIMILAR:g}, least and most of the seeds; pairs of '
        'objects that one of the three stiffness features does not tell apart in some seed',
        rows,
    )
