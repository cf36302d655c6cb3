# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials, features, classifiers and cross-validation of the paper (sections III and IV)."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
import tempfile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from sklearn.model_selection import cross_val_score, RepeatedStratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from benchmarks.simulator.trials import find_window
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

FloatArray = NDArray[np.float64]

TASKS = ('texture', 'stiffness')
CONTACTS = ('flexion', 'abduction')
CLASSIFIERS = ('neighbours', 'linear SVM', 'RBF SVM', 'tree')
TRIALS = 60
FOLDS = 6
REPETITIONS = 10
STIFFNESS_FEATURES = ('slope', 'intercept', 'correlation')


class Trials(NamedTuple):
    """Simulated trials of one task and contact.

    Attributes
    ----------
    values : ndarray of shape (trials, k)
        Features: 91 magnitudes of a glide [N], or slope [N/s], intercept [N] and correlation [1]
        of a hold.
    labels : ndarray of str, shape (trials,)
    """

    values: FloatArray
    labels: NDArray[np.str_]


@lru_cache
def make_trials(
    task: str, contact: str, seed: int, per_mounting: int = TRIALS, rig: str = '{}'
) -> Trials:
    """Simulate 60 trials of each label in one session, and compute the paper's features.

    The object is mounted again after every ``per_mounting`` trials. With the default of 60 it is
    mounted once.
    ``rig`` is YAML that replaces values of the packaged ``rig.yaml``.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / 'rig.yaml').write_text(rig, 'utf-8')
        catalogue = Catalogue(Path(folder))
    planned = plan_trial(TrialConfig(), TrialRequest(task, contact), catalogue)
    window = find_window(task, planned)
    labels = catalogue.labels(task)
    windows = [
        simulate_trials(
            task,
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
    values = compute_features(task, np.concatenate(windows), planned.rate_hz)
    return Trials(values, np.repeat(labels, TRIALS))


def compute_features(task: str, windows: FloatArray, rate_hz: float) -> FloatArray:
    """Return the paper's features (section III.B) of windows of shape (trials, samples) [N]."""
    if task == 'texture':
        return compute_spectrum(detrend(windows, type='constant'))
    times_ns = np.rint(1e9 / rate_hz * np.arange(windows.shape[1])).astype(np.int64)
    return compute_regression(times_ns, windows)


def in_unit(task: str, values: FloatArray, per_newton: float) -> FloatArray:
    """Convert features to another unit of force; one newton equals ``per_newton`` units."""
    if task == 'texture':
        return values * per_newton
    return values * [per_newton, per_newton, 1.0]


def cross_validate(
    values: FloatArray,
    labels: NDArray[np.str_],
    *,
    scaled: bool,
    gamma: str = 'scale',
    repetitions: int = REPETITIONS,
    seed: int = 0,
) -> FloatArray:
    """Return the accuracies of each classifier in repetitions of six stratified folds [1].

    The result has shape (4, repetitions), in the order of `CLASSIFIERS`. ``scaled`` features have
    zero mean and unit variance, fitted in each fold. ``gamma`` of the RBF SVM is ``scale``
    (scikit-learn since 0.22) or ``auto`` (before).
    """
    estimators = (
        KNeighborsClassifier(3),
        SVC(kernel='linear', max_iter=1_000_000),
        SVC(kernel='rbf', gamma=gamma),
        DecisionTreeClassifier(random_state=0),
    )
    scaler = StandardScaler() if scaled else FunctionTransformer()
    folds = RepeatedStratifiedKFold(n_splits=FOLDS, n_repeats=repetitions, random_state=seed)
    accuracies = [
        cross_val_score(make_pipeline(scaler, each), values, labels, cv=folds, n_jobs=-1)
        for each in estimators
    ]
    return np.array(accuracies).reshape(len(estimators), repetitions, FOLDS).mean(axis=-1)
