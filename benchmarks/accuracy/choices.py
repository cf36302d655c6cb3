# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Automatic choice of features and classifier, rejection and calibration, on public recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks import recordings
from benchmarks.accuracy.twelve_plates import simulate, USUAL_MM_S
from benchmarks.measuring import Report, Row
from benchmarks.recordings import FABRIC_SLIDE, find_recording, PHAC_HOLD, say_missing
from tactile_classifier.confidence.fit_calibration import (
    compute_calibration_error,
    fit_calibration,
    hold_out_probabilities,
    hold_out_scores,
    make_group_folds,
)
from tactile_classifier.datasets.dataset import FeatureTable, table_from_trials
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    on_one_thread,
)
from tactile_classifier.evaluation.open_set import evaluate_open_set
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training.feature_choice import ChoicePlan
from tactile_classifier.types import ROCKET
from tactile_features import FeatureConfig, features_from_trials

SEEDS = 5
CELLS = ('speed_mm_s', 'force_set')
REPETITION = ('repetition',)
OVER_MM = {'spatial_length_m': 0.048, 'spatial_finest_m': 0.003}


def read_fabrics(channel: int | str = 'mean') -> dict[str, FeatureTable]:
    """Return a feature table of the recording of fabrics for each feature set."""
    trials = recordings.read_fabrics()
    speeds_m_s = trials.columns['speed_mm_s'] / 1e3
    sets = ('texture_spectrum', 'texture_spatial', 'glide_waveform', 'spatial_waveform')
    return {
        name: table_from_trials(
            'texture',
            trials.x,
            trials.label,
            trials.rate_hz,
            channel,
            config=FeatureConfig(texture_features=name, **OVER_MM),
            speeds_m_s=speeds_m_s,
        )
        for name in sets
    }


def read_holds() -> dict[str, FeatureTable]:
    """Return a feature table of the recording of held objects for each feature set."""
    x, label, rate_hz, _ = recordings.read_holds()
    sets = ('stiffness_regression', 'stiffness_relaxation', 'hold_waveform')
    return {
        name: table_from_trials(
            'stiffness', x, label, rate_hz, config=FeatureConfig(stiffness_features=name)
        )
        for name in sets
    }


PLATE_SETS = ('texture_spectrum', 'texture_spatial', 'glide_waveform', 'spatial_waveform')
PLATE_NOISE_N = 0.08
"""White noise that is added to all samples, rms [N]. Without it, most feature sets reach 100 %."""


def read_plates(seed: int) -> dict[str, FeatureTable]:
    """Simulate trials on twelve plates, and return a feature table for each feature set."""
    signals, labels, sessions = simulate(seed, USUAL_MM_S)
    noise = np.random.default_rng(seed).standard_normal(signals.shape)
    speeds_m_s = np.full(len(signals), USUAL_MM_S / 1e3)
    tables = {}
    for name in PLATE_SETS:
        config = FeatureConfig(
            texture_features=name,
            texture_samples=signals.shape[1],
            spatial_length_m=0.030,
            spatial_finest_m=5e-4,
        )
        values, spec = features_from_trials(
            'texture',
            signals + PLATE_NOISE_N * noise,
            60.0,
            config=config,
            speeds_m_s=speeds_m_s,
        )
        tables[name] = FeatureTable(values, labels, spec, {'session_id': sessions})
    return tables


Read = Callable[[int], dict[str, FeatureTable]]
Divide = Callable[[FeatureTable, int], Split]


def run_choice(quick: bool) -> Report:
    """Compare the automatic choice with the best choice in hindsight.

    Features, classifier and scaling are chosen. The best choice in hindsight is the combination
    with the highest accuracy on the test trials.
    """
    seeds = range(1 if quick else SEEDS)
    rows = [Row(say_missing(PHAC_HOLD))]
    if find_recording(PHAC_HOLD) and find_recording(FABRIC_SLIDE):
        rows = [
            Row(case, more=_measure_choice(read, divide, seeds))
            for case, read, divide in _list_splits(quick)
        ]
    return Report(
        'automatic choice of features, classifier and scaling',
        '',
        'nested accuracy of the choice, and accuracy of the best set in hindsight; their '
        'difference is the regret: mean and SD over seeds',
        rows,
    )


def _list_splits(quick: bool) -> Iterator[tuple[str, Read, Divide]]:
    holds = read_holds()
    yield (
        'holds, one repetition',
        lambda _: holds,
        lambda table, _: grouped_split(table, REPETITION),
    )
    if quick:
        return
    session = ('session_id',)
    yield 'twelve plates, one session', read_plates, lambda table, _: grouped_split(table, session)
    fabrics = read_fabrics()
    for columns in (CELLS[:1], CELLS):
        case = f'fabrics, one {" and ".join(columns)}'
        yield (
            case,
            lambda _: fabrics,
            lambda table, _, columns=columns: grouped_split(table, columns),
        )
    yield (
        'fabrics, six folds',
        lambda _: fabrics,
        lambda table, seed: stratified_split(table, 6, 1, seed),
    )


def _measure_choice(read: Read, divide: Divide, seeds: range) -> dict[str, Any]:
    found = []
    for seed in seeds:
        tables = read(seed)
        split = divide(next(iter(tables.values())), seed)
        ((choice,),) = run_plans([ChoicePlan(tables, split, 100 * seed)])
        found.append(choice)
    nested, best = (
        100 * np.array(values)
        for values in zip(*((c.nested.mean, c.ranking[0].score.mean) for c in found), strict=True)
    )
    regret = best - nested
    return {
        'seeds': len(seeds),
        'choice, %': f'{nested.mean():.1f} ± {nested.std():.1f}',
        'best in hindsight, %': f'{best.mean():.1f}',
        'regret, points': f'{regret.mean():.1f} ± {regret.std():.1f} '
        f'({regret.min():.1f} to {regret.max():.1f})',
    }


def run_unlearned(quick: bool) -> Report:
    """Leave each label out of the training, and test whether its trials are found unknown."""
    rows = [Row(say_missing(FABRIC_SLIDE))]
    if find_recording(PHAC_HOLD) and find_recording(FABRIC_SLIDE):
        cases = [(f'holds, {name}', table, REPETITION) for name, table in read_holds().items()]
        for channel in () if quick else ('mean', 9, 12):
            title = 'mean of 16' if channel == 'mean' else f'channel {channel}'
            for name, table in read_fabrics(channel).items():
                cases.append((f'fabrics, {title}, {name}', table, CELLS))
        rows = [Row(case, more=_measure_unlearned(*what)) for case, *what in cases]
    return Report(
        'rejection of labels that were left out of the training',
        '',
        'each label left out once, held-out groups; nominal false rejection rate: 5 %',
        rows,
    )


def _measure_unlearned(table: FeatureTable, columns: tuple[str, ...]) -> dict[str, Any]:
    known = {name: column for name, column in table.columns.items() if name in columns}
    table = replace(table, columns=known)
    found = {
        name: evaluate_open_set(table, 'knn', hold_out=columns, strict=strict)
        for name, strict in (('', False), (', strict', True))
    }
    measured = {'AUROC, %': f'{100 * found[""].auroc:.1f}'}
    for name, each in found.items():
        measured[f'named{name}, %'] = f'{100 * each.miss_rate:.0f}'
        measured[f'false rejection{name}, %'] = f'{100 * each.realised_false_alarm_rate:.1f}'
        measured[f'worst fold{name}, %'] = f'{100 * max(each.group_false_alarm_rates):.0f}'
    return measured


def run_calibration_error(quick: bool) -> Report:
    """Compare the calibration error that a model card states with that in held-out groups."""
    rows = [Row(say_missing(FABRIC_SLIDE))]
    if find_recording(PHAC_HOLD) and find_recording(FABRIC_SLIDE):
        cases = [(f'holds, {name}', table, REPETITION) for name, table in read_holds().items()]
        for name, table in {} if quick else read_fabrics().items():
            cases.append((f'fabrics, {name}', table, CELLS))
        rows = [
            Row(f'{case}, {classifier}', more=_measure_calibration(table, columns, classifier))
            for case, table, columns in cases
            for classifier in ('knn', 'svm_linear', ROCKET)
            if table.is_waveform or classifier != ROCKET
        ]
    return Report(
        'expected calibration error in the model card, and in held-out groups',
        '',
        'single trials, stated: from folds of trials or groups, mean and SD over trainings '
        'without one group; true: in the left-out groups, pooled; chance: error of labels drawn '
        'with the stated probabilities. In %',
        rows,
    )


@on_one_thread
def _measure_calibration(
    table: FeatureTable, columns: tuple[str, ...], classifier: str
) -> dict[str, Any]:
    scaling = 'standard' if classifier == 'svm_linear' else 'none'
    group = make_group_folds(table, columns).session
    assert group is not None
    stated: dict[str, list[float]] = {}
    probabilities, answers = [], []
    for one in np.unique(group):
        train, test = table.take(group != one), table.take(group == one)
        ways = {'single trials': make_group_folds(train, ()).fold}
        ways |= {'stated': make_group_folds(train, columns).fold}
        for way, fold in ways.items():
            scores, true = hold_out_scores(train, classifier, scaling, fold)
            found = compute_calibration_error(hold_out_probabilities(scores, true, fold), true)
            stated.setdefault(way, []).append(100 * found)
        estimator = build_estimator(classifier, scaling, table.channels)
        estimator.fit(train.values, train.labels)
        raw = compute_raw_scores(estimator, test.values)
        probabilities.append(fit_calibration(scores, true).compute(raw))
        answers.append(np.searchsorted(estimator.classes_, test.labels))
    pooled, label = np.concatenate(probabilities), np.concatenate(answers)
    generator = np.random.default_rng(0)
    drawn = [
        compute_calibration_error(pooled, (generator.random((len(pooled), 1)) > sums).sum(axis=1))
        for sums in [np.minimum(pooled.cumsum(axis=1)[:, :-1], 1.0)] * 200
    ]
    return {way: f'{np.mean(each):.1f} ± {np.std(each):.1f}' for way, each in stated.items()} | {
        'true': f'{100 * compute_calibration_error(pooled, label):.1f}',
        'chance': f'{100 * np.mean(drawn):.1f} ± {100 * np.std(drawn):.1f}',
    }
