# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy for real fabrics at a sliding speed that is not in the training trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.measuring import Report, Row
from benchmarks.recordings import FABRIC_SLIDE, find_recording, read_fabrics, say_missing
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.types import CLASSIFIERS, SCALINGS
from tactile_features import compute_spectrum, FeatureConfig, features_from_trials

Array = NDArray[Any]

LENGTH_M = 0.048
"""Length of the path of the slowest glides, without one sample at each end [m]."""

FINEST_M = 0.003
"""Finest scale of the features over distance [m].

At the highest speed, 100 mm/s, and the sample rate of 35.6 Hz, samples are 2.8 mm apart.
"""

AWAY_M = (-0.012, -0.006, 0.006, 0.012)


@dataclass(frozen=True)
class Glides:
    """Glides of equal length: signals (trials, samples), labels (trials,), speeds (trials,)."""

    x: Array
    label: Array
    speed_m_s: Array
    rate_hz: float

    def moved(self, by_m: float) -> Glides:
        """Return the glides as if they had started ``by_m`` later on their path.

        Glides that are too short for this are left out.
        """
        step_m = self.speed_m_s / self.rate_hz
        room_m = step_m * (self.x.shape[1] - 3) - 2 * abs(by_m)
        long = room_m >= LENGTH_M
        places = np.rint(by_m / step_m[long]).astype(int)
        rows = [np.roll(row, -place) for row, place in zip(self.x[long], places, strict=True)]
        return replace(
            self, x=np.array(rows), label=self.label[long], speed_m_s=self.speed_m_s[long]
        )


View = Callable[[Glides], Array]


def over_distance(glides: Glides, features: str = 'texture_spatial') -> Array:
    """Return the features of one of the feature sets over distance."""
    config = FeatureConfig(
        texture_features=features, spatial_length_m=LENGTH_M, spatial_finest_m=FINEST_M
    )
    return features_from_trials(
        'texture', glides.x, glides.rate_hz, config=config, speeds_m_s=glides.speed_m_s
    )[0]


def waveform(glides: Glides) -> Array:
    """Return the smoothed signal over the middle of the path, with its mean subtracted."""
    count = glides.x.shape[1]
    at_s = (np.arange(count) - (count - 1) / 2) / glides.rate_hz
    grid_m = ((np.arange(24) + 0.5) / 24 - 0.5) * LENGTH_M
    rows = []
    for row, speed_m_s in zip(glides.x, glides.speed_m_s, strict=True):
        apart = (grid_m[:, None] - speed_m_s * at_s) / FINEST_M
        weights = np.exp(-0.5 * apart**2)
        rows.append(weights @ row / weights.sum(axis=1))
    values: Array = np.array(rows)
    return values - values.mean(axis=1, keepdims=True)


def over_time(glides: Glides) -> Array:
    """Return the features of the paper: the spectrum over time of the signals without mean."""
    return compute_spectrum(glides.x, detrend='mean')


ESTIMATORS: dict[str, Callable[[], Any]] = {
    f'{name}, {scaling}': lambda name=name, scaling=scaling: build_estimator(name, scaling)
    for name in CLASSIFIERS
    for scaling in SCALINGS
}
ESTIMATORS['discriminant, standard'] = lambda: make_pipeline(
    StandardScaler(), LinearDiscriminantAnalysis(solver='lsqr', shrinkage='auto')
)
TREES = 'extra trees, none'
ESTIMATORS[TREES] = lambda: ExtraTreesClassifier(150, random_state=0)

Table = tuple[Array, Array, Array]
"""Features, labels and speeds [m/s]."""


def make_table(view: View, glides: Glides) -> Table:
    """Return the features of glides, with their labels and speeds."""
    return view(glides), glides.label, glides.speed_m_s


def hold_out(case: str, train: Table, tests: Sequence[Table], names: Sequence[str]) -> Row:
    """Measure the accuracy at each speed with models that were trained on the other speeds.

    If ``names`` has several classifiers, one of them is chosen for each held-out speed, by
    cross-validation over the other speeds. Trials of all ``tests`` are tested.
    """
    values, label, speed_m_s = train
    speeds = np.unique(np.concatenate([speed for _, _, speed in tests]))

    def accuracy(name: str, test_m_s: float, tables: Sequence[Table], without: Array) -> float:
        kept = ~np.isin(speed_m_s, without)
        fitted = ESTIMATORS[name]().fit(values[kept], label[kept])
        right = [
            fitted.predict(v[s == test_m_s]) == y[s == test_m_s]
            for v, y, s in tables
            if np.any(s == test_m_s)
        ]
        return float(100 * np.mean(np.concatenate(right)))

    more: dict[str, Any] = {'accuracy, %': ''}
    found, chosen = [], []
    for held in speeds:
        means = {
            name: np.mean(
                [accuracy(name, s, [train], np.array([held, s])) for s in speeds if s != held]
            )
            for name in (names if len(names) > 1 else ())
        }
        chosen.append(max(means, key=lambda n: means[n]) if means else names[0])
        found.append(accuracy(chosen[-1], held, tests, np.array([held])))
        more[f'{1e3 * held:g} mm/s'] = f'{found[-1]:.0f}'
    more['accuracy, %'] = f'{np.mean(found):.1f}'
    more['chosen'] = '; '.join(dict.fromkeys(chosen))
    return Row(case, more=more)


def run_speeds(quick: bool) -> Report:
    """Measure the accuracy at each sliding speed of the fabrics, with this speed held out."""
    rows = [Row(say_missing(FABRIC_SLIDE))]
    if find_recording(FABRIC_SLIDE) is not None:
        trials = read_fabrics()
        speed_m_s = trials.columns['speed_mm_s'] / 1e3
        channels = [
            Glides(signals, trials.label, speed_m_s, trials.rate_hz)
            for signals in (trials.x.mean(axis=1), *np.moveaxis(trials.x, 1, 0))
        ]
        rows = _measure(channels, tuple(ESTIMATORS)[: 2 if quick else None])
    return Report(
        'texture at a sliding speed that is not in the training trials',
        '',
        'each speed is held out once; the classifier is chosen by holding out each of the other '
        'speeds',
        rows,
    )


def _measure(channels: Sequence[Glides], names: Sequence[str]) -> list[Row]:
    """Return the rows of the report.

    Features are computed from the first channel, from the mean of all channels, and from each
    channel, in which case the features of all channels are concatenated. The first element of
    ``channels`` is the mean.
    """
    mean, *each = channels
    rows = []
    views: dict[str, View] = {'waveform over mm': waveform, 'texture_spatial': over_distance}
    for title, one in (('channel 0', each[0]), ('mean of 16', mean)):
        for name, view in ({'over time (paper)': over_time} | views).items():
            table = make_table(view, one)
            rows.append(hold_out(f'{title}: {name}', table, [table], names))
        for name, view in views.items():
            away = [make_table(view, one.moved(by_m)) for by_m in AWAY_M]
            case = f'{title}: {name}, met 6 and 12 mm away'
            rows.append(hold_out(case, make_table(view, one), away, [TREES]))
    for name, view in views.items():
        table = np.hstack([view(one) for one in each]), mean.label, mean.speed_m_s
        rows.append(hold_out(f'16 channels: {name}', table, [table], names))
    return rows
