# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of unknown objects in new SIMULATED sessions, over many seeds."""

from __future__ import annotations

import numpy as np

from benchmarks.measuring import Report, Row
from benchmarks.sessions.sessions import Array, count_seeds, describe, simulate_windows, TRAIN
from benchmarks.simulator.trials import CONTACTS
from tactile_classifier.confidence.fit_calibration import fit_novelty, make_group_folds
from tactile_classifier.confidence.fit_novelty import fit_measure
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    DEFAULT_SCALING,
)
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials

RATE = 0.05

CASES = (
    ('stiffness', 'stiffness_regression'),
    ('texture', 'texture_spectrum'),
    ('stiffness', 'hold_waveform'),
    ('texture', 'glide_waveform'),
)
"""Protocols and feature sets: the default sets, and the waveforms that random convolutions use."""


def run_thresholds(quick: bool) -> Report:
    """Measure how often known objects are rejected and unknown objects are missed."""
    seeds, tests = count_seeds(quick)
    rows = []
    for protocol, features in CASES:
        for contact in CONTACTS:
            runs = [_judge(protocol, features, contact, seed, tests) for seed in seeds]
            rows.append(Row(f'{features}, {contact}', more=_summarise(runs)))
    return Report(
        f'thresholds for unknown objects: {describe(seeds, tests)}',
        '',
        f'false rejection at a nominal {100 * RATE:g} %: mean and SD over seeds (minimum, '
        'maximum), and fraction of test sessions above 5 and 10 %; missed: trials of an unknown '
        'label that received a known label; accuracy: for known labels. In %',
        rows,
    )


def _judge(protocol: str, features: str, contact: str, seed: int, tests: int) -> Array:
    """Return five fractions for each test session, shape (sessions, 5) [%].

    The fractions are the false rejections with the default and with the strict threshold, the
    missed unknown objects with each of these thresholds, and the accuracy.
    """
    windows, labels, sessions, rate_hz = simulate_windows(protocol, contact, seed, tests)
    config = FeatureConfig(**{f'{protocol}_features': features})
    values, spec = features_from_trials(protocol, windows, rate_hz, config=config)
    table = FeatureTable(values, labels, spec, {'session_id': sessions})
    train, test = table.take(sessions < TRAIN), table.take(sessions >= TRAIN)
    folds, scaling = make_group_folds(train), DEFAULT_SCALING[table.task]
    measure, held_out = fit_novelty(train, folds)
    thresholds = [held_out.compute_threshold(RATE, strict=strict) for strict in (False, True)]
    estimator = build_estimator('knn', scaling).fit(train.values, train.labels)
    classes = np.unique(test.labels)
    others = {str(one): train.labels != one for one in classes}
    without = {
        one: fit_measure(train.values[kept], train.labels[kept], folds.fold[kept])
        for one, kept in others.items()
    }
    rows = []
    for each in np.unique(test.column('session_id')):
        trials = test.take(test.column('session_id') == each)
        named = classes[compute_raw_scores(estimator, trials.values).argmax(axis=1)]
        known = measure.compute(trials.values)
        new = np.concatenate(
            [
                without[one].compute(trials.values[trials.labels == one])
                for one in np.unique(trials.labels)
            ]
        )
        rows.append(
            [
                *(np.mean(known > threshold) for threshold in thresholds),
                *(np.mean(new <= threshold) for threshold in thresholds),
                np.mean(named == trials.labels),
            ]
        )
    return 100.0 * np.array(rows)


def _summarise(runs: list[Array]) -> dict[str, str]:
    sessions = np.concatenate(runs)
    found = {}
    for i, name in enumerate(('', ', strict')):
        seeds, rejected = np.array([run[:, i].mean() for run in runs]), sessions[:, i]
        found[f'false rejection{name}'] = (
            f'{seeds.mean():.1f} ± {seeds.std():.1f} ({seeds.min():.1f}, {seeds.max():.1f})'
        )
        found[f'above 5, 10 %{name}'] = ', '.join(
            f'{100 * np.mean(rejected > limit):.0f}' for limit in (5, 10)
        )
        found[f'missed{name}'] = f'{sessions[:, 2 + i].mean():.0f}'
    return {**found, 'accuracy': f'{sessions[:, 4].mean():.1f}'}
