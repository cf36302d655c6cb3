# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparison with the features of other libraries on the same trials, in the same run.

The features of other libraries are MiniRocket and MultiRocket of aeon, and the statistics of
tsfresh. Install the libraries with ``pip install aeon tsfresh``. Libraries that are not installed
are reported and omitted. All methods use the same signals, whose mean is not subtracted. Random
choices (kernels, folds) are repeated with `SEEDS` seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
import importlib.util
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

from benchmarks.accuracy.speeds import FINEST_M, LENGTH_M
from benchmarks.measuring import Report, Row
from benchmarks.recordings import (
    FABRIC_SLIDE,
    find_recording,
    PHAC_HOLD,
    read_fabrics,
    read_holds,
    Recording,
    say_missing,
)
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.types import ROCKET
from tactile_features import compute_spectrum, FeatureConfig, features_from_trials
from tactile_features.feature_sets.waveforms import average_parts, HOLD_PARTS

Array = NDArray[Any]

ROCKETS = ('MiniRocket', 'MultiRocket')
SEEDS = 5

Transform = Callable[[Array], Array]


@dataclass(frozen=True)
class Method:
    """Features of glides, and the estimator for these features.

    ``fit`` takes signals and a seed, and returns the transformation of signals to features. If
    ``learns`` is True, the transformation is fitted to the training signals. ``build`` takes a
    seed, and returns the estimator.
    """

    name: str
    fit: Callable[[Array, int], Transform]
    build: Callable[[int], Any]
    learns: bool = False


def rocket(name: str, compute: Transform) -> Method:
    """Return a method: random convolutions of a waveform, classified as in `tactile train`.

    ``compute`` returns the waveform of a signal.
    """

    def build(seed: int) -> Any:
        # The classifier has two sets of kernels, which use this random state and the next one.
        return build_estimator(ROCKET, 'none').set_params(classify__random_state=2 * seed)

    return Method(f'{name}, rocket', fixed(compute), build)


def fixed(compute: Transform) -> Callable[[Array, int], Transform]:
    """Return a `fit` function for a transformation that is not fitted."""
    return lambda _x, _seed: compute


def fit_aeon(name: str, view: Transform | None, x: Array, seed: int) -> Transform:
    """Fit a transformation of aeon to the training signals.

    The transformation is applied to the result of ``view``, or to the signals if ``view`` is None.
    Both have the shape (trials, samples) or (trials, channels, samples).
    """
    from aeon.transformations.collection import convolution_based

    def shape(rows: Array) -> Array:
        rows = rows if view is None else view(rows)
        return rows.reshape(len(rows), -1, rows.shape[-1]).astype(np.float32)

    rocket = getattr(convolution_based, name)(random_state=seed)
    rocket.fit(shape(x))
    return lambda rows: np.asarray(rocket.transform(shape(rows)))


def compute_tsfresh(x: Array) -> Array:
    """Return tsfresh's "efficient" features, except those that are undefined for some trial."""
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
    """Return the linear classifier used by the authors of MiniRocket."""
    return make_pipeline(
        StandardScaler(with_mean=False), RidgeClassifierCV(alphas=np.logspace(-3, 4, 10))
    )


def peers() -> list[Method]:
    """Return the methods of installed libraries, and a nearest-neighbour classifier of signals."""
    methods = [
        Method('raw neighbour', fixed(lambda x: x), lambda _: KNeighborsClassifier(n_neighbors=1))
    ]
    if importlib.util.find_spec('aeon'):
        methods += [
            Method(f'{name}, ridge', partial(fit_aeon, name, None), ridge, learns=True)
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
    """Yield the training and test indices of six stratified folds."""
    yield from StratifiedKFold(6, shuffle=True, random_state=seed).split(label, label)


def held_out(group: Array, _seed: int = 0) -> Split:
    """Yield the training and test indices of leave-one-group-out splits."""
    for value in np.unique(group):
        yield np.flatnonzero(group != value), np.flatnonzero(group == value)


class MethodOnTrials:
    """A method applied to one set of trials.

    Features that are not fitted are computed only once.

    ``x`` has shape (trials, samples), ``label`` has shape (trials,).
    """

    def __init__(self, method: Method, x: Array, label: Array) -> None:
        self._method, self._x, self._label = method, x, label
        start_s = time.perf_counter()
        self._values = None if method.learns else method.fit(x, 0)(x)
        self._features_s = (time.perf_counter() - start_s) / len(x)

    def measure(
        self, split: Callable[[int], Split], seeds: int
    ) -> tuple[list[float], float, float]:
        """Return the accuracy of each seed [%], and two computing times [s].

        The first time is the median for features and prediction of one window. The second time is
        the median for one training.
        """
        accuracies: list[float] = []
        window_s: list[float] = []
        training_s: list[float] = []
        for seed in range(seeds):
            right: list[Array] = []
            for train, test in split(seed):
                start_s = time.perf_counter()
                transform = self._method.fit(self._x[train], seed)
                known = self._values
                values = transform(self._x[train]) if known is None else known[train]
                estimator = self._method.build(seed).fit(values, self._label[train])
                before_s = 0.0 if known is None else self._features_s * len(train)
                training_s.append(time.perf_counter() - start_s + before_s)
                values = transform(self._x[test]) if known is None else known[test]
                right.append(estimator.predict(values) == self._label[test])
                start_s = time.perf_counter()
                estimator.predict(transform(self._x[test[:1]]))
                window_s.append(time.perf_counter() - start_s)
            accuracies.append(100 * float(np.mean(np.concatenate(right))))
        return accuracies, float(np.median(window_s)), float(np.median(training_s))


def compare(
    title: str,
    ours: list[Method],
    x: Array,
    label: Array,
    splits: dict[str, Callable[[int], Split]],
    seeds: int,
) -> list[Row]:
    """Return one row of the report for each method and each split."""
    rows = []
    for method in [*ours, *peers()]:
        candidate = MethodOnTrials(method, x, label)
        for split_name, split in splits.items():
            found, window_s, training_s = candidate.measure(split, seeds)
            more = {
                'accuracy, %': f'{np.mean(found):.1f} ({min(found):.1f} to {max(found):.1f})',
                'window [ms]': 1e3 * window_s,
                'training [s]': training_s,
            }
            rows.append(Row(f'{title}, {split_name}: {method.name}', more=more))
            sys.stderr.write(f'{rows[-1].case}: {more}\n')
    return rows


def run_peers(quick: bool) -> Report:
    """Compare all methods on two public recordings, if they are available."""
    rows = [
        Row(f'left out: {name} is not installed (pip install {name})')
        for name in ('aeon', 'tsfresh')
        if not importlib.util.find_spec(name)
    ]
    seeds = 1 if quick else SEEDS
    for name, measure in ((FABRIC_SLIDE, _fabrics), (PHAC_HOLD, _holds)):
        rows += measure(seeds) if find_recording(name) else [Row(say_missing(name))]
    return Report(
        title=f'peers on the same trials; accuracy: mean (range) of {seeds} seeds; window: '
        'time of features and prediction with scikit-learn',
        floor='',
        error='',
        rows=rows,
    )


def compute_by_speed(trials: Recording, x: Array, name: str, rows: Array) -> Array:
    """Return the features of the set ``name`` for ``rows``, which are signals from ``x``.

    The speed of each glide is needed, but `Method` only passes signals. Therefore each signal is
    searched in ``x``, whose order is that of the speeds in ``trials``.
    """
    place = {row.tobytes(): i for i, row in enumerate(x)}
    config = FeatureConfig(
        texture_features=name, spatial_length_m=LENGTH_M, spatial_finest_m=FINEST_M
    )
    speeds = trials.columns['speed_mm_s'][[place[row.tobytes()] for row in rows]] / 1e3
    return features_from_trials('texture', rows, trials.rate_hz, config=config, speeds_m_s=speeds)[
        0
    ]


def _fabrics(seeds: int) -> list[Row]:
    trials = read_fabrics()
    x, label = trials.x[:, 0], trials.label
    speed, force = trials.columns['speed_mm_s'], trials.columns['force_set']
    splits = {
        'six folds': partial(plain_folds, label),
        'one speed held out': partial(held_out, speed),
        'one speed and force held out': partial(held_out, 1000 * speed + force),
    }
    by_speed = partial(compute_by_speed, trials, x)
    spatial = Method(
        f'texture_spatial {1e3 * FINEST_M:g} mm, linear SVM',
        fixed(partial(by_speed, 'texture_spatial')),
        lambda _: build_estimator('svm_linear', 'none'),
    )
    resampled = partial(by_speed, 'spatial_waveform')
    spectrum = Method(
        'texture_spectrum without its line, 3 neighbours',
        fixed(partial(compute_spectrum, detrend='linear')),
        lambda _: build_estimator('knn', 'none'),
    )
    methods = [
        spectrum,
        spatial,
        rocket('glide_waveform', lambda rows: rows),
        rocket('spatial_waveform', resampled),
    ]
    if importlib.util.find_spec('aeon'):
        methods += [
            Method(
                f'{name} over mm, ridge', partial(fit_aeon, name, resampled), ridge, learns=True
            )
            for name in ROCKETS
        ]
    return compare('fabrics, channel 0', methods, x, label, splits, seeds)


def _holds(seeds: int) -> list[Row]:
    trials = read_holds()
    label = trials.label
    ours = Method(
        'stiffness_regression, scaled 3 neighbours',
        fixed(lambda rows: features_from_trials('stiffness', rows, trials.rate_hz)[0]),
        lambda _: build_estimator('knn', 'standard'),
    )
    splits = {'six folds': partial(plain_folds, label)}
    waveform = rocket('hold_waveform', lambda rows: average_parts(rows, HOLD_PARTS))
    return compare('holds', [ours, waveform], trials.x[:, 0], label, splits, seeds)
