# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Other people's features beside ours on the same trials, in the same run.

MiniRocket and MultiRocket come from aeon and many statistics from tsfresh: ``pip install aeon
tsfresh`` into the environment that runs this. What is not installed is left out, with a sentence.
All methods get the same signals, with their level. Every random choice (kernels, folds) is drawn
`SEEDS` times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
import importlib.util
from pathlib import Path
import sys
import time
from typing import Any
import warnings

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import RidgeClassifierCV
from sklearn.model_selection import StratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.accuracy.speeds import (
    FABRIC_FINEST_M,
    FABRIC_LENGTH_M,
    Glides,
    over_distance,
    simulate,
    SIMULATED_FINEST_M,
)
from benchmarks.measuring import Report, Row
from benchmarks.recordings import FABRIC_SLIDE, find_recording, PHAC_HOLD, say_missing
from tactile_classifier.datasets.archive import load_archive
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.records import ROCKET
from tactile_features import (
    compute_spatial,
    compute_spectrum,
    FeatureConfig,
    features_from_trials,
    SpatialWindow,
)
from tactile_features.feature_sets.waveforms import average_parts, HOLD_PARTS

Array = NDArray[Any]

ROCKETS = ('MiniRocket', 'MultiRocket')
SEEDS = 5

Transform = Callable[[Array], Array]


@dataclass(frozen=True)
class Method:
    """Features of glides, and the estimator on them.

    ``fit`` takes signals and a seed, and returns the transformation of signals into features. It
    learns on the signals of the training where ``learns`` says so. ``build`` takes a seed.
    """

    name: str
    fit: Callable[[Array, int], Transform]
    build: Callable[[int], Any]
    learns: bool = False


def rocket(name: str, compute: Transform) -> Method:
    """Return random convolutions of a waveform, as `tactile train` fits them."""

    def build(seed: int) -> Any:
        # Its two sets of kernels take two states.
        return build_estimator(ROCKET, 'none').set_params(classify__random_state=2 * seed)

    return Method(f'{name}, rocket', fixed(compute), build)


def spectrum(detrend: str) -> Method:
    """Return the spectrum with neighbours; the paper takes the mean away, our default the line."""
    return Method(
        f'texture_spectrum without its {detrend}, 3 neighbours'.replace('linear', 'line'),
        fixed(partial(compute_spectrum, detrend=detrend)),
        lambda _: build_estimator('knn', 'none'),
    )


def fixed(compute: Transform) -> Callable[[Array, int], Transform]:
    """Return what learns nothing from the training signals."""
    return lambda _x, _seed: compute


def fit_aeon(name: str, x: Array, seed: int) -> Transform:
    """Return a transformation of aeon's with biases from the training signals.

    Signals have the shape (trials, samples) or (trials, channels, samples).
    """
    from aeon.transformations.collection import convolution_based

    def shape(rows: Array) -> Array:
        return rows.reshape(len(rows), -1, rows.shape[-1]).astype(np.float32)

    rocket = getattr(convolution_based, name)(random_state=seed)
    rocket.fit(shape(x))
    return lambda rows: np.asarray(rocket.transform(shape(rows)))


def compute_tsfresh(x: Array) -> Array:
    """Return tsfresh's efficient set, without what is undefined for some trial."""
    import pandas
    from tsfresh import extract_features
    from tsfresh.feature_extraction import EfficientFCParameters

    trials, samples = x.shape
    frame = pandas.DataFrame(
        {'id': np.repeat(np.arange(trials), samples), 'tension': x.reshape(-1)}
    )
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        table = extract_features(
            frame,
            column_id='id',
            default_fc_parameters=EfficientFCParameters(),
            disable_progressbar=True,
            n_jobs=0,
        )
    return np.nan_to_num(table.to_numpy(np.float64), posinf=0.0, neginf=0.0)


def ridge(_seed: int = 0) -> Any:
    """Return the linear classifier that MiniRocket's authors use."""
    return make_pipeline(
        StandardScaler(with_mean=False), RidgeClassifierCV(alphas=np.logspace(-3, 4, 10))
    )


def peers() -> list[Method]:
    """Return the peers that are installed, and neighbours of the raw signal."""
    methods = [
        Method('raw neighbour', fixed(lambda x: x), lambda _: KNeighborsClassifier(n_neighbors=1))
    ]
    if importlib.util.find_spec('aeon'):
        methods += [
            Method(f'{name}, ridge', partial(fit_aeon, name), ridge, learns=True)
            for name in ROCKETS
        ]
    if importlib.util.find_spec('tsfresh'):
        methods.append(
            Method(
                'tsfresh, scaled ridge',
                fixed(compute_tsfresh),
                lambda _: make_pipeline(
                    StandardScaler(), RidgeClassifierCV(alphas=np.logspace(-3, 4, 10))
                ),
            )
        )
    return methods


Split = Iterator[tuple[Array, Array]]


def plain_folds(label: Array, seed: int) -> Split:
    """Yield six stratified folds, once."""
    yield from StratifiedKFold(6, shuffle=True, random_state=seed).split(label, label)


def held_out(group: Array, _seed: int = 0) -> Split:
    """Yield each group as the test, all others as training."""
    for value in np.unique(group):
        yield np.flatnonzero(group != value), np.flatnonzero(group == value)


@dataclass(frozen=True)
class Found:
    """Accuracies [%], one a seed; times of training a fold and of one window [s]."""

    accuracies: list[float]
    train_s: float
    window_s: float


class Candidate:
    """A method on one set of trials: features that learn nothing are computed once.

    Parameters
    ----------
    method : Method
    x : ndarray of shape (trials, samples)
    label : ndarray of shape (trials,)
    """

    def __init__(self, method: Method, x: Array, label: Array) -> None:
        self._method = method
        self._x = x
        self._label = label
        self._values: Array | None = None
        self._row_s = 0.0
        if not method.learns:
            start_s = time.perf_counter()
            self._values = method.fit(x, 0)(x)
            self._row_s = (time.perf_counter() - start_s) / len(x)

    def measure(self, split: Callable[[int], Split]) -> Found:
        """Return accuracies of all seeds, and times: training a fold, one window of the test."""
        accuracies: list[float] = []
        train_s: list[float] = []
        window_s: list[float] = []
        for seed in range(SEEDS):
            right: list[Array] = []
            for train, test in split(seed):
                start_s = time.perf_counter()
                transform = self._method.fit(self._x[train], seed)
                known = self._values
                values = transform(self._x[train]) if known is None else known[train]
                estimator = self._method.build(seed).fit(values, self._label[train])
                train_s.append(time.perf_counter() - start_s + self._row_s * len(train))
                values = transform(self._x[test]) if known is None else known[test]
                right.append(estimator.predict(values) == self._label[test])
                start_s = time.perf_counter()
                estimator.predict(transform(self._x[test[:1]]))
                window_s.append(time.perf_counter() - start_s)
            accuracies.append(100 * float(np.mean(np.concatenate(right))))
        return Found(accuracies, float(np.median(train_s)), float(np.median(window_s)))


def compare(
    title: str,
    ours: list[Method],
    x: Array,
    label: Array,
    splits: dict[str, Callable[[int], Split]],
) -> list[Row]:
    """Return one row for each method and split; times are over those of our first method."""
    candidates = {method.name: Candidate(method, x, label) for method in [*ours, *peers()]}
    rows = []
    for split_name, split in splits.items():
        floor: Found | None = None
        for name, candidate in candidates.items():
            found = candidate.measure(split)
            floor = floor or found
            low, high = min(found.accuracies), max(found.accuracies)
            more = {
                'accuracy, %': f'{np.mean(found.accuracies):.1f} ({low:.1f} to {high:.1f})',
                'training / ours': found.train_s / floor.train_s,
                'one window / ours': found.window_s / floor.window_s,
            }
            rows.append(Row(f'{title}, {split_name}: {name}', more=more))
            sys.stderr.write(f'{rows[-1].case}: {more}\n')  # it takes long
    return rows


def run_peers(quick: bool) -> Report:
    """Compare on two public recordings, where they are, and on simulated plates."""
    rows = [
        Row(f'{name} is not installed: left out; pip install {name}')
        for name in ('aeon', 'tsfresh')
        if not importlib.util.find_spec(name)
    ]
    if not quick:
        for name, measure in ((FABRIC_SLIDE, _fabrics), (PHAC_HOLD, _holds)):
            path = find_recording(name)
            rows += measure(path) if path else [Row(say_missing(name))]
    rows += _simulated()
    return Report(
        title=f'peers on the same trials; accuracy: mean (range) of {SEEDS} seeds',
        floor='our first method of each case: training of a fold, and one window through scikit-'
        'learn, features included (through the model file it is faster; see inference)',
        error='none: this topic is about accuracy',
        rows=rows,
    )


def spatial_waveform(glides: Glides) -> Array:
    """Return the features of the set ``spatial_waveform``."""
    config = FeatureConfig(
        texture_features='spatial_waveform',
        spatial_length_m=FABRIC_LENGTH_M,
        spatial_finest_m=FABRIC_FINEST_M,
    )
    return features_from_trials(
        'texture', glides.x, glides.rate_hz, config=config, speeds_m_s=glides.speed_m_s
    )[0]


def _fabrics(path: Path) -> list[Row]:
    trials = load_archive(path).where('balanced')
    x, label = trials.signal(0), trials.label
    speed, force = trials.columns['speed_mm_s'], trials.columns['force_set']
    splits = {
        'six folds': partial(plain_folds, label),
        'one speed held out': partial(held_out, speed),
        'one speed and force held out': partial(held_out, 1000 * speed + force),
    }
    # The peers know no speed; these take each row with its speed, by looking it up.
    place = {row.tobytes(): i for i, row in enumerate(x)}

    def by_speed(view: Callable[[Glides], Array]) -> Transform:
        def compute(rows: Array) -> Array:
            at = [place[row.tobytes()] for row in rows]
            return view(Glides(rows, label[at], speed[at] / 1e3, trials.rate_hz))

        return compute

    spatial = Method(
        f'texture_spatial {1e3 * FABRIC_FINEST_M:g} mm, linear SVM',
        fixed(by_speed(over_distance())),
        lambda _: build_estimator('svm_linear', 'none'),
    )
    resampled = by_speed(spatial_waveform)

    def fit_over_mm(name: str, rows: Array, seed: int) -> Transform:
        transform = fit_aeon(name, resampled(rows), seed)
        return lambda others: transform(resampled(others))

    methods = [spectrum('linear'), spectrum('mean'), spatial]
    methods.append(rocket('glide_waveform', lambda rows: rows))
    methods.append(rocket('spatial_waveform', resampled))
    if importlib.util.find_spec('aeon'):
        methods += [
            Method(f'{name} over mm, ridge', partial(fit_over_mm, name), ridge, learns=True)
            for name in ROCKETS
        ]
    return compare('fabrics, channel 0', methods, x, label, splits)


def _holds(path: Path) -> list[Row]:
    trials = load_archive(path).between(1.0, 5.0)
    label = trials.label
    ours = Method(
        'stiffness_regression, scaled 3 neighbours',
        fixed(lambda rows: features_from_trials('stiffness', rows, trials.rate_hz)[0]),
        lambda _: build_estimator('knn', 'standard'),
    )
    splits = {'six folds': partial(plain_folds, label)}
    waveform = rocket('hold_waveform', lambda rows: average_parts(rows, HOLD_PARTS))
    return compare('holds', [ours, waveform], trials.signal(0), label, splits)


def _simulated() -> list[Row]:
    glides = simulate(15)
    session = np.tile(np.repeat(np.arange(4), 5), len(np.unique(glides.label)))
    window = SpatialWindow(0.04475, SIMULATED_FINEST_M)  # the same 180 samples
    spatial = Method(
        'texture_spatial 0.5 mm, scaled RBF SVM',
        fixed(lambda rows: compute_spatial(rows, 0.015, glides.rate_hz, window)),
        lambda _: build_estimator('svm_rbf', 'standard'),
    )
    splits = {'one session held out': partial(held_out, session)}
    ours = [spectrum('linear'), spectrum('mean'), spatial]
    ours.append(rocket('glide_waveform', lambda rows: rows))
    return compare('SIMULATED plates', ours, glides.x[:, 36:216], glides.label, splits)
