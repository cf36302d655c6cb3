# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What stopping rules do in sessions that nobody trained on: simulated, over many seeds.

Usage: ./tactile run python -m benchmarks.sessions.stopping [--quick] [--seeds N] [--contact C]

SIMULATED texture trials with the paper's features, whose mean alone is removed: with our default
nothing is left to decide. Each seed trains on 6 sessions of 8 trials a label and tests on 40
others of 4. Answers come after 0.5, 1, 1.5, 2 and 2.5 s.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray

from benchmarks.sessions.thresholds import FIRST_SEED, simulate_windows, TEST
from tactile_classifier.confidence.calibration import calibrate_stage, make_group_folds
from tactile_classifier.confidence.stopping import find_first_stop, fit_stop_threshold
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials

TRAIN = 6
SAMPLES = (30, 60, 90, 120, 150)
ERROR_RATE, FALSE_ALARMS = 0.05, 0.05
Array = NDArray[np.float64]


def main() -> None:
    """Print a table in Markdown, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='two seeds, ten test sessions')
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--contact', choices=('abduction', 'flexion'))
    arguments = parser.parse_args()
    seeds, tests = (2, 10) if arguments.quick else (arguments.seeds, TEST)
    sys.stdout.write(
        '| set | rule | decided early, % | wrong of these, mean ± SD over seeds (range) | '
        'sessions above 5, 10, 30 % | seeds without a rule |\n|---|---|---|---|---|---|\n'
    )
    for contact in [arguments.contact] if arguments.contact else ['abduction', 'flexion']:
        found: dict[str, list[Array | None]] = {'all trials': [], 'sessions': []}
        for seed in range(seeds):
            for name, rows in _judge(contact, FIRST_SEED + seed, tests).items():
                found[name].append(rows)
            sys.stderr.write(f'{contact}, {seed + 1} of {seeds} seeds\n')
        for name, runs in found.items():
            sys.stdout.write(f'| texture, {contact} | {name} | {_tell(runs)} |\n')
        sys.stdout.flush()


def _judge(contact: str, seed: int, tests: int) -> dict[str, Array | None]:
    """Return early answers and wrong ones of them, in each test session; None: no rule."""
    windows, labels, sessions, rate_hz = simulate_windows('texture', contact, seed, TRAIN, tests)
    config = FeatureConfig(spectrum_detrend='mean')
    is_train = sessions < TRAIN
    columns = {'session_id': sessions}
    folds, parts, stages = None, [], []
    for count in SAMPLES:
        values, spec = features_from_trials(
            'texture', windows, rate_hz, first_samples=count, config=config
        )
        table = FeatureTable(values, labels, spec, columns)
        train, test = table.take(is_train), table.take(~is_train)
        folds = folds or make_group_folds(train)
        part = calibrate_stage(train, 'knn', 'none', folds, FALSE_ALARMS)
        estimator = build_estimator('knn', 'none').fit(train.values, train.labels)
        chance = part.calibration.compute(compute_raw_scores(estimator, test.values))
        is_known = part.novelty.compute(test.values) <= part.novelty_threshold
        confidence = np.where(is_known, chance.max(axis=1), -1.0)
        wrong = estimator.classes_[chance.argmax(axis=1)] != test.labels
        parts.append((part.confidence, part.wrong))
        stages.append((confidence, wrong))
    known, failed = (np.stack(each) for each in zip(*parts, strict=True))
    confidence, wrong = (np.stack(each) for each in zip(*stages, strict=True))
    session = sessions[~is_train]
    rules = {
        'all trials': fit_stop_threshold(known, failed, ERROR_RATE),
        'sessions': fit_stop_threshold(known, failed, ERROR_RATE, folds.session),
    }
    return {
        name: None if rule is None else _count(confidence, wrong, session, rule)
        for name, rule in rules.items()
    }


def _count(confidence: Array, wrong: NDArray[np.bool_], session: Array, rule: float) -> Array:
    """Return trials, early answers and wrong ones of them, a row for each session."""
    stage = find_first_stop(confidence, rule)
    early = stage < len(confidence)
    mistakes = np.zeros(len(stage), dtype=bool)
    mistakes[early] = wrong[stage[early], np.flatnonzero(early)]
    return np.array(
        [
            [
                (session == each).sum(),
                early[session == each].sum(),
                mistakes[session == each].sum(),
            ]
            for each in np.unique(session)
        ],
        dtype=np.float64,
    )


def _tell(runs: list[Array | None]) -> str:
    ruled = [run for run in runs if run is not None]
    without = len(runs) - len(ruled)
    if not ruled:
        return f'0 | none | none | {without}'
    early = 100.0 * np.mean([run[:, 1].sum() / run[:, 0].sum() for run in ruled])
    wrong = 100.0 * np.array([run[:, 2].sum() / max(run[:, 1].sum(), 1.0) for run in ruled])
    rows = np.concatenate(ruled)
    share = 100.0 * rows[:, 2] / np.maximum(rows[:, 1], 1.0)
    above = ', '.join(f'{np.mean(share > limit) * 100:.0f}' for limit in (5, 10, 30))
    return (
        f'{early:.0f} | {wrong.mean():.1f} ± {wrong.std():.1f} ({wrong.min():.1f} to '
        f'{wrong.max():.1f}) | {above} | {without}'
    )


if __name__ == '__main__':
    main()
