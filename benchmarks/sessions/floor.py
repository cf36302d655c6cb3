# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What five known trials of a session can give: by formula, and from simulated sessions.

Usage: ./tactile run python -m benchmarks.sessions.floor [--seeds N]

SIMULATED sessions as in `thresholds`. In hindsight one shift of the recalibrated
thresholds makes the mean of the false alarms over the test sessions what was asked for. What
sessions then still differ by, without the counting error, says how far a threshold from few
sessions is off.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.sessions.thresholds import FIRST_SEED, RATE, simulate_table, TEST
from tactile_classifier.confidence.calibration import fit_novelty, make_group_folds
from tactile_classifier.confidence.recalibration import fit_session_statistics
from tactile_classifier.confidence.session_statistics import TINY, TRIALS
from tactile_classifier.datasets.dataset import FeatureTable

TRAIN = 6
NODES = 200


def main() -> None:
    """Print the formulas' rows, then one line for each set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=20)
    seeds = parser.parse_args().seeds
    largest = stats.beta(1, TRIALS)
    for name, mean, spread in (
        ('largest of the known', largest.mean(), largest.std()),
        ('normal', *compute_normal_rate(TRIALS, RATE)),
    ):
        sys.stdout.write(
            f'{name}: {100 * mean:.1f} ± {100 * spread:.1f} % in a session, '
            f'± {100 * spread / TEST**0.5:.1f} in a mean of {TEST}\n'
        )
    for protocol in ('stiffness', 'texture'):
        for contact in ('abduction', 'flexion'):
            found = [
                _measure_left(simulate_table(protocol, contact, FIRST_SEED + seed, TRAIN, TEST))
                for seed in range(seeds)
            ]
            variance, tests, trained = np.mean(found, axis=0)
            expected = [
                _expect(variance, sessions, tests, trained) for sessions in (TRAIN, 30, np.inf)
            ]
            sys.stdout.write(
                f'{protocol}, {contact}: sessions differ by {100 * variance**0.5:.1f} points; '
                f'expected SD of the mean of {TEST}, from {TRAIN}, 30, all sessions: '
                f'{", ".join(f"{100 * one:.1f}" for one in expected)}\n'
            )
            sys.stdout.flush()


def compute_normal_rate(known: int, rate: float) -> tuple[float, float]:
    """Return mean and SD of the rate above a threshold from the mean of normal values.

    Their spread is known, their mean is that of the ``known`` values. The mean rate is ``rate``.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / weights.sum()
    limit = stats.norm.isf(rate) * (1 + 1 / known) ** 0.5
    rates = stats.norm.sf(limit + nodes / known**0.5)
    mean = float(weights @ rates)
    return mean, float((weights @ (rates - mean) ** 2) ** 0.5)


def _measure_left(table: FeatureTable) -> NDArray[np.float64]:
    """Return the variance of sessions' rates, and windows of a test and of a training session."""
    session = table.column('session_id')
    train, test = table.take(session < TRAIN), table.take(session >= TRAIN)
    folds = make_group_folds(train)
    measure, _, _ = fit_novelty(train, folds, RATE)
    statistics = fit_session_statistics(train, folds, measure.metric, RATE)
    assert statistics is not None
    label = np.unique(test.labels, return_inverse=True)[1]
    generator = np.random.default_rng(0)
    above = []
    for each in np.unique(test.column('session_id')):
        (trials,) = np.nonzero(test.column('session_id') == each)
        known, rest = np.split(generator.permutation(trials), [TRIALS])
        offset, threshold = statistics.recalibrate(
            test.values[known], label[known], measure.compute
        )
        above.append(np.log((measure.compute(test.values[rest] - offset) + TINY) / threshold))
    best = np.quantile(np.concatenate(above), 1 - RATE)
    rates = np.array([(one > best).mean() for one in above])
    tests = np.mean([len(one) for one in above])
    counting = np.mean(rates * (1 - rates)) / (tests - 1)
    variance = max(rates.var(ddof=1) - counting, 0.0)
    return np.array([variance, tests, len(train.labels) / TRAIN])


def _expect(variance: float, sessions: float, tests: float, trained: float) -> float:
    """Return the SD of the mean rate of the test sessions, with a threshold of so many."""
    counting = RATE * (1 - RATE) * (1 / (sessions * trained) + 1 / (TEST * tests))
    return float((variance * (1 / sessions + 1 / TEST) + counting) ** 0.5)


if __name__ == '__main__':
    main()
