# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Slip in smooth contact: how much of it one tendon's tension shows, and to which sensor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from benchmarks.events.grips import CONTACTS, FAST_HZ, FloatArray, make_block
from benchmarks.events.rolling import (
    compute_visibility,
    FIRST_SEED,
    KINDS,
    Pulls,
    read,
    SEEDS,
    SENSORS,
    simulate_pulls,
    tell_spread,
    THRESHOLD,
    TRIALS,
)
from benchmarks.measuring import Report, Row
from tactile_features.slip import SlipConfig, SlipDetector

THRESHOLDS = (5.0, 6.5)
MOVED_M = 5e-5
"""The fingertip has slid so far over the object: it is slipping [m]."""
EARLY_S, LATE_S = 0.02, 0.3
"""An alarm belongs to a slip from so long before it to so long after it."""
LOOKS_S = {'0.2 + 0.05 s': (0.2, 0.05), '1 + 0.5 s': (1.0, 0.5)}
"""Windows on a slip, before and after it. The first is that of the slip detector."""
ALIGN_S = (-0.1, 0.3)  # where the window may lie, against `MOVED_M` of slip
EXPECTED = 0.95  # share of pulls that a sufficient sensor has to show


def run_slip_limits(quick: bool) -> Report:
    """What a matched filter sees of the moment in which a smooth object breaks loose."""
    seeds = range(FIRST_SEED, FIRST_SEED + (2 if quick else SEEDS))
    rows = []
    for contact in CONTACTS:
        for rate_hz in (60.0, FAST_HZ):
            every = [simulate_pulls(KINDS['slides'], contact, rate_hz, seed) for seed in seeds]
            for sensor, (sensor_hz, noise_n) in SENSORS.items():
                if sensor_hz != rate_hz:
                    continue
                for look, (before_s, after_s) in LOOKS_S.items():
                    seen = [_see_slips(pulls, rate_hz, before_s, after_s) for pulls in every]
                    more = _judge_slips([s / noise_n for s in seen], rate_hz, noise_n)
                    rows.append(Row(f'{contact}, {sensor}, {look}', more=more))
                for threshold in THRESHOLDS:
                    more = _run_detector(every, rate_hz, noise_n, threshold)
                    rows.append(Row(f'{contact}, {sensor}, detector {threshold:g}', more=more))
    return Report(
        f'slip-limits: SIMULATED, a smooth object breaks loose, {len(seeds)} seeds of {TRIALS}',
        'none: the table is about answers',
        f'one look finds: share that a matched filter puts beyond {THRESHOLD:g} deviations; '
        f'needed: white noise with which it finds {100 * EXPECTED:.0f} % of them',
        rows,
    )


def _judge_slips(seen: list[FloatArray], rate_hz: float, noise_n: float) -> dict[str, Any]:
    every = np.concatenate(seen)

    def find_share(deflections: FloatArray, gain: float = 1.0) -> float:
        return float(np.mean(norm.cdf(gain * deflections - THRESHOLD)))

    gain = brentq(lambda g: find_share(every, g) - EXPECTED, 1e-3, 1e3)
    density = noise_n / math.sqrt(rate_hz / 2)
    return {
        'slips': str(len(every)),
        "d' 5, 50, 95 %": ', '.join(f'{d:.1f}' for d in np.quantile(every, (0.05, 0.5, 0.95))),
        'one look finds': tell_spread([find_share(d) for d in seen if len(d)]),
        'noise now uN/rtHz': f'{1e6 * density:.0f}',
        'needed': f'{1e6 * density / gain:.0f}',
    }


def _see_slips(pulls: Pulls, rate_hz: float, before_s: float, after_s: float) -> FloatArray:
    """Return the length of what no line explains about each slip, where it is largest [N]."""
    effect_n, slip_m = pulls.effect_n(), pulls.pulled.truth['slip_m']
    times_s = pulls.pulled.sample_times_s
    before, after = round(before_s * rate_hz), max(1, round(after_s * rate_hz))
    here_s = np.arange(before + after) / rate_hz
    line = np.column_stack([np.ones_like(here_s), here_s])
    seen = []
    for trial, moved in enumerate((slip_m > MOVED_M) & (times_s >= pulls.begin_s)):
        if not moved.any():
            continue
        slipped = int(np.argmax(moved))
        places = [slipped + round(shift * rate_hz) for shift in ALIGN_S]
        parts = [
            effect_n[trial, place - before : place + after]
            for place in range(places[0], places[1] + 1)
            if place + after <= effect_n.shape[1]
        ]
        seen.append(compute_visibility(np.array(parts), line, 1.0).max())
    return np.array(seen)


def _run_detector(
    every: list[Pulls], rate_hz: float, noise_n: float, threshold: float
) -> dict[str, Any]:
    """Run the slip detector of this workspace on the same pulls."""
    found, early, delays = [], 0, []
    config = SlipConfig(rate_hz=rate_hz, threshold=threshold)
    for number, pulls in enumerate(every):
        names = (number, round(rate_hz), round(1e6 * noise_n))
        tension_n = read(pulls, pulls.pulled.sensed_n, noise_n, *names)
        times_s = pulls.pulled.sample_times_s
        moved = (pulls.pulled.truth['slip_m'] > MOVED_M) & (times_s >= pulls.begin_s)
        hits = []
        for row, slipped in zip(tension_n, moved, strict=True):
            slips = SlipDetector(config).add(make_block(row, 0, rate_hz))
            stamps_s = [slip.stamp_ns / 1e9 for slip in slips]
            slip_s = float(times_s[np.argmax(slipped)]) if slipped.any() else math.inf
            early += sum(pulls.begin_s < t < slip_s - EARLY_S for t in stamps_s)
            right = [t - slip_s for t in stamps_s if -EARLY_S <= t - slip_s < LATE_S]
            if slipped.any():
                hits.append(bool(right))
                delays += right[:1]
        found.append(float(np.mean(hits)) if hits else math.nan)
    return {
        'detector finds': tell_spread(found),
        'delay ms': f'{1e3 * np.median(delays):.0f}' if delays else 'never',
        'early': str(early),
    }
