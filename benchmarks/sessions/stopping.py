# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Early predictions in sessions that training never saw, over many seeds. SIMULATED.

Texture without its mean alone: with our default all is decided early and right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring import Report, Row
from benchmarks.sessions.sessions import Array, count_seeds, describe, simulate_windows, TRAIN
from benchmarks.simulator.trials import CONTACTS
from tactile_classifier.confidence.fit_calibration import calibrate_stage, make_group_folds
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import build_estimator, compute_raw_scores
from tactile_classifier.evaluation.early_answers import find_first_stop, fit_stop_threshold
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials

SAMPLES = (30, 60, 90, 120, 150)
ERROR_RATE, FALSE_ALARMS = 0.05, 0.05


def run_stopping(quick: bool) -> Report:
    """Count early predictions and wrong ones of them."""
    seeds, tests = count_seeds(quick)
    rows = []
    for contact in CONTACTS:
        runs = [_judge(contact, seed, tests) for seed in seeds]
        rows.append(Row(f'texture, {contact}', more=_summarise(runs)))
    return Report(
        f'early predictions: {describe(seeds, tests)}',
        '',
        f'wrong: share of the early predictions, {100 * ERROR_RATE:g} % are allowed; mean and SD '
        'over seeds (least, most). In %',
        rows,
    )


def _judge(contact: str, seed: int, tests: int) -> Array | None:
    """Return trials, early and wrong early predictions of each test session; None: no rule."""
    windows, labels, sessions, rate_hz = simulate_windows('texture', contact, seed, tests)
    config = FeatureConfig(spectrum_detrend='mean')
    is_train = sessions < TRAIN
    folds, parts, stages = None, [], []
    for count in SAMPLES:
        values, spec = features_from_trials(
            'texture', windows, rate_hz, first_samples=count, config=config
        )
        table = FeatureTable(values, labels, spec, {'session_id': sessions})
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
    assert folds is not None
    rule = fit_stop_threshold(known, failed, ERROR_RATE, folds.session)
    if rule is None:
        return None
    confidence, wrong = (np.stack(each) for each in zip(*stages, strict=True))
    return _count(confidence, wrong, sessions[~is_train], rule)


def _count(
    confidence: Array, wrong: NDArray[np.bool_], session: NDArray[np.intp], rule: float
) -> Array:
    stage = find_first_stop(confidence, rule)
    early = stage < len(confidence)
    mistakes = np.zeros(len(stage), dtype=bool)
    mistakes[early] = wrong[stage[early], np.flatnonzero(early)]
    counted = np.column_stack([np.ones(len(stage)), early, mistakes])
    return np.array([counted[session == each].sum(axis=0) for each in np.unique(session)])


def _summarise(runs: list[Array | None]) -> dict[str, str]:
    ruled = [run for run in runs if run is not None]
    more = {'seeds without a rule': str(len(runs) - len(ruled))}
    if not ruled:
        return more
    early = np.mean([run[:, 1].sum() / run[:, 0].sum() for run in ruled])
    wrong = 100.0 * np.array([run[:, 2].sum() / max(run[:, 1].sum(), 1.0) for run in ruled])
    rows = np.concatenate(ruled)
    held = np.mean(rows[:, 2] <= ERROR_RATE * rows[:, 1])
    return {
        'decided early': f'{100 * early:.0f}',
        'wrong': f'{wrong.mean():.1f} ± {wrong.std():.1f} ({wrong.min():.1f}, {wrong.max():.1f})',
        'sessions that keep the rate': f'{100 * held:.0f}',
        **more,
    }
