# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy with a wrong sample rate, or a wrong speed of the guide.

Models are trained on correct trials, and tested on trials whose sample rate or speed differs from
the stated value. In public recordings, the tested signals are stretched about the middle of the
window: if the sensor is 1 % faster than stated, there are more samples on the same path, and if
the guide is 1 % faster, there are fewer. SIMULATED trials are simulated with the other speed, in
other sessions than the training trials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.model_selection import LeaveOneGroupOut

from benchmarks.accuracy.speeds import FINEST_M, Glides, over_time
from benchmarks.measuring import Report, Row
from benchmarks.recordings import (
    FABRIC_SLIDE,
    find_recording,
    PHAC_HOLD,
    read_fabrics,
    read_holds,
    say_missing,
)
from benchmarks.simulator.robustness import make_features, score, Setting, Study
from tactile_bringup.trial_protocols import TrialConfig
from tactile_classifier.estimators.classifiers import build_estimator
from tactile_features import FeatureConfig, features_from_trials
from tactile_features.types import PROTOCOL_TEXTURE
from tactile_sim.descriptions.catalogue import default_catalogue

Array = NDArray[Any]

ERRORS = (-0.02, -0.01, 0.0, 0.01, 0.02)
"""Relative errors: true value divided by stated value, minus one [1]."""

MARGIN = 4
"""Number of samples at each end of a signal that are used only if the window is stretched."""

LENGTH_M = 0.045
"""Length of the path of the slowest glides without `MARGIN` samples at each end [m]."""


def stretch(x: Array, factor: float) -> Array:
    """Return the windows resampled at ``factor`` times the sample period.

    The windows have shape (trials, samples). Their middle stays in place, and `MARGIN` samples at
    each end are removed. The signal is interpolated by a cubic spline.
    """
    from scipy.interpolate import CubicSpline

    at = np.arange(x.shape[1]) - (x.shape[1] - 1) / 2
    return np.asarray(CubicSpline(at, x, axis=1)(factor * at[MARGIN:-MARGIN]))


def over_distance(glides: Glides, features: str = 'texture_spatial') -> Array:
    """Return the features of a set over distance, computed with the stated speeds."""
    config = FeatureConfig(
        texture_features=features, spatial_length_m=LENGTH_M, spatial_finest_m=FINEST_M
    )
    return features_from_trials(
        'texture', glides.x, glides.rate_hz, config=config, speeds_m_s=glides.speed_m_s
    )[0]


def run_rate_error(quick: bool) -> Report:
    """Test models on signals whose sample rate or guide speed differs from the stated value."""
    rows = [*_measure_fabrics(quick), *_measure_holds(), *_measure_simulated(quick)]
    return Report(
        'accuracy with a wrong sample rate or speed of the guide',
        '',
        'true value over stated value; accuracy without an error in %, and with one the '
        'difference in points',
        rows,
    )


def _measure_fabrics(quick: bool) -> list[Row]:
    if find_recording(FABRIC_SLIDE) is None:
        return [Row(say_missing(FABRIC_SLIDE))]
    trials = read_fabrics()
    columns = trials.columns
    speed_m_s = columns['speed_mm_s'] / 1e3
    group = np.char.add(columns['speed_mm_s'].astype(str), columns['force_set'].astype(str))
    glides = Glides(trials.x.mean(axis=1), trials.label, speed_m_s, trials.rate_hz)
    waveform = partial(over_distance, features='spatial_waveform')
    views: list[tuple[str, Callable[[Glides], Array], str, str]] = [
        ('texture_spectrum, 3 neighbours', over_time, 'knn', 'none'),
        ('texture_spatial, 3 neighbours', over_distance, 'knn', 'none'),
        ('spatial_waveform, convolutions', waveform, 'rocket', 'none'),
    ]
    rows = []
    for title, view, classifier, scaling in views[: 1 if quick else None]:
        # The path between two samples is shorter with a faster sensor, longer with a faster guide.
        for of, power in (('rate', -1), ('guide speed', 1)):
            tables = [
                view(replace(glides, x=stretch(glides.x, (1.0 + error) ** power)))
                for error in ERRORS
            ]
            found = hold_out(tables, glides.label, group, classifier, scaling)
            rows.append(_row(f'fabrics, {title}, {of}', found))
    return rows


def _measure_holds() -> list[Row]:
    if find_recording(PHAC_HOLD) is None:
        return [Row(say_missing(PHAC_HOLD))]
    trials = read_holds()
    tables = []
    for error in ERRORS:
        x = stretch(trials.x[:, 0], 1.0 / (1.0 + error))
        config = FeatureConfig()
        tables.append(features_from_trials('stiffness', x, trials.rate_hz, config=config)[0])
    group = trials.columns['repetition']
    found = hold_out(tables, trials.label, group, 'knn', 'standard')
    return [_row('holds, stiffness_regression, 3 neighbours, rate', found)]


def hold_out(
    tables: Sequence[Array], label: Array, group: Array, classifier: str, scaling: str
) -> list[float]:
    """Return the accuracy on each feature table, with each group held out once [%].

    There is one table for each value of `ERRORS`. Models are trained on the table without error.
    """
    right = np.zeros((len(tables), len(label)), dtype=bool)
    usual = tables[ERRORS.index(0.0)]
    for train, test in LeaveOneGroupOut().split(usual, label, group):
        fitted = build_estimator(classifier, scaling).fit(usual[train], label[train])
        for row, values in zip(right, tables, strict=True):
            row[test] = fitted.predict(values[test]) == label[test]
    return [float(100 * each.mean()) for each in right]


def _measure_simulated(quick: bool) -> list[Row]:
    study = Study(train_sessions=2, test_sessions=2, train_trials=4, test_trials=3)
    if quick:
        study = replace(study, train_sessions=1, test_sessions=1)
    catalogue, speed_m_s = default_catalogue(), TrialConfig().glide_speed_m_s
    train, _ = make_features(study, catalogue, PROTOCOL_TEXTURE, [_at(speed_m_s)])[0]
    shares = []
    for error in ERRORS:
        setting = _at(speed_m_s * (1.0 + error))
        _, test = make_features(study, catalogue, PROTOCOL_TEXTURE, [setting])[0]
        shares.append(100 * (score(PROTOCOL_TEXTURE, train, test) or 0.0))
    return [_row('SIMULATED plates, texture_spectrum, 3 neighbours, guide speed', shares)]


def _at(speed_m_s: float) -> Setting:
    return Setting('glide speed (m/s)', speed_m_s, glide_speed_m_s=speed_m_s)


def _row(case: str, found: Sequence[float]) -> Row:
    usual = found[ERRORS.index(0.0)]
    more = {
        f'{100 * error:+g} %' if error else 'no error': (
            f'{each - usual:+.1f}' if error else f'{each:.1f}'
        )
        for error, each in zip(ERRORS, found, strict=True)
    }
    return Row(case, more=more)
