# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What thresholds do in sessions that nobody trained on: simulated, over many seeds.

Usage: ./tactile run python -m benchmarks.sessions.thresholds [--quick] [--seeds N] [--sessions N]

SIMULATED. Each seed trains on 6 sessions (or as many as stated) of 8 trials a label and tests on
40 others of 4. Seeds are 2000 and up; others were used to choose between ways to recalibrate.
Features are those of the feature node's defaults.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray

from benchmarks.simulator.trials import find_window
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.confidence.calibration import (
    Calibration,
    fit_novelty,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.confidence.novelty import compute_threshold
from tactile_classifier.confidence.recalibration import fit_session_statistics
from tactile_classifier.confidence.session_statistics import TRIALS
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    DEFAULT_SCALING,
)
from tactile_features.extraction.extractor import features_from_trials
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.fast_trials import simulate_trials

TEST = 40
FIRST_SEED = 2000
RATE = 0.05
Array = NDArray[np.float64]


def main() -> None:
    """Print a table in Markdown, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='two seeds, ten test sessions')
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--sessions', type=int, default=6, help='sessions to train on')
    arguments = parser.parse_args()
    seeds, tests = (2, 10) if arguments.quick else (arguments.seeds, TEST)
    train = arguments.sessions
    sys.stdout.write(
        '| set | threshold | false rejection, mean ± SD over seeds (range) | sessions above 5, '
        '10, 30 % | missed | accuracy, log loss |\n|---|---|---|---|---|---|\n'
    )
    for protocol in ('stiffness', 'texture'):
        for contact in ('abduction', 'flexion'):
            found: dict[str, list[Array]] = {}
            for seed in range(seeds):
                table = simulate_table(protocol, contact, FIRST_SEED + seed, train, tests)
                for name, rows in _judge(table, seed, train).items():
                    found.setdefault(name, []).append(rows)
            for name, runs in found.items():
                sys.stdout.write(f'| {protocol}, {contact} | {name} | {_tell(runs)} |\n')
            sys.stdout.flush()


def simulate_windows(
    protocol: str, contact: str, seed: int, train: int, tests: int
) -> tuple[Array, NDArray[np.str_], NDArray[np.intp], float]:
    """Return the windows of trials, their labels and sessions, and the sample rate [Hz].

    The first ``train`` sessions have 8 trials a label, the ``tests`` after them 4.
    """
    planned = plan_trial(TrialConfig(), TrialRequest(protocol, contact))
    catalogue = default_catalogue()
    windows, labels, sessions = [], [], []
    for label in catalogue.labels(protocol):
        for session in range(train + tests):
            count = 8 if session < train else 4
            trials = simulate_trials(
                protocol, label, contact, planned.timeline, count, seed,
                session=session, catalogue=catalogue,
            )  # fmt: skip
            windows.append(trials.tension_n[:, find_window(protocol, planned)])
            labels += [label] * count
            sessions += [session] * count
    x = np.concatenate(windows)
    good = np.isfinite(x).all(axis=1)
    return x[good], np.array(labels)[good], np.array(sessions)[good], planned.rate_hz


def simulate_table(protocol: str, contact: str, seed: int, train: int, tests: int) -> FeatureTable:
    """Return the features of `simulate_windows`."""
    x, labels, sessions, rate_hz = simulate_windows(protocol, contact, seed, train, tests)
    values, spec = features_from_trials(protocol, x, rate_hz)
    return FeatureTable(values, labels, spec, {'session_id': sessions})


def _judge(table: FeatureTable, seed: int, sessions: int) -> dict[str, Array]:
    """Return false alarms, misses, accuracy, log loss of each test session, by the threshold."""
    session = table.column('session_id')
    train, test = table.take(session < sessions), table.take(session >= sessions)
    folds, scaling = make_group_folds(train), DEFAULT_SCALING[table.task]
    measure, novelty, by_session = fit_novelty(train, folds, RATE)
    statistics = fit_session_statistics(train, folds, measure.metric, RATE)
    assert statistics is not None
    calibration = Calibration.fit(*hold_out_scores(train, 'knn', scaling, folds.fold))
    estimator = build_estimator('knn', scaling).fit(train.values, train.labels)
    classes, label = np.unique(test.labels, return_inverse=True)
    rows: dict[str, list[list[float]]] = {}
    generator = np.random.default_rng(seed)
    for each in np.unique(test.column('session_id')):
        (trials,) = np.nonzero(test.column('session_id') == each)
        known, rest = np.split(generator.permutation(trials), [TRIALS])
        offset, threshold = statistics.recalibrate(
            test.values[known], label[known], measure.compute
        )
        for name, limit, shift in (
            ('all trials', compute_threshold(novelty, RATE), 0.0 * offset),
            ('sessions', by_session, 0.0 * offset),
            (f'recalibrated, {TRIALS} trials', threshold, offset),
        ):
            values = test.values[rest] - shift
            chance = calibration.compute(compute_raw_scores(estimator, values))
            stated = np.maximum(chance[np.arange(len(rest)), label[rest]], 1e-12)
            # Only labels that the known trials do not show can be unknown.
            absent = np.setdiff1d(test.labels[rest], test.labels[known])
            missed = [
                measure.compute_without(values[test.labels[rest] == one], train.labels, one)
                <= limit
                for one in absent
            ]
            rows.setdefault(name, []).append(
                [
                    float((measure.compute(values) > limit).mean()),
                    float(np.mean(np.concatenate(missed))) if missed else np.nan,
                    float((classes[chance.argmax(axis=1)] == test.labels[rest]).mean()),
                    float(-np.log(stated).mean()),
                ]
            )
    return {name: np.array(found) for name, found in rows.items()}


def _tell(runs: list[Array]) -> str:
    false_alarms = 100.0 * np.array([run[:, 0].mean() for run in runs])
    sessions = 100.0 * np.concatenate([run[:, 0] for run in runs])
    above = ', '.join(f'{np.mean(sessions > limit) * 100:.0f}' for limit in (5, 10, 30))
    missed, accuracy, loss = np.nanmean(np.concatenate(runs)[:, 1:], axis=0)
    return (
        f'{false_alarms.mean():.1f} ± {false_alarms.std():.1f} ({false_alarms.min():.1f} to '
        f'{false_alarms.max():.1f}) | {above} | {100 * missed:.0f} | '
        f'{100 * accuracy:.1f} %, {loss:.2f}'
    )


if __name__ == '__main__':
    main()
