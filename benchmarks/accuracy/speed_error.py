# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plot of accuracy against computing time, for all feature sets, classifiers and peers.

    TACTILE_DATA=DIR ./tactile run python -m benchmarks.accuracy.speed_error --plot speed_error.png

Two public recordings are used: fabrics (channel 0, one sliding speed held out) and holds (one
repetition held out). Feature sets are computed with the code of the live node. Classifiers and
scalings are fixed; nothing is chosen by its accuracy. Training time includes features and fit of
all training trials. Window time includes features and prediction of one window with scikit-learn.
Peers are aeon's MiniRocket and MultiRocket with their ridge classifier, if aeon is installed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from functools import partial
import importlib.util
from pathlib import Path
import sys
from typing import Any, NamedTuple

import numpy as np

from benchmarks.accuracy.peers import (
    Array,
    compute_by_speed,
    fit_aeon,
    fixed,
    held_out,
    Method,
    MethodOnTrials,
    ridge,
    ROCKETS,
    Transform,
)
from benchmarks.recordings import (
    FABRIC_SLIDE,
    find_recording,
    PHAC_HOLD,
    read_fabrics,
    read_holds,
    say_missing,
)
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_classifier.types import CLASSIFIER_TITLES, CLASSIFIERS, ROCKET, SCALINGS
from tactile_features import FeatureConfig, features_from_trials

SEEDS = 3
WAVEFORMS = ('glide_waveform', 'spatial_waveform', 'hold_waveform')

COLOURS = {
    'texture_spectrum': '#1f5fae',
    'texture_spatial': '#17957f',
    'glide_waveform': '#d99100',
    'spatial_waveform': '#b3261e',
    'stiffness_regression': '#1f5fae',
    'stiffness_relaxation': '#17957f',
    'hold_waveform': '#b3261e',
    'aeon': '#555555',
}
MARKS = {'knn': 'o', 'svm_linear': 's', 'svm_rbf': 'D', 'tree': '^', ROCKET: '*', 'ridge': 'P'}


class Point(NamedTuple):
    """Result of a method on a recording.

    It contains the computing times of one window and of one training [s], the mean accuracy, and
    the lowest and highest accuracy over seeds [%].
    """

    recording: str
    features: str
    classifier: str
    scaling: str
    window_s: float
    training_s: float
    accuracy: float
    low: float
    high: float


def measure(seeds: int) -> Iterator[Point]:
    """Yield a point for each method on each available recording."""
    if find_recording(FABRIC_SLIDE):
        trials = read_fabrics()
        x = trials.x[:, 0]
        sets = ('texture_spectrum', 'texture_spatial', 'glide_waveform', 'spatial_waveform')
        views = {name: partial(compute_by_speed, trials, x, name) for name in sets}
        split = partial(held_out, trials.columns['speed_mm_s'])
        yield from _measure_all('fabrics', views, 'glide_waveform', x, trials.label, split, seeds)
    if find_recording(PHAC_HOLD):
        trials = read_holds()

        def of_hold(name: str, rows: Array) -> Array:
            config = FeatureConfig(stiffness_features=name)
            return features_from_trials('stiffness', rows, trials.rate_hz, config=config)[0]

        sets = ('stiffness_regression', 'stiffness_relaxation', 'hold_waveform')
        views = {name: partial(of_hold, name) for name in sets}
        split = partial(held_out, trials.columns['repetition'])
        x = trials.x[:, 0]
        yield from _measure_all('holds', views, 'hold_waveform', x, trials.label, split, seeds)


def _measure_all(
    recording: str,
    views: dict[str, Transform],
    raw: str,
    x: Array,
    label: Array,
    split: Callable[[int], Any],
    seeds: int,
) -> Iterator[Point]:
    """Yield the points of one recording.

    MiniRocket and MultiRocket of aeon are applied to waveforms. For the feature set ``raw``, they
    are applied to the signals themselves.
    """
    methods: list[tuple[str, str, str, Method, int]] = []
    for name, view in views.items():
        for classifier in CLASSIFIERS:
            for scaling in SCALINGS:
                build = partial(_build, classifier, scaling)
                methods.append((name, classifier, scaling, Method('', fixed(view), build), 1))
        if name in WAVEFORMS:
            build = partial(_build, ROCKET, 'none')
            methods.append((name, ROCKET, '', Method('', fixed(view), build), seeds))
    if importlib.util.find_spec('aeon'):
        for peer in ROCKETS:
            for name in WAVEFORMS:
                if name not in views:
                    continue
                view = views[name] if name != raw else None
                method = Method('', partial(fit_aeon, peer, view), ridge, learns=True)
                methods.append((f'{peer} on {name}', 'ridge', '', method, seeds))
    for name, classifier, scaling, method, count in methods:
        found, window_s, training_s = MethodOnTrials(method, x, label).measure(split, count)
        mean = float(np.mean(found))
        point = Point(
            recording,
            name,
            classifier,
            scaling,
            window_s,
            training_s,
            mean,
            min(found),
            max(found),
        )
        sys.stderr.write(f'{point}\n')
        yield point


def _build(classifier: str, scaling: str, seed: int) -> Any:
    estimator = build_estimator(classifier, scaling)
    if classifier == ROCKET:
        estimator.set_params(classify__random_state=2 * seed)
    return estimator


def draw(points: list[Point], path: Path) -> None:
    """Draw the accuracy against the times for one window and for one training."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    recordings = list(dict.fromkeys(point.recording for point in points))
    figure = Figure(figsize=(11, 4.4 * len(recordings)), layout='constrained')
    grid = figure.subplots(len(recordings), 2, squeeze=False, sharey='row')
    held = {'fabrics': 'one sliding speed held out', 'holds': 'one repetition held out'}
    for row, recording in zip(grid, recordings, strict=True):
        own = [point for point in points if point.recording == recording]
        chance = {'fabrics': 100 / 7, 'holds': 100 / 6}[recording]
        times = (lambda p: 1e3 * p.window_s, lambda p: p.training_s)
        for axes, time_of, unit in zip(
            row, times, ('one window [ms]', 'training [s]'), strict=True
        ):
            for point in own:
                is_peer = point.classifier == 'ridge'
                colour = COLOURS['aeon' if is_peer else point.features]
                axes.plot(
                    time_of(point),
                    point.accuracy,
                    MARKS[point.classifier],
                    color=colour,
                    mfc='white' if point.scaling == 'standard' else colour,
                    ms=11 if point.classifier == ROCKET else 7,
                )
                if is_peer:
                    is_slow = point.features.startswith('Multi')
                    axes.annotate(
                        point.features.replace('_waveform', '').replace(' on ', ', '),
                        (time_of(point), point.accuracy),
                        xytext=(0 if is_slow else 7, -13 if is_slow else -3),
                        textcoords='offset points',
                        ha='center' if is_slow else 'left',
                        fontsize=7,
                    )
            axes.axhline(chance, color='#999999', lw=0.8, ls=':')
            axes.set_xscale('log')
            axes.margins(x=0.1)
            axes.set_xlabel(f'time: {unit}')
            axes.set_ylim(0, 102)
            axes.grid(alpha=0.25)
        row[0].set_ylabel('accuracy [%]')
        row[0].set_title(
            f'{recording}, {held[recording]}; dotted: chance', loc='left', fontsize=10
        )
        sets = list(dict.fromkeys(p.features for p in own if p.classifier != 'ridge'))
        row[1].legend(
            handles=[Line2D([], [], color=COLOURS[s], marker='o', ls='', label=s) for s in sets],
            loc='lower right',
            fontsize=8,
        )
    names = {**CLASSIFIER_TITLES, 'ridge': 'peers of aeon, ridge'}
    figure.legend(
        handles=[
            *(
                Line2D([], [], color='#333333', marker=mark, ls='', label=names.get(name, name))
                for name, mark in MARKS.items()
            ),
            Line2D([], [], color='#333333', marker='o', mfc='white', ls='', label='scaled'),
        ],
        loc='outside upper center',
        ncols=7,
        fontsize=8,
    )
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure all methods, and draw the plot."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    parser.add_argument('--plot', type=Path, required=True, help='picture to write')
    parser.add_argument('--seeds', type=int, default=SEEDS)
    arguments = parser.parse_args()
    points = list(measure(arguments.seeds))
    if not points:
        parser.error(say_missing(FABRIC_SLIDE))
    draw(points, arguments.plot)


if __name__ == '__main__':
    main()
