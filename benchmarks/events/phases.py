# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Success rate and time errors of phases detected in the tension."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.events.phase_streams import (
    as_blocks,
    Disturbance,
    Session,
    simulate_session,
    StatedTrial,
)
from benchmarks.measuring import Report, Row
from tactile_classifier.estimators.classifiers import build_estimator, DEFAULT_SCALING
from tactile_classifier.types import CLASSIFIERS, CONTACTS
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.phases import find_phases
from tactile_features.types import FeatureWindow, TrialEvent, WindowOutcome
from tactile_ros.strain import StrainBlock

MARK = {'stiffness': 'hold', 'texture': 'glide'}
"""Phase of a trial from which the features are computed, for each protocol."""

TOLERANCE_NS = 50_000_000
"""Largest accepted time error of a detected phase: three samples at 60 Hz."""

SESSIONS = 6
TEST_SESSIONS = 2
"""Number of sessions for testing. These are the last sessions; the others are for training."""

CONDITIONS: dict[str, tuple[Disturbance, dict[str, float]]] = {
    'noise 4 mN': (Disturbance(), {}),
    'noise 10 mN': (Disturbance(0.010), {}),
    'noise 20 mN': (Disturbance(0.020), {}),
    'noise 40 mN': (Disturbance(0.040), {}),
    'noise 120 mN': (Disturbance(0.120), {}),
    'drift 20 mN/sqrt(s)': (Disturbance(drift_n_rt_s=0.02), {}),
    '1 % lost': (Disturbance(lost=0.01), {}),
    '5 % lost, noise 10 mN': (Disturbance(0.010, lost=0.05), {}),
    'sensor ends at 70 %': (Disturbance(cut_share=0.7), {}),
    'pull at 3 mm/s, not 10': (Disturbance(), {'pull_speed_m_s': 0.003}),
    'pull at 30 mm/s': (Disturbance(), {'pull_speed_m_s': 0.030}),
}
OF_TEXTURE: dict[str, tuple[Disturbance, dict[str, float]]] = {
    'glide at 5 mm/s, not 15': (Disturbance(), {'glide_speed_m_s': 0.005}),
    'glide at 30 mm/s': (Disturbance(), {'glide_speed_m_s': 0.030}),
    'rest before it 0.2 s, not 0.3': (Disturbance(), {'settle_s': 0.2}),
}


def run_phases(quick: bool) -> Report:
    """Compare detected phases with commanded phases, for all objects, plates and contacts."""
    rows = []
    sessions, trials = (2, 2) if quick else (SESSIONS, 5)
    for protocol, mark in MARK.items():
        conditions = CONDITIONS | (OF_TEXTURE if protocol == 'texture' else {})
        for contact in CONTACTS:
            for name, (disturbance, motion) in conditions.items():
                found = _Found(mark)
                for number in range(sessions):
                    session = simulate_session(protocol, contact, number, trials, **motion)
                    found.add(session, disturbance, seed=number)
                rows.append(Row(f'{protocol} {contact}, {name}', more=found.columns()))
    return Report(
        'phases: detected in the tension of SIMULATED trials, compared with commanded phases',
        '',
        'found: all four phases, hold or glide and release within 50 ms; errors: detected minus '
        'commanded, median and 99 % quantile of the magnitudes; missed: no hold or glide '
        'detected; wrong: all others',
        rows,
    )


class _Found:
    """Numbers of trials whose phases were found, missed or wrong in one condition."""

    def __init__(self, mark: str) -> None:
        self._names = ['contact', mark, 'release', 'done']
        self._mark = mark
        self._errors_ms: dict[str, list[float]] = {name: [] for name in self._names}
        self._trials = self._right = self._missed = 0

    def add(self, session: Session, disturbance: Disturbance, seed: int) -> None:
        kept, tension_n = disturbance.apply(session, seed)
        time_ns = np.arange(len(kept)) * session.period_ns
        config = FeatureConfig(phases=session.protocol)
        events = find_phases(time_ns[kept], tension_n[kept], config)
        for trial, of_trial in zip(session.trials, _by_trial(session, events), strict=True):
            self._count(trial, of_trial)

    def _count(self, trial: StatedTrial, events: Sequence[TrialEvent]) -> None:
        self._trials += 1
        phases = [event.phase for event in events]
        if phases != self._names:
            self._missed += phases in ([], ['contact', 'aborted'])
            return
        off_ns = {e.phase: e.stamp_ns - trial.phases_ns[e.phase] for e in events}
        self._right += all(abs(off_ns[n]) <= TOLERANCE_NS for n in (self._mark, 'release'))
        for name, off in off_ns.items():
            self._errors_ms[name].append(off / 1e6)

    def columns(self) -> dict[str, Any]:
        columns: dict[str, Any] = {
            'trials': self._trials,
            'found %': f'{100 * self._right / self._trials:.1f}',
            'missed': self._missed,
            'wrong': self._trials - self._right - self._missed,
        }
        for name, errors in self._errors_ms.items():
            if errors:
                most = np.percentile(np.abs(errors), 99)
                columns[f'{"start" if name == self._mark else name} ms'] = (
                    f'{np.median(errors):+.0f}, {most:.0f}'
                )
        return columns


def _by_trial(session: Session, events: Iterable[TrialEvent]) -> list[list[TrialEvent]]:
    ends_ns = [trial.end_ns for trial in session.trials]
    found: list[list[TrialEvent]] = [[] for _ in ends_ns]
    for event in events:
        found[int(np.searchsorted(ends_ns, event.stamp_ns, side='right'))].append(event)
    return found


def run_phase_features(quick: bool) -> Report:
    """Measure how errors in the detection of phases affect the accuracy of classification."""
    trials = 4 if quick else 15
    rows = []
    for protocol in MARK:
        for contact in CONTACTS:
            for name in ('noise 4 mN', 'noise 20 mN', '1 % lost'):
                tables = _tables(protocol, contact, trials, CONDITIONS[name][0])
                rows += [
                    Row(f'{protocol} {contact}, {name}, {classifier}', more=more)
                    for classifier, more in _accuracies(tables, DEFAULT_SCALING[protocol])
                ]
    return Report(
        'phase-features: accuracy in % with commanded and detected phases, in new SIMULATED '
        'sessions',
        '',
        f'trained on {SESSIONS - TEST_SESSIONS} sessions, tested on {TEST_SESSIONS}; texture not '
        'scaled, stiffness scaled; trials without a window count as wrong. Columns: phases in '
        'training > in testing',
        rows,
    )


_Table = tuple[list[NDArray[np.float64] | None], list[str], list[int]]
"""Features (None if there is no window), label and session of each trial."""


def _tables(protocol: str, contact: str, trials: int, disturbance: Disturbance) -> list[_Table]:
    """Return two tables: features with commanded phases, and features with detected phases."""
    stated: _Table = ([], [], [])
    detected: _Table = ([], [], [])
    for number in range(SESSIONS):
        session = simulate_session(protocol, contact, number, trials)
        kept, tension_n = disturbance.apply(session, seed=number)
        blocks = as_blocks(kept, tension_n, session.period_ns)
        for table, phases in ((stated, 'stated'), (detected, protocol)):
            extractor = TrialFeatureExtractor(FeatureConfig(phases=phases, max_gap_samples=3))
            windows = _extract(extractor, blocks, session.events())
            for trial in session.trials:
                usable = [
                    w.values
                    for w in windows
                    if w.outcome == WindowOutcome.OK
                    and trial.start_ns <= w.window_start_ns < trial.end_ns
                ]
                table[0].append(usable[0] if len(usable) == 1 else None)
                table[1].append(trial.label)
                table[2].append(number)
    return [stated, detected]


def _extract(
    extractor: TrialFeatureExtractor, blocks: list[StrainBlock], events: list[TrialEvent]
) -> list[FeatureWindow]:
    windows = []
    for block in blocks:
        while events and events[0].stamp_ns <= block.stamp_ns:
            windows += extractor.add_event(events.pop(0))
        windows += extractor.add_block(block)
    for event in events:  # remaining events of the last trial
        windows += extractor.add_event(event)
    return windows


def _accuracies(tables: list[_Table], scaling: str) -> Iterable[tuple[str, dict[str, Any]]]:
    names = ('stated', 'detected')
    for classifier in CLASSIFIERS:
        more: dict[str, Any] = {}
        for trained, train_name in zip(tables, names, strict=True):
            values, labels = _select(trained, lambda session: session < SESSIONS - TEST_SESSIONS)
            estimator = build_estimator(classifier, scaling).fit(np.stack(values), labels)
            for tested, test_name in zip(tables, names, strict=True):
                share = _test(estimator, tested)
                more[f'{train_name} > {test_name}'] = f'{100 * share:.1f}'
        more['no window'] = sum(value is None for value in tables[1][0])
        yield classifier, more


def _select(table: _Table, wanted: Any) -> tuple[list[NDArray[np.float64]], list[str]]:
    chosen = [
        (value, label)
        for value, label, session in zip(*table, strict=True)
        if value is not None and wanted(session)
    ]
    return [value for value, _ in chosen], [label for _, label in chosen]


def _test(estimator: Any, table: _Table) -> float:
    first = SESSIONS - TEST_SESSIONS
    values, labels = _select(table, lambda session: session >= first)
    right = np.count_nonzero(estimator.predict(np.stack(values)) == np.array(labels))
    return float(right) / sum(session >= first for session in table[2])
