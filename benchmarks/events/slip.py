# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slip detector on simulated grips: misses, latency, false alarms by threshold."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.stats import norm

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
                more = _summarise(judged, threshold)
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
        simulate_grips(request, TrialConfig(), label, count, seed, session, rate_hz)
        for session in range(3)
    ]


class Judged(NamedTuple):
    """Slips and alarms of one seed's trials; latencies and errors of onsets [s].

    ``deviations``: of each slip for the best filter, see `_find_deviation`.
    """

    slips: int
    missed: int
    early: int
    trials: int
    latencies_s: list[float]
    onsets_s: list[float]
    deviations: list[float]


def _judge_scenes(label: str, sessions: list[Grips], config: SlipConfig, rate_hz: float) -> Judged:
    early, latencies_s, onsets_s, deviations = 0, [], [], []
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
            if began_s:
                deviations.append(_find_deviation(grips, trial, began_s, rate_hz))
            if right and began_s:
                latencies_s.append(right[0][0] - began_s)
                onsets_s.append(right[0][1] - began_s)
    trials = sum(len(grips.tension_n) for grips in sessions)
    missed = len(deviations) - len(latencies_s)
    return Judged(len(deviations), missed, early, trials, latencies_s, onsets_s, deviations)


def _find_deviation(grips: Grips, trial: int, began_s: float, rate_hz: float) -> float:
    """Return how far a slip stands out for the filter that knows its shape and time [SD of noise].

    That is the fall without noise below the line through the history, less the line that both
    could be; the largest over starts near the true one.
    """
    clean_n = grips.motion.sensed_n
    noise_n = np.std(np.diff(grips.tension_n - clean_n, axis=1)) / np.sqrt(2)
    history, fall = (round(length_s * rate_hz) for length_s in (0.2, 0.05))
    places = np.arange(history + fall)
    first, last = (
        int(np.searchsorted(grips.times_s, began_s + shift_s)) for shift_s in (-0.03, 0.06)
    )
    largest = 0.0
    for start in range(first, last + 1, max(1, round(0.005 * rate_hz))):
        values = clean_n[trial, start - history : start + fall]
        line = np.polyfit(places[:history], values[:history], 1)
        shape = np.where(places < history, 0.0, values - np.polyval(line, places))
        rest = shape - np.polyval(np.polyfit(places, shape, 1), places)
        if shape.sum() < 0.0:
            largest = max(largest, float(np.linalg.norm(rest) / noise_n))
    return largest


def _summarise(seeds: list[Judged], threshold: float) -> dict[str, Any]:
    more: dict[str, Any] = {}
    for name in ('slips', 'missed', 'early', 'trials'):
        counts = [getattr(each, name) for each in seeds]
        more[name] = f'{np.mean(counts):.3g} ({min(counts)} to {max(counts)})'
    floor = [float(norm.cdf(threshold - np.array(each.deviations)).sum()) for each in seeds]
    more['missed by the best filter'] = (
        f'{np.mean(floor):.1f} ({min(floor):.1f} to {max(floor):.1f})'
    )
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
    config = TrialConfig()
    return simulate_grips(request, config, 'solid_rubber', count, SEEDS[0], 0, rate_hz)


def _find_deviates(grips: Grips, threshold: float, rate_hz: float) -> list[float]:
    until = int(np.searchsorted(grips.times_s, dict(grips.planned.phases)['release']))
    config = SlipConfig(threshold=threshold)
    return [
        threshold * slip.statistic
        for tension_n in grips.tension_n
        for slip in SlipDetector(config).add(make_block(tension_n[:until], 0, rate_hz))
    ]
