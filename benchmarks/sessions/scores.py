# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Raw or calibrated scores in sessions that nobody trained on: simulated, over many seeds.

Usage: ./tactile run python -m benchmarks.sessions.scores [--quick] [--seeds N]

SIMULATED. Each seed trains the paper's four classifiers on 2, 3 and 6 sessions of 8 trials a label
and tests them on 40 others of 4. Seeds are 5300 and up; others were used to choose the rule.
Beside the simulated finger there are drawn tables, "unlike": three labels around points of three
features, a session with a standard deviation of 0.2 or of 4 by turns, in new sessions by chance.
"Naive" keeps raw scores whenever the expected calibration error of held-out trials rises.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import sys

import numpy as np
from numpy.typing import NDArray

from benchmarks.sessions.thresholds import simulate_table
from tactile_classifier.confidence.calibration import (
    Calibration,
    compute_calibration_error,
    compute_uncalibrated,
    hold_out_probabilities,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.confidence.score_choice import compute_log_loss, ScoreChoice
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    CLASSIFIERS,
    compute_raw_scores,
    default_scaling,
    SCORE_KINDS,
)
from tactile_features.spec import array_spec

TEST = 40
FIRST_SEED = 5300
SESSIONS = (2, 3, 6)
RULES = ('always calibrated', 'naive', 'rule')
Array = NDArray[np.float64]


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='two seeds')
    parser.add_argument('--seeds', type=int, default=20)
    arguments = parser.parse_args()
    found: dict[tuple[str, int, str], list[Array]] = {}
    for seed in range(FIRST_SEED, FIRST_SEED + (2 if arguments.quick else arguments.seeds)):
        for name, table in _tables(seed):
            for sessions in SESSIONS:
                for classifier in CLASSIFIERS:
                    rows = _judge(table, sessions, classifier)
                    for rule, row in zip(RULES, rows, strict=True):
                        found.setdefault((name, sessions, rule), []).append(row)
        sys.stderr.write(f'seed {seed}\n')
    sys.stdout.write(
        '| set | sessions | rule | raw kept | log loss | calibration error | Brier score |\n'
        '|---|---|---|---|---|---|---|\n'
    )
    for (name, sessions, rule), rows in sorted(
        found.items(), key=lambda item: (item[0][0], item[0][1], RULES.index(item[0][2]))
    ):
        kept, loss, error, brier = np.mean(rows, axis=0)
        sys.stdout.write(
            f'| {name} | {sessions} | {rule} | {100 * kept:.1f} % | {loss:.4f} | '
            f'{100 * error:.2f} % | {brier:.4f} |\n'
        )


def _tables(seed: int) -> Iterator[tuple[str, FeatureTable]]:
    for protocol in ('stiffness', 'texture'):
        for contact in ('abduction', 'flexion'):
            yield protocol, simulate_table(protocol, contact, seed, max(SESSIONS), TEST)
    yield 'unlike', _draw_unlike(seed)


def _draw_unlike(seed: int) -> FeatureTable:
    rng = np.random.default_rng(seed)
    session = np.repeat(np.arange(max(SESSIONS) + TEST), 24)
    label = np.tile(np.repeat(np.arange(3), 8), max(SESSIONS) + TEST)
    noisy = np.where(
        session < max(SESSIONS), session % 2, rng.integers(2, size=session[-1] + 1)[session]
    )
    values = 3.0 * np.eye(3)[label]
    values += np.array([0.2, 4.0])[noisy][:, np.newaxis] * rng.normal(size=values.shape)
    spec = array_spec('stiffness', 50, 60.0)
    return FeatureTable(values, label.astype(str), spec, {'session_id': session})


def _judge(table: FeatureTable, sessions: int, classifier: str) -> list[Array]:
    """Return whether raw is kept, log loss, calibration error and Brier score, by rule."""
    session = table.column('session_id')
    train, test = table.take(session < sessions), table.take(session >= max(SESSIONS))
    folds, kind = make_group_folds(train), SCORE_KINDS[classifier]
    scaling = default_scaling(table.task, classifier)
    scores, true = hold_out_scores(train, classifier, scaling, folds.fold)
    raw = compute_uncalibrated(scores, kind)
    probabilities = hold_out_probabilities(scores, true, folds.fold)
    choice = ScoreChoice.compare(raw, probabilities, true, folds.session, kind)
    naive = compute_calibration_error(probabilities, true) > compute_calibration_error(raw, true)
    estimator = build_estimator(classifier, scaling).fit(train.values, train.labels)
    new = compute_raw_scores(estimator, test.values)
    truth = np.searchsorted(np.unique(train.labels), test.labels)
    calibration = Calibration.fit(scores, true)
    rows = []
    for keeps_raw in (False, naive, choice.keeps_raw):
        stated = compute_uncalibrated(new, kind) if keeps_raw else calibration.compute(new)
        brier = ((stated - np.eye(stated.shape[1])[truth]) ** 2).sum(axis=1).mean()
        rows.append(
            np.array(
                [
                    float(keeps_raw),
                    compute_log_loss(stated, truth),
                    compute_calibration_error(stated, truth),
                    float(brier),
                ]
            )
        )
    return rows


if __name__ == '__main__':
    main()
