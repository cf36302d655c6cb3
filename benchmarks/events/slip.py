# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slip detector on simulated grips: misses, latency, false alarms by threshold."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from benchmarks.events.grips import (
    FAST_HZ,
    FloatArray,
    Grips,
    make_block,
    simulate_grips,
)
from benchmarks.measuring import Report, Row
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_classifier.records import CONTACTS
from tactile_features.slip import SlipConfig, SlipDetector

SEEDS = range(4000, 4005)
"""Apart from the seeds on which the detector was designed and its parameters chosen (1 and 7)."""

THRESHOLDS = {60.0: (4.5, 5.0, 5.5, 6.0), FAST_HZ: (5.5, 6.0, 6.5, 9.0)}
HOLDS_S = {60.0: (1800.0, 4), FAST_HZ: (300.0, 6)}
"""Length and number of still grips for each contact."""
SLIDING = ('smooth', 'rough')
MOVED_M = 5e-5
"""The fingertip has slid so far over the object: it is slipping [m]."""

EARLY_S = 0.02


def run_slip(quick: bool) -> Report:
    """Held objects that are pulled away, and grips that hold for hours."""
    rows = []
    for rate_hz in (60.0, FAST_HZ):
        scenes = {
            (label, contact): [
                _simulate_scenes(label, contact, rate_hz, seed, quick)
                for seed in (SEEDS[:1] if quick else SEEDS)
            ]
            for label in (*SLIDING, 'cylinder')
            for contact in CONTACTS
        }
        for threshold in THRESHOLDS[rate_hz]:
            config = SlipConfig(threshold=threshold)
            for (label, contact), seeds in scenes.items():
                judged = [_judge_scenes(label, grips, config, rate_hz) for grips in seeds]
                more = _summarise(judged)
                case = f'{rate_hz:g} Hz, {threshold:g}: {label}, {contact}'
                rows.append(Row(case, more=more))
    for rate_hz, (hold_s, count) in HOLDS_S.items():
        hold_s, count = (60.0, 2) if quick else (hold_s, count)
        for contact in CONTACTS:
            # Once, at the lowest threshold: what would have passed a higher one did pass it.
            thresholds = THRESHOLDS[rate_hz]
            grips = _hold(contact, hold_s, count, rate_hz)
            deviates = _find_deviates(grips, min(thresholds), rate_hz)
            hours = hold_s * count / 3600
            for threshold in thresholds:
                alarms = sum(deviate > threshold for deviate in deviates)
                more = {'early': str(alarms), 'hours': hours, 'alarms/h': alarms / hours}
                case = f'{rate_hz:g} Hz, {threshold:g}: long hold, {contact}'
                rows.append(Row(case, more=more))
    return Report(
        'slip: SIMULATED grips, 3 sessions a seed, seeds apart from those of the design',
        '',
        f'latency from {1e6 * MOVED_M:g} micrometres of slip; early: alarms before, or without; '
        'counts: mean over seeds (least to most)',
        rows,
    )


def _simulate_scenes(
    label: str, contact: str, rate_hz: float, seed: int, quick: bool
) -> list[Grips]:
    request = TrialRequest('slip', contact)
    count = 5 if quick else 20
    return [
        simulate_grips(request, TrialConfig(simulated=True), label, count, seed, session, rate_hz)
        for session in range(3)
    ]


class Judged(NamedTuple):
    """Slips and alarms of one seed's trials; latencies and errors of onsets [s]."""

    slips: int
    missed: int
    early: int
    trials: int
    latencies_s: list[float]
    onsets_s: list[float]


def _judge_scenes(label: str, sessions: list[Grips], config: SlipConfig, rate_hz: float) -> Judged:
    slips, early, latencies_s, onsets_s = 0, 0, [], []
    for grips in sessions:
        detector = SlipDetector(config)
        phases = dict(grips.planned.phases)
        for trial, tension_n in enumerate(grips.tension_n):
            block = make_block(tension_n, trial, rate_hz)
            found = [
                ((slip.stamp_ns - block.stamp_ns) / 1e9, (slip.onset_ns - block.stamp_ns) / 1e9)
                for slip in detector.add(block)
            ]
            found = [pair for pair in found if phases['contact'] < pair[0] < phases['release']]
            began_s = _find_slip_s(grips, trial, phases) if label in SLIDING else None
            right = [pair for pair in found if began_s and pair[0] >= began_s - EARLY_S]
            early += len(found) - len(right)
            slips += began_s is not None
            if right and began_s:
                latencies_s.append(right[0][0] - began_s)
                onsets_s.append(right[0][1] - began_s)
    trials = sum(len(grips.tension_n) for grips in sessions)
    return Judged(slips, slips - len(latencies_s), early, trials, latencies_s, onsets_s)


def _summarise(seeds: list[Judged]) -> dict[str, Any]:
    more: dict[str, Any] = {}
    for name in ('slips', 'missed', 'early', 'trials'):
        counts = [getattr(each, name) for each in seeds]
        more[name] = f'{np.mean(counts):.3g} ({min(counts)} to {max(counts)})'
    latencies_s = [value for each in seeds for value in each.latencies_s]
    onsets_s = [value for each in seeds for value in each.onsets_s]
    if latencies_s:
        median, most = 1e3 * np.percentile(latencies_s, (50, 95))
        more |= {
            'latency ms': f'{median:.0f}, 95 % {most:.0f}',
            'onset off by ms': f'{1e3 * np.median(np.abs(onsets_s)):.0f}',
        }
    return more


def _find_slip_s(grips: Grips, trial: int, phases: dict[str, float]) -> float | None:
    times_s = grips.times_s
    slipped: FloatArray = grips.motion.truth['slip_m'][trial]
    moved = (slipped > MOVED_M) & (times_s >= phases['pull']) & (times_s < phases['release'])
    return float(times_s[np.argmax(moved)]) if moved.any() else None


def _hold(contact: str, hold_s: float, count: int, rate_hz: float) -> Grips:
    request = TrialRequest('stiffness', contact, hold_s=hold_s)
    config = TrialConfig(simulated=True)
    return simulate_grips(request, config, 'solid_rubber', count, SEEDS[0], 0, rate_hz)


def _find_deviates(grips: Grips, threshold: float, rate_hz: float) -> list[float]:
    until = int(np.searchsorted(grips.times_s, dict(grips.planned.phases)['release']))
    config = SlipConfig(threshold=threshold)
    return [
        threshold * slip.statistic
        for tension_n in grips.tension_n
        for slip in SlipDetector(config).add(make_block(tension_n[:until], 0, rate_hz))
    ]
